"""The report's captions: columns that do not explain themselves are explained there."""

from pathlib import Path

import pytest

CAPTIONS = Path(__file__).parents[2] / "workflow/report"


@pytest.mark.parametrize(
    ("caption", "columns"),
    [
        ("inputs_table", ["unmeasured"]),
        ("outliers", ["window_k", "median_threshold", "median_scale_um"]),
        ("patch_pressures", ["peak_pressure_MPa"]),
        ("placement_table", ["looks"]),
        ("preprocessing", ["unmeasured", "unmeasured_share"]),
        ("slip", ["mean_traction_MPa", "tangential_displacement_um"]),
        (
            "validation_patches",
            [
                *("contact_fraction", "valid_contact_fraction", "loss_fraction", "gain_fraction"),
                *("loss_area_mm2", "loss_volume_um3", "loss_depth_um", "loss_per_area_um"),
                *("noise_share", "correlation_length_um", "rigid_fraction", "fss", "pr_lift"),
            ],
        ),
    ],
)
def test_columns_are_named_in_the_caption_of_their_table(caption, columns):
    text = (CAPTIONS / f"{caption}.rst").read_text(encoding="utf-8")
    assert [column for column in columns if f"``{column}``" not in text] == []
