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
from conftest import ROOT, fresh, older_processor

from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surface import spacing_of

COLUMNS = {
    "patch_pressures": ["patch", "x_mm", "y_mm", "pressure_MPa", "in_study", "reason"],
    "patch_intervals": [
        *("patch", "pressure_MPa", "low_MPa", "high_MPa", "placement_low_MPa"),
        *("placement_high_MPa", "material_low_MPa", "material_high_MPa"),
    ],
    "macroscale_path": [
        *("step", "displacement_um", "mean_pressure_MPa", "contact_fraction"),
        "stiffness_MPa_per_um",
    ],
    "microscale_summary": [
        *("patch", "target_pressure_MPa", "mean_pressure_MPa", "displacement_um"),
        *("contact_fraction", "stiffness_MPa_per_um", "residual"),
    ],
    "microscale_paths": [
        *("patch", "step", "displacement_um", "mean_pressure_MPa", "contact_fraction"),
        "stiffness_MPa_per_um",
    ],
    "slip": [
        *("patch", "pressure_MPa", "friction", "tangential_ratio", "mean_traction_MPa"),
        *("stick_share", "slip_share", "slip_area_fraction", "tangential_displacement_um"),
    ],
    "hardness": [
        *("patch", "pressure_MPa", "hardness_MPa", "elastic_peak_pressure_MPa"),
        *("elastic_contact_fraction", "contact_fraction", "ceiling_share"),
        *("elastic_displacement_um", "displacement_um", "dice", "iou", "deepest_yield_um"),
    ],
    "inputs": ["patch", "epoch", "file", "points_x", "points_y", "spacing_x_um", "Sq_um"],
    "gridding": [
        *("method", "mesh_points", "elements", "Sq_um", "highest_um", "rms_difference_um"),
        *("largest_difference_um", "x_mm", "y_mm", "correlation"),
    ],
    "outliers": [
        *("patch", "epoch", "outlier_rule", "window_k", "window", "median", "both"),
        "agreement",
    ],
    "placement": [
        *("patch", "waves", "correlation_nominal", "correlation", "p_value", "shift_x_um"),
        *("shift_y_um", "shift_x_error_um", "shift_y_error_um", "shift_p_value", "verdict"),
        "looks",
    ],
    "registration": [
        *("patch", "found", "overlap", "shift_x_um", "shift_y_um", "rotation_deg", "correlation"),
        *("residual_um", "level_of_detection_um", "excluded", "reason"),
    ],
    "texture": ["patch", "epoch", "size_x_mm", "Sa_um", "Sq_um", "Sdq", "Str", "Sk_um"],
    "preprocessing": [
        *("patch", "epoch", "unmeasured", "filled", "outliers", "outlier_k", "tilt_x_mrad"),
        *("tilt_y_mrad", "Sq_before_um", "Sq_after_um"),
    ],
    "validation_patches": [
        *("patch", "contact_fraction", "loss_fraction", "loss_per_area_um", "mcc", "fss"),
        *("pr_lift", "highest_pr_auc", "rigid_f1", "rigid_fraction", "curvature_roc_auc"),
    ],
    "validation_gains": [
        *("patch", "score", "value", "null_mean", "null_low", "null_high", "effect_size"),
        *("p_value", "shifts", "best_rival", "gain", "gain_low", "gain_high", "blocks"),
    ],
    "validation_failures": ["patch", "split", "band", "loss_share", "hit_share", "recall"],
    "validation_summary": ["statistic", "value", "low", "high", "p_value", "n", "against"],
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


def test_stored_stick_and_slip_obey_coulomb(finished_tiny):
    files = sorted(finished_tiny.results.glob("slip/*.h5"))
    rows = read_table(finished_tiny.results / "tables/slip.csv").set_index("patch")
    assert sorted(rows.index) == sorted(file.stem for file in files) != []
    for file in files:
        slip, contact = read_dataset(file), read_dataset(file.parents[1] / "microscale" / file.name)
        friction, ratio = slip.attrs["friction"], slip.attrs["tangential_ratio"]
        assert (friction, ratio) == (0.6, 0.5)
        pressure, traction = contact.pressure.values, slip.traction.values
        stick, slides = slip.stick.values, slip.slip.values
        full = friction * pressure
        noise = 1e-6 * full.max()
        assert traction.min() >= -noise
        assert (traction - full).max() <= noise
        np.testing.assert_allclose(traction[slides], full[slides], atol=noise)
        assert (traction[stick] < full[stick]).all()
        assert traction.sum() == pytest.approx(ratio * full.sum(), rel=1e-6)
        np.testing.assert_array_equal(stick | slides, pressure > 0)
        assert not (stick & slides).any()
        assert rows.slip_share[file.stem] == pytest.approx(
            slides.sum() / (pressure > 0).sum(), 1e-4
        )
        assert rows.mean_traction_MPa[file.stem] == pytest.approx(traction.mean(), 1e-4)


def test_sticking_contact_moves_as_one(finished_tiny):
    """Where the contact sticks, the traction displaces it evenly; where it slips, by less."""
    for file in sorted(finished_tiny.results.glob("slip/*.h5")):
        slip, contact = read_dataset(file), read_dataset(file.parents[1] / "microscale" / file.name)
        friction, modulus = slip.attrs["friction"], contact.attrs["contact_modulus_MPa"]
        moved = love_displacement(slip.traction.values / friction, spacing_of(contact), modulus)
        stuck = moved[slip.stick.values]
        assert np.ptp(stuck) <= 1e-6 * float(contact.displacement[-1])
        # by how much, in the tangential direction
        ratio = (2 - slip.attrs["poisson"]) / (2 * (1 - slip.attrs["poisson"]))
        assert float(slip.tangential_displacement) == pytest.approx(
            friction * ratio * stuck.mean(), rel=1e-5
        )
        assert moved[slip.slip.values].max() <= stuck.mean() * (1 + 1e-6)


def test_stored_contacts_with_a_ceiling_obey_it(finished_tiny):
    files = sorted(finished_tiny.results.glob("hardness/*.h5"))
    rows = read_table(finished_tiny.results / "tables/hardness.csv").set_index("patch")
    assert sorted(rows.index) == sorted(file.stem for file in files) != []
    for file in files:
        limited = read_dataset(file)
        contact = read_dataset(file.parents[1] / "microscale" / file.name)
        hardness, row = limited.attrs["hardness_MPa"], rows.loc[file.stem]
        height, pressure = contact.height.values, limited.pressure.values
        interpenetration = float(limited.displacement) - (height.max() - height)
        gap = -interpenetration + love_displacement(
            pressure, spacing_of(contact), contact.attrs["contact_modulus_MPa"]
        )
        at_ceiling, touches = pressure >= hardness, pressure > 0
        allowed = 1e-6 * interpenetration.max()
        assert pressure.min() >= 0
        assert pressure.max() == hardness
        assert np.abs(gap[touches & ~at_ceiling]).max() <= allowed
        assert gap[~touches].min() >= -allowed
        assert gap[at_ceiling].max() <= allowed
        assert pressure.mean() == pytest.approx(contact.attrs["target_pressure_MPa"], rel=1e-6)
        assert 0 < row.ceiling_share < 1
        assert row.ceiling_share == pytest.approx(at_ceiling.sum() / touches.sum(), rel=1e-4)
        assert row.deepest_yield_um == pytest.approx(-1e3 * gap[at_ceiling].min(), rel=1e-4)
        elastic = contact.pressure.values > 0
        assert row.iou == pytest.approx((elastic & touches).sum() / (elastic | touches).sum(), 1e-4)
        assert row.elastic_peak_pressure_MPa == pytest.approx(float(contact.pressure.max()), 1e-4)


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
    assert "Predicted contact is compared with" in text
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
    assert planned.isdisjoint({"generate_specimen", "grid_macroscale", "prepare_t0_scans"})


def log_dates(study):
    """Which rule wrote a log, and when."""
    logs = study.results / "logs"
    return {
        (file.relative_to(logs).with_suffix("").parts[0], file.stat().st_mtime_ns)
        for file in logs.rglob("*.log")
    }


def test_a_changed_scan_reruns_nothing_of_the_other_patches(tiny):
    """All scans of an epoch are read again, but what comes out as it was causes nothing to run."""
    scan = tiny.results / "specimen/scans/5_T1.plu"
    content = bytearray(scan.read_bytes())
    heights = np.frombuffer(content, "<f4", 64 * 64, 508)
    heights[2000] += 0.5
    scan.write_bytes(content)
    before = (tiny.results / "surfaces/5_T1.h5").read_bytes()
    written = log_dates(tiny)
    result = tiny.run()
    assert result.returncode == 0, result.stderr
    ran = {rule for rule, date in log_dates(tiny) - written}
    assert {"prepare_t1_scans", "register_patches"} <= ran
    # patch 5 is not in the study
    assert ran.isdisjoint({"prepare_t0_scans", "solve_patch", "score_patches", "plot_patches"})
    assert (tiny.results / "surfaces/5_T1.h5").read_bytes() != before


@pytest.mark.parametrize(
    ("change", "reruns"),
    [
        ({"grinding": {"friction": 0.5, "tangential_ratio": 0.5}}, {"solve_slip", "plot_slip"}),
        ({"hardness": 900.0}, {"solve_hardness", "plot_hardness"}),
    ],
)
def test_a_changed_case_reruns_that_case_alone(tiny, change, reruns):
    tiny.change(**change)
    assert tiny.planned() == reruns | {"record_provenance"}


def test_cases_that_are_not_asked_for_are_not_made(tiny):
    for case in ("slip", "hardness"):
        shutil.rmtree(tiny.results / case)
        for file in tiny.results.glob(f"*/{case}.*"):
            file.unlink()
    tiny.change(grinding=None, hardness=None)
    assert tiny.planned() == {"record_provenance"}


def test_a_hardness_that_a_patch_cannot_bear_ends_before_the_patches(tiny):
    """Patch 10 carries 58 MPa; its poor overlap is let pass."""
    shutil.rmtree(tiny.results / "microscale")
    tiny.change(hardness=30.0, selection={"minimum_correlation": -1.0, "minimum_overlap": 0.1})
    result = tiny.run()
    said = result.stdout + result.stderr
    assert result.returncode != 0
    for word in ("changed.yaml", "'hardness' is 30 MPa", "patch 10 (58 MPa)", "set it to null"):
        assert word in said, said
    assert not (tiny.results / "microscale").exists()


def test_a_changed_outlier_share_reruns_from_the_preparation_on(tiny):
    tiny.change(preprocessing={"outlier_share": 0.004})
    planned = tiny.planned()
    assert {"prepare_t0_scans", "register_patches", "tabulate_preprocessing"} <= planned
    assert planned.isdisjoint({"generate_specimen", "grid_macroscale", "solve_macroscale"})


@pytest.mark.parametrize(
    ("module", "reruns", "stays"),
    [
        ("coupling.py", {"couple_scales"}, {"solve_macroscale", "grid_macroscale"}),
        ("bem/halfspace.py", {"solve_macroscale"}, {"grid_macroscale", "generate_specimen"}),
        ("validation/change.py", {"register_patches"}, {"prepare_t0_scans", "prepare_t1_scans"}),
        ("hardness.py", {"solve_hardness"}, {"solve_patch", "solve_slip"}),
        ("preprocess/gridding.py", {"grid_macroscale"}, {"generate_specimen", "prepare_t0_scans"}),
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


def test_one_core_of_an_older_processor_gives_the_same_tables_as_two(finished_tiny, tmp_path):
    """Its sums and functions differ in their last bits; the generated files do not, nor tables."""
    single = fresh(tmp_path / "single")
    single.environment = older_processor()
    result = single.run(cores=1)
    assert result.returncode == 0, result.stderr
    specimen = [study.results / "specimen" for study in (single, finished_tiny)]
    for file in ("mesh.stl", "scans/7_T0.plu", "scans/7_T1.plu"):
        assert (specimen[0] / file).read_bytes() == (specimen[1] / file).read_bytes(), file
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
    fields = sorted(finished_tiny.results.rglob("*.h5"))
    assert len(fields) > 20
    for file in fields:
        same = study.results / file.relative_to(finished_tiny.results)
        assert same.read_bytes() == file.read_bytes(), file


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
        "gridding.csv",
        "hardness.csv",
        "inputs.csv",
        "macroscale_path.csv",
        "microscale_paths.csv",
        "microscale_summary.csv",
        "outliers.csv",
        "patch_intervals.csv",
        "patch_pressures.csv",
        "placement.csv",
        "preprocessing.csv",
        "published.csv",
        "sensitivity.csv",
        "slip.csv",
        "texture.csv",
    }
    published = read_table(measured.results / "tables/published.csv").set_index("quantity")
    assert published.computed["mean pressure"] == pytest.approx(22, rel=1e-3)
    pressures = read_table(measured.results / "tables/patch_pressures.csv").set_index("patch")
    assert published.computed["patch pressure"] == pressures.pressure_MPa["13"]
    # a patch with a poor T0/T1 overlap counts when there is no T1
    assert not pressures.reason.fillna("").str.contains("overlap").any()
    assert (measured.results / "figures/overview.png").stat().st_size > 0
    result = measured.run("--report", str(measured.folder / "report.html"))
    assert result.returncode == 0, result.stderr
    text = (measured.folder / "report.html").read_text(encoding="utf-8")
    assert "the prediction is not compared with wear" in text
    assert "between T0 and T1" not in text


def test_a_rough_counterface(tiny):
    """One of the specimen's own scans: the microscale follows, all before it stays."""
    tiny.change(counterface={"scan": "results-tiny/specimen/scans/5_T0.plu"})
    planned = tiny.planned()
    assert {"prepare_counterface", "solve_patch", "solve_slip", "solve_hardness"} <= planned
    assert planned.isdisjoint({"prepare_t0_scans", "solve_macroscale", "couple_scales"})
    flat = tiny.tables()
    result = tiny.run()
    assert result.returncode == 0, result.stderr
    assert tiny.tables()["microscale_summary.csv"] != flat["microscale_summary.csv"]
    face = read_dataset(tiny.results / "surfaces/5_T0.h5").height.values[:, ::-1]
    for file in sorted(tiny.results.glob("microscale/*.h5")):
        contact = read_dataset(file)
        np.testing.assert_array_equal(contact.counterface, face)
        spacing, modulus = spacing_of(contact), contact.attrs["contact_modulus_MPa"]
        both = contact.height.values + face
        residual = recomputed_residual(
            both, contact.pressure.values, float(contact.displacement[-1]), spacing, modulus
        )
        assert residual <= 1e-6
        slip = read_dataset(tiny.results / "slip" / file.name)
        np.testing.assert_array_equal(slip.stick | slip.slip, contact.pressure > 0)
        limited = read_dataset(tiny.results / "hardness" / file.name)
        at_ceiling = limited.pressure.values >= limited.attrs["hardness_MPa"]
        gap = love_displacement(limited.pressure.values, spacing, modulus) - (
            float(limited.displacement) - (both.max() - both)
        )
        below = (limited.pressure.values > 0) & ~at_ceiling
        assert np.abs(gap[below]).max() <= 1e-6 * float(limited.displacement)


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
