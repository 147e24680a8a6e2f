"""Studies of more patches than one job does, and than a figure shows."""

import pandas as pd


def test_batches_and_drawn_patches_leave_the_tables_alone(tiny):
    before = tiny.tables()
    tiny.change(patches_per_job=4, most_drawn_patches=2)
    planned = tiny.planned()
    assert {f"prepare_{epoch}_scans_{part}" for epoch in ("t0", "t1") for part in (1, 2)} <= planned
    assert {"register_patches_1", "register_patches_2", "plot_preparation"} <= planned
    result = tiny.run()
    assert result.returncode == 0, result.stderr
    assert tiny.tables() == before
    # the hardest pressed and the middle one of those that are studied
    pressures = pd.read_csv(tiny.results / "tables/patch_pressures.csv", dtype={"patch": str})
    studied = pressures[pressures.in_study == "yes"].sort_values("pressure_MPa", ascending=False)
    wanted = set(studied.patch.iloc[[0, len(studied) // 2]])
    assert {file.stem for file in (tiny.results / "figures/patch").glob("*.png")} == wanted
    assert len(list((tiny.results / "figures/preparation").glob("*.png"))) == 2
    drawn = (tiny.results / "figures/microscale_maps.svg").read_text()
    assert f"2 of {len(studied)} patches" in drawn
    # nothing that is computed from the surfaces was computed again: they are the same
    log = (tiny.results / "logs/register_patches_2.log").read_text()
    assert "INFO patch 16, 2 of 2" in log
