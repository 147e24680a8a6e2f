"""Names of an earlier version: keys of a config, and steps.

An old name cannot be used by mistake: a config with an old key is refused with the new one, and a
results folder with records of an old step is refused as a whole.
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
