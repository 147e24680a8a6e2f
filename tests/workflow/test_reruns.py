"""A change reruns what depends on it and nothing else. Only plans are made here."""

import re
import shutil

import pytest
import yaml
from conftest import ROOT

DRAW = {"draw_inputs", "draw_contact", "draw_validation"}


def test_nothing_is_left_to_do(tiny):
    assert tiny.planned() == set()


@pytest.mark.parametrize(
    ("change", "reruns", "stays"),
    [
        (
            {"load": {"force_N": 500.0}},
            {"solve_macroscale", "couple_scales", "solve_patches", "judge_wear"},
            {"generate_specimen", "grid_macroscale", "prepare_T0_scans", "register_patches"},
        ),
        (
            {"load": {"force_N": 550.0, "at_mm": [2.0, 3.0]}},
            {"solve_macroscale", "couple_scales", "bound_pressures", "solve_reference"},
            {"grid_macroscale", "compose_surface", "place_patches"},
        ),
        (
            {"counterface": {"radius_mm": 100.0}},
            {"grid_macroscale", "solve_macroscale", "couple_scales", "solve_reference"},
            {"generate_specimen", "prepare_T0_scans", "register_patches"},
        ),
        (
            {"uncertainty": {"force_point_mm": 2.0}},
            {"bound_pressures", "draw_contact"},
            {"solve_macroscale", "compose_surface", "solve_patches"},
        ),
        (
            {"preprocessing": {"outlier_median_threshold": 6.0}},
            {"prepare_T0_scans", "prepare_T1_scans", "register_patches", "compose_surface"},
            {"generate_specimen", "grid_macroscale"},
        ),
        (
            {"coupling": "levelled"},
            {"grid_macroscale", "solve_macroscale", "couple_scales", "solve_patches"},
            {"prepare_T0_scans", "compose_surface", "solve_reference"},
        ),
        (
            {"microscale": {"s_filter_um": 60.0}},
            {"compose_surface", "solve_macroscale", "solve_patches"},
            {"grid_macroscale", "prepare_T0_scans", "register_patches", "place_patches"},
        ),
        (
            {"gesture": {"wander_mm": 0.5, "poses": 6}},
            {"press_poses_1", "bound_pressures", "predict_wear"},
            {"solve_macroscale", "solve_patches"},
        ),
        ({"validation": {"resamples": 299}}, {"judge_wear", "draw_validation", "write_page"}, None),
        ({"grinding": {"friction": 0.5}}, {"solve_cases", "write_page"}, None),
        (
            {"counterface": {"scan": "face.plu", "radius_mm": 200.0}},
            {"prepare_counterface", "solve_patches", "solve_cases"},
            {"prepare_T0_scans", "solve_macroscale", "couple_scales", "register_patches"},
        ),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_a_changed_value(tiny, change, reruns, stays):
    shutil.copy2(tiny.results / "specimen/scans/5_T0.plu", tiny.folder / "face.plu")
    tiny.change(**change)
    planned = tiny.planned()
    if stays is None:
        assert planned == reruns
    else:
        assert reruns <= planned
        assert planned.isdisjoint(stays)


@pytest.mark.parametrize(
    ("module", "reruns", "stays"),
    [
        ("gstlib/bem/halfspace.py", {"solve_macroscale", "write_page"}, set()),
        ("gst/page.css", {"write_page"}, {"solve_macroscale", "judge_wear"}),
    ],
)
def test_a_changed_library_file(tiny, tmp_path, module, reruns, stays):
    library = tmp_path / "clone/src"
    for package in ("gst", "gstlib"):
        shutil.copytree(ROOT / "src" / package, library / package)
    for part in ("config", "workflow"):
        (tmp_path / "clone" / part).symlink_to(ROOT / part)
    with (library / module).open("a") as file:
        file.write("\n/* a change */\n" if module.endswith("css") else "\n# a change\n")
    tiny.environment = {"PYTHONPATH": str(library)}
    planned = tiny.planned()
    assert reruns <= planned
    assert planned.isdisjoint(stays)


def test_patches_are_shared_out_by_the_profile(tiny):
    planned = tiny.planned("--config", "patches_per_job=4")
    assert {"prepare_T0_scans_1", "prepare_T0_scans_2", "solve_patches_2"} <= planned
    assert planned.isdisjoint({"generate_specimen", "grid_macroscale"})


def test_the_whole_plan_is_known_before_anything_has_run(study):
    assert {"generate_specimen", "solve_patches", "judge_wear", *DRAW} <= study.planned()


def test_the_sweep_is_planned_only_when_asked_for(study):
    study.config = "config/sweep.yaml"
    asked = yaml.safe_load((study.folder / study.config).read_text())["sweep"]
    said = study.succeed("sweep", "--dry-run")
    count = 1 + sum(map(len, asked.values()))
    assert re.search(rf"^try_setting +{count}$", said, re.MULTILINE)
    assert "try_setting" not in study.planned()
