"""Names of an earlier version: keys of a config, steps, and headings and values of tables.

An old name cannot be used by mistake: a config with an old key is refused with the new one, and a
results folder with records of an old step is refused as a whole. `workflow/rename_tables.py` copies
old tables under the present names.
"""

KEYS = {
    "traces": "detection",
    "minimum_points": "minimum_cluster_points",
    "reference_draws": "reference_realisations",
    "most_drawn_patches": "max_plotted_patches",
    "max_noise_fraction": "max_gain_to_loss_ratio",
    "force_fraction": "force_log_sd",
    "radius_fraction": "radius_log_sd",
    "young_fraction": "young_log_sd",
}
COUPLINGS = {"placed": "equilibrium", "levelled": "paper"}
STEPS = {
    "measure_detection": "estimate_detection_limit",
    "place_patches": "check_placement",
}

# by table and old heading
COLUMNS = {
    "laws": {
        "mean": "posterior_mean",
        "gain": "log_score_gain",
        "gain_error": "log_score_gain_error",
    },
    "predicted_losses": {"effective_draws": "effective_sample_size"},
    "registration": {
        "height_scale": "dale_depth_ratio",
        "noise_fraction": "gain_to_loss_ratio",
    },
    "use": {
        "stated": "prior",
        "stated_error": "prior_error",
        "mean": "posterior_mean",
        "mean_without_curvature": "posterior_mean_without_curvature",
        "effective_draws": "effective_sample_size",
        "taken": "adopted",
    },
    "wear": {"marked_fraction": "predicted_worn_fraction"},
}
_HIGHEST = {f"highest_{old}": f"highest_{new}" for old, new in COUPLINGS.items()}
# by table, present heading and old value
VALUES = {
    "two_scales": {"variant": COUPLINGS | _HIGHEST},
    "use": {"parameter": {"gain": "log_score_gain"}},
}
