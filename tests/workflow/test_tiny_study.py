"""The whole of a study on coarse grids: what its files hold, by other means than the study's own.

Formulas are tested with the library; here the calls between them are, in scripts and rules.
"""

import json
import runpy

import numpy as np
import pandas as pd
import pytest
import scipy.ndimage
import scipy.optimize
import yaml
from conftest import ROOT
from gst.figures.style import BLUE
from gstlib.contact import Loading, contact_at_pressure, faces_of
from gstlib.io.results import TABLES, columns_of
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.preprocess.filtering import s_filtered
from gstlib.specimen.score import true_face
from gstlib.surface import spacing_of
from matplotlib.colors import to_rgb

# Of the tables listed, those that this study has no use for.
ABSENT = {"exposure", "places", "published", "sweep"}


@pytest.fixture(scope="module")
def results(finished_tiny):
    return finished_tiny.results


@pytest.fixture(scope="module")
def table(results):
    return lambda name: read_table(results / f"tables/{name}.csv")


@pytest.fixture(scope="module")
def truth(results):
    return read_dataset(results / "specimen/truth.h5")


@pytest.fixture(scope="module")
def config(finished_tiny):
    """What the study was asked for, as the shipped files state it."""
    whole = yaml.safe_load((finished_tiny.folder / "config/config.yaml").read_text())
    own = yaml.safe_load((finished_tiny.folder / "config/tiny.yaml").read_text())
    for name, value in own.items():
        whole[name] = whole[name] | value if isinstance(value, dict) else value
    return whole


def contact_of(results, patch):
    return read_dataset(results / f"microscale/{patch}.h5")


def change_of(results, patch):
    return read_dataset(results / f"registered/{patch}.h5")


# --- Tables -----------------------------------------------------------------------------------


def test_every_table_is_there_with_its_columns_and_no_other(results):
    files = {file.relative_to(results).as_posix(): file for file in results.rglob("*.csv")}
    listed = {f"{one.folder}/{name}.csv": name for name, one in TABLES.items()}
    assert set(files) == {file for file, name in listed.items() if name not in ABSENT}
    for file in files:
        rows = read_table(files[file])
        assert len(rows), file
        optional = TABLES[listed[file]].optional
        columns = [one for one in columns_of(listed[file]) if one in rows or one not in optional]
        assert list(rows.columns) == columns


def test_intermediates_carry_units_names_and_provenance(results):
    files = [file for file in results.rglob("*.h5") if "specimen" not in file.parts]
    assert len(files) > 20
    for file in files:
        dataset = read_dataset(file)
        for variable in dataset.data_vars.values():
            assert variable.attrs["units"]
            assert variable.attrs["long_name"]
        digests = json.loads(dataset.attrs["input_sha256"])
        assert digests
        assert all(len(digest) == 64 for digest in digests.values())


def test_every_step_has_the_settings_of_the_config(results, config):
    """As the files record them, by the folder of the file, for some are called alike."""
    placed = {"s_filter_um": config["microscale"]["s_filter_um"], "seed": config["seed"]}
    press = {"contact_modulus_MPa": config["material"]["contact_modulus_MPa"]}
    named = {
        "macroscale/surface": {**config["square"], "grid": 40, "face_mm": 10.0, "radius_mm": 200.0},
        "macroscale/composite": placed | {"placement_um": config["uncertainty"]["placement_um"]},
        "macroscale/contact": press | {"steps": 6},
        "microscale/13": press | config["microscale"],
        "registered/13": {
            "maximum_shift_mm": config["registration"]["maximum_shift_mm"],
            "minimum_points": config["traces"]["minimum_points"],
        },
        "surfaces/13_T1": {"scans": config["scans"], "preprocessing": config["preprocessing"]},
        "wear/13": {"steps": 4, "mat": None, "hardness_MPa": 800.0, "patch_mm": 0.85},
        "reference/patches": placed,
    }
    for name, expected in named.items():
        settings = json.loads(read_dataset(results / f"{name}.h5").attrs["settings"])
        assert {key: settings.get(key, "lost") for key in expected} == expected, name


def test_the_record_holds_the_whole_config(results, config):
    assert json.loads((results / "provenance.json").read_text())["config"] == config


def test_every_figure_is_a_picture_of_something(results):
    from matplotlib.image import imread

    figures = sorted(results.glob("figures/**/*.png"))
    assert len(figures) > 12
    for file in figures:
        picture = imread(file)
        assert min(picture.shape[:2]) > 100, file
        assert picture[..., :3].std() > 0.01, file
        # at the lower right it says that the specimen is generated
        note = picture[-picture.shape[0] // 20 :, -picture.shape[1] // 4 :, :3]
        assert note.min() < 0.8, file


def test_the_report_holds_every_figure_and_caption(finished_tiny, tmp_path):
    report = tmp_path / "report.html"
    finished_tiny.succeed("--report", str(report))
    text = report.read_text(encoding="utf-8")
    for figure in finished_tiny.results.glob("figures/**/*.png"):
        assert str(figure.relative_to(finished_tiny.folder)) in text
    assert "{{" not in text.split("<script")[0]
    assert "bears the highest pressure" in text


# --- Inputs and preparation -------------------------------------------------------------------


def measured_heights(file):
    """Heights (µm) of a .plu file, read anew for this test; NaN where unmeasured."""
    content = file.read_bytes()
    rows, columns = np.frombuffer(content, "<u4", 2, 500)
    heights = np.frombuffer(content, "<f4", rows * columns, 508).reshape(rows, columns)
    return np.where(np.abs(heights) < 1e4, heights, np.nan).astype(float)


def levelled(heights):
    """Without the least-squares plane; NaN stays unknown."""
    y, x = np.indices(heights.shape)
    design = np.stack([np.ones(heights.size), y.ravel(), x.ravel()], axis=1)
    known = np.isfinite(heights.ravel())
    plane = np.linalg.lstsq(design[known], heights.ravel()[known], rcond=None)[0]
    return heights - (design @ plane).reshape(heights.shape)


def correlation(first, second):
    known = np.isfinite(first) & np.isfinite(second)
    return np.corrcoef(first[known], second[known])[0, 1]


def test_inputs_are_told_as_they_are(results, table, config):
    rows = table("inputs")
    assert len(rows) == 12
    for row in rows.itertuples():
        heights = measured_heights(results / "specimen/scans" / f"{row.patch}_{row.epoch}.plu")
        assert (row.points_y, row.points_x) == heights.shape
        assert row.spacing_x_um == pytest.approx(config["specimen"]["scan_spacing_um"])
        assert row.unmeasured == pytest.approx(np.isnan(heights).mean(), rel=1e-4)
        assert row.Sq_um == pytest.approx(np.nanstd(levelled(heights)), rel=1e-3)


def in_square(field):
    """The part of a field of the face (10 mm) that lies in the square: its middle 40 elements."""
    assert field.shape[-2:] == (80, 80)
    return field[..., 20:60, 20:60]


def test_the_face_is_that_of_the_stone(results, truth):
    surface = read_dataset(results / "macroscale/surface.h5").height
    np.testing.assert_allclose(surface.x[[0, -1]], [-2.5 + 0.0625, 7.5 - 0.0625])
    square = in_square(surface)
    assert float(square.x[-1] + square.x[0]) == pytest.approx(5.0)
    true = levelled(truth.macroscale_height.values)
    assert correlation(true, square.values) > 0.97
    assert np.abs(levelled(square.values) - square.values).max() < 1e-9
    # the whole of it: truth has waves that no mesh shows
    assert truth.face_height.shape == surface.shape
    assert correlation(levelled(truth.face_height.values), levelled(surface.values)) > 0.85
    np.testing.assert_allclose(truth.face_x, surface.x)


@pytest.mark.parametrize("epoch", ["T0", "T1"])
def test_prepared_scans_are_the_stone_not_its_mould(results, truth, epoch):
    """Heights up and unmirrored: the mould is undone."""
    for patch in truth.patch.values.astype(str):
        at = truth.sel(patch=patch)
        surface = read_dataset(results / f"surfaces/{patch}_{epoch}.h5")
        if epoch == "T0":
            assert correlation(at.height.values, surface.height.values) > 0.99
        else:
            raw = measured_heights(results / f"specimen/scans/{patch}_T1.plu")
            assert correlation(levelled(-raw[:, ::-1]), surface.height.values) > 0.8
        assert np.isfinite(surface.height).all()
        filled = surface.filled.values.astype(bool)
        assert (filled == at.sel(epoch=epoch).unmeasured.values).all()


def test_preparation_is_counted(results, table):
    rows = table("preprocessing")
    assert len(rows) == 12
    for row in rows.itertuples():
        surface = read_dataset(results / f"surfaces/{row.patch}_{row.epoch}.h5")
        raw = measured_heights(results / f"specimen/scans/{row.patch}_{row.epoch}.plu")
        assert row.unmeasured == row.filled == np.isnan(raw).sum()
        assert row.outliers == surface.outlier.values.sum() > 0
        assert row.Sq_before_um == pytest.approx(np.nanstd(raw), rel=1e-4)
        assert row.Sq_after_um == pytest.approx(surface.height.values.std() * 1e3, rel=1e-4)


# --- From the square to its patches -----------------------------------------------------------


def force_on(contact):
    """Of a contact, in N."""
    dy, dx = spacing_of(contact)
    return float(contact.pressure.sum()) * dy * dx


def force_share(pressure, x, y, size, fine=20):
    """Mean pressure under a square outline: elements cut into small pieces, each in or out."""
    dy, dx = spacing_of(pressure)
    step_y, step_x = dy / fine, dx / fine
    ny, nx = pressure.shape
    at_y, at_x = (np.arange(ny * fine) + 0.5) * step_y, (np.arange(nx * fine) + 0.5) * step_x
    inside = (np.abs(at_y[:, None] - y) < size / 2) & (np.abs(at_x - x) < size / 2)
    pieces = np.repeat(np.repeat(pressure.values, fine, 0), fine, 1)
    return pieces[inside].sum() * step_y * step_x / size**2


def test_patch_pressures_are_the_forces_of_the_last_step(results, table, config):
    contact = read_dataset(results / "macroscale/contact.h5")
    last = contact.pressure
    assert force_on(contact) == pytest.approx(config["load"]["force_N"], rel=1e-6)
    for axis in "yx":  # through the middle of the square
        assert float((last * contact[axis]).sum() / last.sum()) == pytest.approx(2.5, abs=1e-5)
    # beside it, the square alone, on its mean plane and under a flat
    alone = faces_of(in_square(read_dataset(results / "macroscale/surface.h5").height))
    loading = Loading(float(contact.contact_modulus), config["load"]["force_N"] / 25, 1e-9)
    square = contact_at_pressure(alone, loading, source="square")
    assert square.pressure.shape == (40, 40)
    rows = table("patch_pressures")
    places = pd.read_csv(results.parent / config["patches"], sep="\t", comment="#", dtype=str)
    assert list(rows.patch) == list(places.patch)
    np.testing.assert_allclose(rows[["x_mm", "y_mm"]], places[["x_mm", "y_mm"]].astype(float))
    for row in rows.itertuples():
        for field, pressure in (
            (in_square(last), row.pressure_MPa),
            (square.pressure, row.square_pressure_MPa),
        ):
            by_pieces = force_share(field, row.x_mm, row.y_mm, config["scans"]["size_mm"])
            assert pressure == pytest.approx(by_pieces, rel=1e-4, abs=1e-6)
    assert (rows.pressure_MPa == 0).any()
    assert rows.pressure_MPa.max() > 20


def test_selection_follows_its_rules(table, config):
    rules, rows = config["selection"], table("patch_pressures")
    quality = table("registration").set_index("patch")
    for row in rows.itertuples():
        of = quality.loc[row.patch]
        fits = (
            row.pressure_MPa >= rules["minimum_pressure_MPa"]
            and of.overlap >= rules["minimum_overlap"]
            and of.detail_correlation >= rules["minimum_correlation"]
        )
        assert row.in_study == fits, row
        assert isinstance(row.reason, str) != row.in_study
    assert set(rows.in_study) == {True, False}


def test_both_contact_moduli_are_solved(table, config):
    """At a given pressure the stiffer stone yields less."""
    rows = table("cases").set_index(["case", "quantity"]).sort_index()
    own, other = (rows.loc[case].query("patch.isna()").value for case in ("study", "other modulus"))
    material = config["material"]
    assert own["contact modulus"] == material["contact_modulus_MPa"]
    young, poisson = material["young_1_MPa"], material["poisson_1"]
    assert other["contact modulus"] == pytest.approx(young / 2 / (1 - poisson**2), rel=1e-4)
    path = table("macroscale_path").iloc[-1]
    assert own["displacement"] == pytest.approx(path.displacement_um, rel=1e-4)
    assert own["contact fraction"] == pytest.approx(path.contact_fraction, rel=1e-4)
    assert other["displacement"] > 1.02 * own["displacement"]
    assert other["contact fraction"] > own["contact fraction"]
    pressures = table("patch_pressures")
    for case, differs in (("study", False), ("other modulus", True)):
        by_patch = rows.loc[case, "patch pressure"].set_index("patch").value[pressures.patch]
        misfit = abs(by_patch.to_numpy() - pressures.pressure_MPa).max()
        assert (misfit > 0.1) == differs


# --- Contacts ---------------------------------------------------------------------------------


def test_load_paths_end_at_their_targets(results, table, config):
    path = table("macroscale_path")
    assert len(path) == config["macroscale"]["steps"]
    assert path.force_N.iloc[-1] == pytest.approx(config["load"]["force_N"], rel=1e-4)
    np.testing.assert_allclose(path.mean_pressure_MPa, path.force_N / 10.0**2, rtol=1e-3)
    summary, paths = table("microscale_summary"), table("microscale_paths")
    pressures = table("patch_pressures")
    studied = pressures[pressures.in_study].set_index("patch").pressure_MPa
    assert list(summary.patch) == list(studied.index)
    np.testing.assert_allclose(summary.target_pressure_MPa, studied, rtol=1e-4)
    np.testing.assert_allclose(summary.mean_pressure_MPa, studied, rtol=1e-4)
    assert (summary.residual <= 1e-6).all()
    for row in summary.itertuples():
        steps = paths[paths.patch == row.patch]
        assert list(steps.step) == list(range(1, config["microscale"]["steps"] + 1))
        for name in ("displacement_um", "stiffness_MPa_per_um"):
            assert steps[name].iloc[-1] == getattr(row, name)


def test_every_patch_is_solved_at_its_own_pressure(results, table, config):
    for row in table("patch_pressures").itertuples():
        contact = contact_of(results, row.patch)
        assert float(contact.pressure.mean()) == pytest.approx(row.pressure_MPa, rel=1e-4)
        assert contact.contact_modulus == config["material"]["contact_modulus_MPa"]
        surface = read_dataset(results / f"surfaces/{row.patch}_T0.h5")
        pressed = s_filtered(surface.height, config["microscale"]["s_filter_um"])
        np.testing.assert_array_equal(contact.height, pressed)
        if row.pressure_MPa == 0:
            assert not contact.pressure.any()


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


def laid_heights(contact):
    """Heights on the plane that the file states, with those of what is over them."""
    y, x = (contact[axis].values - contact[axis].values.mean() for axis in "yx")
    slope_y, slope_x = (float(contact[f"slope_{axis}"]) for axis in "yx")
    lies = contact.height.values + slope_y * y[:, None] + slope_x * x
    return lies + contact.counterface.values


def pressed_heights(contact):
    return laid_heights(contact) - contact.surroundings.values


def test_patches_lie_on_the_mesh_and_sink_with_their_surroundings(results, table):
    """The plane is that of the mesh under the outline, tilted as the stone is at rest; far forces
    sink a patch as Love says; and the round stone is over it."""
    mesh = read_dataset(results / "macroscale/surface.h5").height
    square = read_dataset(results / "macroscale/contact.h5")
    pressures = table("patch_pressures").set_index("patch")
    intervals = table("patch_intervals").set_index("patch")
    modulus = float(square.contact_modulus)
    on_mesh = 0
    for file in sorted(results.glob("microscale/*.h5")):
        contact, row = read_dataset(file), pressures.loc[file.stem]
        half = contact.sizes["x"] * spacing_of(contact)[1] / 2
        slopes = contact.slope_y, contact.slope_x
        at_rest = [float(square[f"slope_{axis}"]) for axis in "yx"]
        assert np.hypot(*at_rest) > 1e-4
        slopes = np.subtract(slopes, at_rest)  # no patch is turned
        y, x = (row[f"{axis}_mm"] - half + contact[axis].values - 2.5 for axis in "yx")
        over = -(y[:, None] ** 2 + x**2) / (2 * 200.0)
        np.testing.assert_allclose(contact.counterface, over, atol=2e-6)
        if intervals.plane[file.stem] == "levelled":
            np.testing.assert_allclose(slopes, 0, atol=1e-12)
        else:
            at = ((np.arange(40) + 0.5) / 20 - 1) * half
            under = mesh.interp(y=row.y_mm + at, x=row.x_mm + at, method="cubic")
            off_plane = under.values - levelled(under.values)
            fitted = [np.diff(off_plane, axis=axis).mean() / (at[1] - at[0]) for axis in (0, 1)]
            np.testing.assert_allclose(slopes, fitted, atol=1e-4)
            on_mesh += 1
        element = spacing_of(mesh)[1]
        reach = [half - abs(mesh[axis].values - row[f"{axis}_mm"]) for axis in "yx"]
        shares = [np.clip(of / element + 0.5, 0, 1) for of in reach]
        outside = square.pressure.values * (1 - np.outer(*shares))
        sunk = love_displacement(outside, spacing_of(mesh), modulus)
        middle = contact.surroundings.values[28:36, 28:36].mean()
        at = (abs(mesh.y - row.y_mm) < 0.1) & (abs(mesh.x - row.x_mm) < 0.1)
        assert middle == pytest.approx(sunk[at.values].mean(), rel=0.05)
    assert on_mesh > 2


def test_the_whole_square_lies_in_the_true_face_at_rest(results, table, truth, config):
    """Its force is its share of the load; it lies as the stone does, among what presses around."""
    whole = read_dataset(results / "reference/contact.h5")
    pressure = whole.pressure.values.astype(float)
    modulus = config["material"]["contact_modulus_MPa"]
    level = levelled(read_dataset(results / "specimen/surface.h5").height.values.astype(float))
    np.testing.assert_allclose(whole.height, level, atol=1e-6)
    faces = faces_of(true_face(truth), read_dataset(results / "macroscale/surface.h5").counterface)
    loading = Loading.by_force(
        config["load"]["force_N"],
        (2.5, 2.5),
        faces.height,
        contact_modulus_MPa=modulus,
        tolerance=1e-9,
    )
    face = contact_at_pressure(faces, loading, source="truth")
    share = float(in_square(face.pressure).sum() / face.pressure.sum())
    assert 0.5 < share <= 1
    assert force_on(whole) == pytest.approx(share * config["load"]["force_N"], rel=0.01)
    # where it lies: on its own plane in the face, tilted, below the round stone
    surface = read_dataset(results / "specimen/surface.h5").height
    y, x = surface.y.values[:, None], surface.x.values
    slopes = float(face.slope_y), float(face.slope_x)
    lies = surface.values + slopes[0] * y + slopes[1] * x
    lies = lies - ((y - 2.5) ** 2 + (x - 2.5) ** 2) / (2 * 200.0)
    outside = face.pressure.copy()
    outside[20:60, 20:60] = 0
    around = outside.copy(data=love_displacement(outside.values, (0.125, 0.125), modulus))
    lies = lies - around.interp(y=surface.y, x=surface.x, method="cubic").values
    gap = love_displacement(pressure, spacing_of(whole), modulus) - lies
    touching = pressure > 0
    reach = (lies.max() - lies[touching].min()) + np.ptp(gap + lies)
    assert np.ptp(gap[touching]) < 2e-3 * reach
    assert gap[~touching].min() > gap[touching].min() - 2e-3 * reach


def test_scales_are_compared_where_the_scans_truly_lie(results, table, truth):
    rows = table("two_scales").set_index(["patch", "variant"])
    whole = read_dataset(results / "reference/contact.h5").pressure
    count = truth.sizes["x"]
    total = dict.fromkeys(("levelled", "placed"), 0)
    for patch in table("patch_pressures").patch:
        at = truth.sel(patch=patch, epoch="T0")
        turn = np.radians(float(at.rotation_deg))
        v, u = np.meshgrid(*2 * [truth.x.values - truth.x.values.mean()], indexing="ij")
        y = float(at.y_mm) + np.cos(turn) * v + np.sin(turn) * u
        x = float(at.x_mm) + np.cos(turn) * u - np.sin(turn) * v
        near = whole.interp(y=("p", y.ravel()), x=("p", x.ravel()), method="nearest")
        pressure = near.values.reshape(count, count)
        reference = rows.reference_pressure_MPa[patch, "placed"]
        assert reference == pytest.approx(np.nanmean(pressure), rel=1e-3, abs=1e-6)
        for variant, folder in (("placed", ""), ("levelled", "levelled/")):
            contact = read_dataset(results / f"microscale/{folder}{patch}.h5")
            found, true = (field > 0 for field in (contact.pressure.values, pressure))
            row = rows.loc[patch, variant]
            assert row.contact_fraction == pytest.approx(found.mean(), abs=1e-6)
            assert row.reference_contact_fraction == pytest.approx(true.mean(), abs=1e-6)
            counts = np.array([2 * (found & true).sum(), found.sum() + true.sum()])
            if found.any() and true.any():
                assert row.f1 == pytest.approx(counts[0] / counts[1], abs=1e-4)
            total[variant] = total[variant] + counts
    for variant, (hits, marked) in total.items():
        assert rows.f1["all", variant] == pytest.approx(hits / marked, abs=1e-4)


def test_every_stored_state_fulfils_the_contact_conditions(results):
    files = [results / "macroscale/contact.h5"]
    files += sorted(results.glob("microscale/*.h5"))
    assert len(files) > 2
    for file in files:
        contact = read_dataset(file)
        states = [(contact.pressure.values, float(contact.displacement))]
        if "path_pressure" in contact:  # of the square every step is kept
            along = contact.path_pressure.values, contact.path_displacement.values
            states += zip(*along, strict=True)
        for field, delta in states:
            if not field.any():  # a patch without pressure
                assert delta == 0
                continue
            residual = recomputed_residual(
                pressed_heights(contact),
                field,
                delta,
                spacing_of(contact),
                float(contact.contact_modulus),
            )
            assert residual <= 1e-6, file


def test_slip_and_ceiling_are_those_of_the_stored_contacts(results, table, config):
    """That they obey Coulomb and the ceiling: tests/library/test_cases.py."""
    cases = table("cases")
    rows = cases.set_index(["case", "quantity"]).sort_index()
    settings = {
        ("grinding", "friction"): config["grinding"]["friction"],
        ("grinding", "tangential ratio"): config["grinding"]["tangential_ratio"],
        ("ceiling", "hardness"): config["hardness"],
    }
    assert {key: rows.value[key].item() for key in settings} == settings
    rows = cases.set_index(["patch", "case", "quantity"]).value
    pressures = table("patch_pressures")
    studied = list(pressures.patch[pressures.in_study])
    of_patches = cases[cases.case.isin(["grinding", "ceiling"])].patch.dropna()
    assert of_patches.unique().tolist() == studied
    for patch in studied:
        contact, row = contact_of(results, patch), rows[patch]
        pressure = contact.pressure.values
        share = np.prod([*config["grinding"].values()])
        assert row["grinding", "mean traction"] == pytest.approx(share * pressure.mean(), 1e-4)
        assert 0.3 < row["grinding", "slip share"] < 0.7  # half of the sliding force
        assert row["study", "peak pressure"] == pytest.approx(pressure.max(), 1e-4)
        assert row["study", "contact fraction"] == pytest.approx((pressure > 0).mean(), 1e-4)
        assert pressure.max() > config["hardness"]
        ceiling, study = row["ceiling"], row["study"]
        assert ceiling["contact fraction"] >= study["contact fraction"]
        assert ceiling["displacement"] > study["displacement"]
        assert 0 < ceiling["share at the ceiling"] < 1
        # what both touch is at most all that one touches
        assert ceiling["iou"] <= study["contact fraction"] / ceiling["contact fraction"] + 1e-4


# --- Wear and scores --------------------------------------------------------------------------


def test_t1_is_laid_where_it_truly_lies_and_differs(results, table, truth):
    rows = table("registration").set_index("patch")
    for patch in truth.patch.values.astype(str):
        at, change = truth.sel(patch=patch), change_of(results, patch)
        row = rows.loc[patch]
        if not row.found:
            continue
        t0, t1 = at.sel(epoch="T0"), at.sel(epoch="T1")
        turn = np.deg2rad(float(t0.rotation_deg))
        dx, dy = float(t1.x_mm - t0.x_mm) * 1e3, float(t1.y_mm - t0.y_mm) * 1e3
        shift = np.cos(turn) * dx + np.sin(turn) * dy, np.cos(turn) * dy - np.sin(turn) * dx
        assert np.hypot(row.shift_x_um - shift[0], row.shift_y_um - shift[1]) < 13.28
        surface = read_dataset(results / f"surfaces/{patch}_T0.h5").height.values
        known = np.isfinite(change.change.values)
        difference = (change.t1.values - surface)[known]
        np.testing.assert_allclose(difference, change["change"].values[known], atol=1e-9)
        assert row.known_share == pytest.approx(known.mean(), rel=1e-4)
        # what was lost is what was worn: deeper where the truth is
        depth = at.wear_depth.values[known]
        lost = change.loss.values.astype(bool)[known]
        if lost.any():
            assert depth[lost].mean() > 2 * depth[~lost].mean()
            volume = -change["change"].values[known][lost].sum() * 13.28**2 * 1e3
            assert row.loss_volume_um3 == pytest.approx(volume, rel=1e-3)


def judged(results, patch):
    """Of the known points of a patch: predicted and lost depth, level of detection (mm), loss."""
    change, worn = change_of(results, patch), read_dataset(results / f"wear/{patch}.h5")
    known = np.isfinite(change["change"].values)
    depth = worn.depth.sel(model="archard").values[known]
    lost = -change["change"].values[known]
    limit, loss = (change[name].values[known] for name in ("level_of_detection", "loss"))
    return depth - np.median(depth), lost, limit, loss.astype(bool)


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def test_every_patch_with_a_known_change_is_judged(results, table):
    rows, losses = table("validation_patches"), table("registration").set_index("patch")
    pressures = table("patch_pressures").set_index("patch")
    assert list(rows.patch) == list(losses.index[losses.known_share > 0])
    assert set(rows.counted) == {True, False}
    for row in rows.itertuples():
        registered = losses.loc[row.patch]
        assert row.counted == (registered.believed and pressures.in_study[row.patch])
        assert (row.untested == "noise") == (not registered.believed)
        contact = contact_of(results, row.patch)
        assert row.contact_fraction == pytest.approx((contact.pressure.values > 0).mean(), rel=1e-4)
        seen, lost, limit, loss = judged(results, row.patch)
        assert registered.loss_fraction == pytest.approx(loss.mean(), rel=1e-4)
        assert row.predicted_loss_um == pytest.approx(1e3 * seen.clip(0).mean(), rel=1e-4)
        assert row.map_error == pytest.approx(rms(seen - lost) / rms(lost), rel=1e-4)
        mask = seen > limit
        if not mask.any():
            assert row.mcc == row.attainable_mcc == 0
            continue
        # Matthews' coefficient is the correlation of the two masks
        assert row.mcc == pytest.approx(np.corrcoef(mask, loss)[0, 1], rel=1e-4)
        best = np.argsort(~loss, kind="stable")[: mask.sum()]
        filled = np.isin(np.arange(loss.size), best)
        assert row.attainable_mcc == pytest.approx(np.corrcoef(filled, loss)[0, 1], rel=1e-4)


def test_a_rival_knows_what_the_others_lost(results, table):
    """A plane that cuts off their mean volume, found here by bisection."""
    rows, losses = table("validation_patches"), table("registration").set_index("patch")
    fitted = rows.patch[rows.counted]
    for row in rows.itertuples():
        _, _, limit, loss = judged(results, row.patch)
        known = np.isfinite(change_of(results, row.patch)["change"].values)
        heights = laid_heights(contact_of(results, row.patch))[known]
        others = losses.loss_per_area_um[fitted[fitted != row.patch]].mean() * 1e-3
        plane = scipy.optimize.brentq(
            lambda plane, of=heights, volume=others: np.maximum(of - plane, 0).mean() - volume,
            heights.min(),
            heights.max(),
        )
        mask = heights - plane > limit
        found = np.corrcoef(mask, loss)[0, 1]
        assert row.mean_volume_mcc == pytest.approx(found, rel=1e-3, abs=1e-4)


def test_a_patch_wears_as_the_others_say_and_where_it_touches(results, table, config):
    rows, square = table("wear"), read_dataset(results / "wear/whole_square.h5")
    patches, losses = (
        table(name).set_index("patch") for name in ("validation_patches", "registration")
    )
    fitted = list(patches.index[patches.counted])
    assert list(rows.patch.unique()) == list(patches.index)
    assert square.sizes["step"] == config["wear_steps"] + 1
    pressures = table("patch_pressures").set_index("patch").pressure_MPa
    loss = square.pressed.sel(ratio=0, body="stone")
    first = loss[1].to_series()[pressures.index]  # the hardest pressed lose most
    assert first.corr(pressures) > 0.99
    assert (first[pressures == 0] < 0.05 * first.max()).all()
    for patch in patches.index:
        kappa, others = float(square.fitted.sel(patch=patch)), [p for p in fitted if p != patch]

        def lost(of, kappa=kappa):
            return np.interp(kappa, square.kappa[0].values, loss.sel(patch=of).values)

        theirs = sum(map(lost, others))
        assert theirs == pytest.approx(1e-3 * losses.loss_per_area_um[others].sum(), rel=1e-4)
        worn, contact = read_dataset(results / f"wear/{patch}.h5"), contact_of(results, patch)
        depth = worn.depth.sel(model="archard").values
        assert depth.mean() == pytest.approx(lost(patch), rel=1e-6)
        assert depth.min() == 0
        if contact.pressure.values.any():
            assert (depth[contact.pressure.values > 0] > 0).mean() > 0.9
        seen, measured, _, _ = judged(results, patch)
        row = rows.set_index(["patch", "model"]).loc[patch, "archard"]
        element = np.prod(spacing_of(contact)) * 1e9
        volume = seen.clip(0).sum() * element
        assert row.predicted_volume_um3 == pytest.approx(volume, rel=1e-4)
        assert row.measured_volume_um3 == pytest.approx(losses.loss_volume_um3[patch], rel=1e-4)
        assert row.map_error_um == pytest.approx(1e3 * rms(seen - measured), rel=1e-4)
        bands = table("wear_profile").set_index(["patch", "by", "band", "model"]).loss_um[patch]
        gaps = bands["gap"].xs("archard", level="model")
        assert gaps[1] >= 0.9 * gaps.sum()  # from the contact on
        assert gaps.mean() == pytest.approx(1e3 * seen.clip(0).mean(), rel=1e-3)


def test_the_summary_is_that_of_the_counted_patches(table):
    patches, wear = table("validation_patches"), table("wear")
    rows = table("validation_summary").set_index(["model", "statistic"])
    counted = wear[wear.patch.isin(patches.patch[patches.counted])]
    for model, of in counted.groupby("model"):
        assert rows.value[model, "mean(mcc)"] == pytest.approx(of.mcc.mean(), rel=1e-3, abs=1e-4)
    gain = rows.loc[("archard", "gain(mcc)")]
    rivals = set(rows.index.unique("model").dropna())
    rivals -= {"archard", "yielding", "own_area", "none"}
    means = rows.value.xs("mean(mcc)", level="statistic")
    assert gain.against == means[list(rivals)].idxmax()
    assert gain.value == pytest.approx(means["archard"] - means[gain.against], rel=1e-3)


def test_texture_is_that_of_the_filtered_heights(results, table, config):
    rows = table("texture")
    settings = config["texture"]
    whole = rows[(rows.epoch == "T0")].set_index("patch")
    assert set(whole.index) == set(table("patch_pressures").patch)
    registration = table("registration")
    changed = set(rows.patch[rows.epoch == "change"])
    assert changed == set(registration.patch[registration.found])
    # without the waves that the filters take out, by a filter of our own
    surface = read_dataset(results / "surfaces/5_T0.h5").height
    step_um = spacing_of(surface)[0] * 1e3
    sigma = np.sqrt(np.log(2) / 2) / np.pi / step_um
    smooth = scipy.ndimage.gaussian_filter(surface.values, settings["s_filter_um"] * sigma)
    rough = smooth - scipy.ndimage.gaussian_filter(smooth, settings["l_filter_um"] * sigma)
    assert whole.Sq_um["5"] == pytest.approx(rough.std() * 1e3, rel=0.15)


def test_every_stage_is_scored_against_the_truth(table):
    rows = table("truth")
    stages = {"macroscale", "preprocessing", "placement", "coupling", "registration", "wear"}
    assert stages <= set(rows.stage)
    np.testing.assert_allclose(
        rows.error, rows.recovered - rows.true, atol=1e-4 * (1 + rows.true.abs().max())
    )
    recovered = rows[rows.quantity == "pressure"].set_index("patch").recovered
    np.testing.assert_allclose(
        recovered, table("patch_pressures").set_index("patch").pressure_MPa[recovered.index]
    )
    true = rows[rows.quantity == "pressure"].set_index("patch").true
    known = table("two_scales").query("variant == 'placed'").set_index("patch")
    np.testing.assert_array_equal(true, known.reference_pressure_MPa[true.index])
    assert np.abs(true - recovered).max() > 0.1


# --- Figures ----------------------------------------------------------------------------------


def test_figures_are_drawn_from_the_stages_that_they_name(results, table, config):
    script = runpy.run_path(str(ROOT / "workflow/scripts/draw_figures.py"))
    patches = list(table("patch_pressures").patch)
    files = {"contact": results / "macroscale/contact.h5", "worn_patches": results / "wear"}
    files |= {"surface": results / "macroscale/surface.h5", "mesh": results / "specimen/mesh.stl"}
    files |= {"intervals": results / "tables/patch_intervals.csv"}
    files |= {"pressures": results / "tables/patch_pressures.csv"}
    files |= {"two_scales": results / "tables/two_scales.csv"}
    files |= {"reference": results / "reference/patches.h5"}
    folders = {
        "contacts": "microscale",
        "others": "microscale/levelled",
        "registered": "registered",
    }
    files |= {name: [results / f"{of}/{p}.h5" for p in patches] for name, of in folders.items()}
    study = script["Study"](files, patches, patches, {}, 5.0, 550.0, 0.85, "mm", 100)
    whole = read_dataset(files["contact"])
    square = in_square(whole.pressure)
    title = script["figure_of"]("overview", study).axes[1].get_title()
    borne = float(square.sum()) * 0.125**2
    assert title.endswith(f"{borne:.3g} of 550 N")
    forces = script["figure_of"]("forces", study).axes[0]
    assert forces.images[0].get_array().shape[:2] == square.shape
    true = read_dataset(files["reference"]).contact.sel(patch="13").isel(draw=0).values
    panels = script["figure_of"]("two_scales", study).axes
    for axes, folder in zip(panels, ("microscale/levelled", "microscale"), strict=False):
        assert axes.get_title().startswith("patch 13")
        found = read_dataset(results / f"{folder}/13.h5").pressure.values > 0
        colours = axes.images[0].get_array()[..., :3]
        is_blue = np.isclose(colours, 255 * np.array(to_rgb(BLUE)), atol=2).all(axis=-1)
        assert is_blue.sum() == (found & true).sum()
