"""The whole of a study, end to end, on coarse grids."""

import json
import os
import shutil
import signal
import subprocess
import time

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT, fresh

from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surface import spacing_of

COLUMNS = {
    "patch_pressures": ["patch", "x_mm", "y_mm", "pressure_MPa", "in_study", "reason"],
    "macroscale_path": [
        *("step", "displacement_um", "mean_pressure_MPa", "contact_fraction"),
        "stiffness_MPa_per_um",
    ],
    "microscale_summary": [
        *("patch", "target_pressure_MPa", "mean_pressure_MPa", "displacement_um"),
        *("contact_fraction", "stiffness_MPa_per_um", "residual", "iterations"),
    ],
    "microscale_paths": [
        *("patch", "step", "displacement_um", "mean_pressure_MPa", "contact_fraction"),
        "stiffness_MPa_per_um",
    ],
    "preprocessing": [
        *("patch", "epoch", "unmeasured", "filled", "outliers", "outlier_k", "tilt_x_mrad"),
        *("tilt_y_mrad", "Sq_before_um", "Sq_after_um"),
    ],
    "validation_patches": ["patch"],
    "validation_summary": ["statistic", "value", "low", "high", "p_value"],
    "truth": ["stage", "quantity", "patch", "unit", "true", "recovered", "error"],
}


def test_every_table_has_its_columns(finished_tiny):
    for name, columns in COLUMNS.items():
        table = read_table(finished_tiny.results / "tables" / f"{name}.csv")
        assert len(table), name
        assert [column for column in columns if column not in table.columns] == [], name


def test_every_place_has_a_row_and_a_reason_when_left_out(finished_tiny):
    table = pd.read_csv(finished_tiny.results / "tables/patch_pressures.csv", dtype=str)
    places = pd.read_csv(
        finished_tiny.folder / "config/patches_tiny.tsv", sep="\t", comment="#", dtype=str
    )
    assert list(table.patch) == list(places.patch)
    assert (table.reason.isna() == (table.in_study == "yes")).all()
    assert {"yes", "no"} == set(table.in_study)


def love_displacement(pressure, spacing, modulus):
    """Displacement under uniformly loaded squares, summed directly with Love's formula.

    Written anew for this test: no FFT, nothing of gstlib.
    """
    dy, dx = spacing
    ny, nx = pressure.shape
    y, x = np.mgrid[-ny + 1 : ny, -nx + 1 : nx].astype(float)
    y, x = y * dy, x * dx

    def corner(x, y):
        return x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y))

    influence = (
        corner(x + dx / 2, y + dy / 2)
        - corner(x + dx / 2, y - dy / 2)
        - corner(x - dx / 2, y + dy / 2)
        + corner(x - dx / 2, y - dy / 2)
    ) / (np.pi * modulus)
    displacement = np.zeros_like(pressure)
    for i, j in zip(*np.nonzero(pressure), strict=True):
        window = influence[ny - 1 - i : 2 * ny - 1 - i, nx - 1 - j : 2 * nx - 1 - j]
        displacement += pressure[i, j] * window
    return displacement


def recomputed_residual(height, pressure, displacement, spacing, modulus):
    """Largest violation of the contact conditions over the largest rigid interpenetration."""
    interpenetration = displacement - (height.max() - height)
    gap = love_displacement(pressure, spacing, modulus) - interpenetration
    contact = pressure > 0
    violation = max(np.abs(gap[contact]).max(), np.max(-gap[~contact], initial=0.0))
    assert (pressure >= 0).all()
    return violation / interpenetration.max()


def test_every_stored_state_fulfils_the_contact_conditions(finished_tiny):
    files = [finished_tiny.results / "macroscale/contact.h5"]
    files += sorted(finished_tiny.results.glob("microscale/*.h5"))
    assert len(files) > 2
    for file in files:
        contact = read_dataset(file)
        pressure = contact.pressure.values.reshape(-1, *contact.height.shape)
        displacement = contact.displacement.values[-len(pressure) :]
        for field, delta in zip(pressure, displacement, strict=True):
            residual = recomputed_residual(
                contact.height.values,
                field,
                delta,
                spacing_of(contact),
                contact.attrs["contact_modulus_MPa"],
            )
            assert residual <= 1e-6, file


def test_targets_are_hit(finished_tiny):
    tables = finished_tiny.results / "tables"
    final = read_table(tables / "macroscale_path.csv").iloc[-1]
    target = read_dataset(finished_tiny.results / "macroscale/contact.h5").attrs
    assert final.mean_pressure_MPa == pytest.approx(target["target_pressure_MPa"], rel=1e-3)
    patches = read_table(tables / "microscale_summary.csv")
    pressures = read_table(tables / "patch_pressures.csv").set_index("patch").pressure_MPa
    assert patches.mean_pressure_MPa.to_numpy() == pytest.approx(
        pressures[patches.patch].to_numpy(), rel=1e-3
    )


def test_intermediates_carry_units_names_and_provenance(finished_tiny):
    files = [file for file in finished_tiny.results.rglob("*.h5") if "specimen" not in file.parts]
    assert files
    for file in files:
        dataset = read_dataset(file)
        for variable in dataset.data_vars.values():
            assert variable.attrs["units"]
            assert variable.attrs["long_name"]
        assert dataset.attrs["gstlib_version"]
        assert all(
            len(digest) == 64 for digest in json.loads(dataset.attrs["input_sha256"]).values()
        )


def test_report_holds_every_figure(finished_tiny, tmp_path):
    report = tmp_path / "report.html"
    result = finished_tiny.run("--report", str(report))
    assert result.returncode == 0, result.stderr
    text = report.read_text(encoding="utf-8")
    figures = sorted(finished_tiny.results.glob("figures/**/*.png"))
    assert len(figures) > 8
    for figure in figures:
        assert str(figure.relative_to(finished_tiny.folder)) in text
        assert figure.with_suffix(".svg").stat().st_size > 0


def test_nothing_is_left_to_do(tiny):
    assert tiny.planned() == set()


def test_a_changed_target_pressure_reruns_from_the_macroscale_path_on(tiny):
    tiny.change(macroscale={"target_pressure_MPa": 20.0})
    planned = tiny.planned()
    assert {"solve_macroscale", "couple_scales"} <= planned
    assert planned.isdisjoint({"generate_specimen", "grid_macroscale", "prepare_patch"})


def test_a_changed_outlier_share_reruns_from_the_preparation_on(tiny):
    tiny.change(preprocessing={"outlier_share": 0.004})
    planned = tiny.planned()
    assert {"prepare_patch", "couple_scales", "tabulate_preprocessing"} <= planned
    assert planned.isdisjoint({"generate_specimen", "grid_macroscale", "solve_macroscale"})


@pytest.mark.parametrize(
    ("module", "reruns", "stays"),
    [
        ("coupling.py", {"couple_scales"}, {"solve_macroscale", "grid_macroscale"}),
        ("bem/halfspace.py", {"solve_macroscale"}, {"grid_macroscale", "generate_specimen"}),
        ("preprocess/gridding.py", {"grid_macroscale"}, {"generate_specimen", "prepare_patch"}),
    ],
)
def test_a_changed_library_file_reruns_what_uses_it(tiny, tmp_path, module, reruns, stays):
    library = tmp_path / "library"
    shutil.copytree(ROOT / "src/gstlib", library / "gstlib")
    with (library / "gstlib" / module).open("a") as file:
        file.write("\n# a change\n")
    tiny.environment = {"PYTHONPATH": str(library)}
    planned = tiny.planned()
    assert reruns <= planned
    assert planned.isdisjoint(stays)


def test_one_core_gives_the_same_tables_as_two(finished_tiny, tmp_path):
    single = fresh(tmp_path / "single")
    result = single.run(cores=1)
    assert result.returncode == 0, result.stderr
    assert single.tables() == finished_tiny.tables()


def test_a_killed_run_is_resumed_with_the_same_tables(finished_tiny, tmp_path):
    study = fresh(tmp_path / "killed")
    with subprocess.Popen(
        study.command(),
        cwd=study.folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as process:
        # kill in the midst of the preparation: some patches done, some under way
        while process.poll() is None and not list(study.results.glob("surfaces/*.h5")):
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert study.run("--unlock").returncode == 0
    result = study.run()
    assert result.returncode == 0, result.stderr
    assert study.tables() == finished_tiny.tables()


def test_a_study_of_measured_files_without_t1(measured):
    """No T1 and figures to compare with: validation is left out, the rest is whole."""
    table = measured.folder / "config/patches_tiny.tsv"
    lines = [
        line.rsplit("\t", 1)[0] if not line.startswith("#") else line
        for line in table.read_text().splitlines()
    ]
    table.write_text("\n".join(lines) + "\n")
    (measured.folder / "published.csv").write_text(
        "quantity,patch,unit,value\nmean pressure,,MPa,22\npatch pressure,13,MPa,10\n"
    )
    measured.change(published="published.csv")
    result = measured.run()
    assert result.returncode == 0, result.stderr
    assert set(measured.tables()) == {
        "macroscale_path.csv",
        "microscale_paths.csv",
        "microscale_summary.csv",
        "patch_pressures.csv",
        "preprocessing.csv",
        "published.csv",
        "sensitivity.csv",
    }
    published = read_table(measured.results / "tables/published.csv").set_index("quantity")
    assert published.computed["mean pressure"] == pytest.approx(22, rel=1e-3)
    pressures = read_table(measured.results / "tables/patch_pressures.csv").set_index("patch")
    assert published.computed["patch pressure"] == pressures.pressure_MPa["13"]
    # a patch with a poor T0/T1 overlap counts when there is no T1
    assert not pressures.reason.fillna("").str.contains("overlap").any()
    assert (measured.results / "figures/overview.png").stat().st_size > 0


def test_a_study_that_no_patch_enters_ends_with_the_macroscale(tiny):
    for folder in ("microscale", "figures"):
        shutil.rmtree(tiny.results / folder)
    for table in [*tiny.results.glob("tables/micro*"), *tiny.results.glob("tables/valid*")]:
        table.unlink()
    tiny.change(selection={"minimum_pressure_MPa": 1000.0})
    result = tiny.run()
    assert result.returncode == 0, result.stderr
    assert "no patch enters the microscale study" in result.stderr
    pressures = read_table(tiny.results / "tables/patch_pressures.csv")
    assert not pressures.in_study.any()
    assert not (tiny.results / "microscale").exists()
    assert not (tiny.results / "tables/microscale_summary.csv").exists()
    assert (tiny.results / "figures/inputs.png").exists()
