"""Figures: faithful to what they are drawn from, and the same bytes each time."""

import copy
import io
from itertools import combinations

import matplotlib
import numpy as np
import pandas as pd
import pytest
import trimesh
import xarray as xr
from contacts import contact_of
from gst.page.figures import macroscale, maps, microscale, style, tables, use
from gst.page.figures.maps import draw_footprints
from gst.page.figures.microscale import PatchResult
from gst.page.figures.study import draw as draw_study
from gst.page.figures.study import predicted_loss
from gst.page.figures.tool import PressedFace, check_figure, draw_square, draw_stone
from gst.page.results import Results, evenly
from gst.page.verdict import MODELS
from gstlib.errors import InputError
from gstlib.surfaces.frames import Frame
from gstlib.surfaces.grid import make_surface
from gstlib.validation.summary import separated
from matplotlib.figure import Figure


def table(text):
    """A table as its stage writes it; an underscore after a comma stands for a space."""
    lines = [line.strip().replace(" ", "|") for line in text.replace("; ", "\n").splitlines()]
    rows = pd.read_csv(io.StringIO("\n".join(lines)), sep="|", dtype={"patch": str})
    return rows.replace("(?<=,)_", " ", regex=True)


# What figures of one table are drawn from; of three patches, "2" is not in the study.
ALONE = {"message": "No patch."}
PRESSURES = table("""patch x_mm y_mm rotation_deg pressure_MPa in_study low_MPa high_MPa
    1 0.5 0.5 0 40 True 1 90; 2 2.5 1.5 10 4 False 1 90; 3 4.5 4.4 -3 20 True 1 90""")
LOSSES = table("""patch stated_MPa mean_wear_depth_um above_noise; 1 40 0.1 True; 2 4 NA True
    3 20 0.2 True; 4 30 0.3 False; 5 0 0.01 True; 6 9 0.05 True""")
IN_STATISTICS = table("patch in_statistics; 1 True; 3 True; 5 False; 6 False")
SUMMARY = table("""model statistic value low high p_value n
    archard mean(mcc) 0.5 0.4 0.6 NA 3; archard mean(attainable_mcc) 0.7 NA NA NA 3
    rigid mean(mcc) 0.4 NA NA NA 3; oracle_area mean(mcc) 0.8 0.7 0.9 NA 3
    NA spearman(pressure_MPa,_loss_fraction) 0.5 -0.1 0.9 0.2 3
    NA spearman(touched,_mean_wear_depth_um) 0.4 NA NA NA 4""")
SUMMARY = separated(SUMMARY)
WEAR = table("""patch model predicted_volume_um3 measured_volume_um3; 1 archard 1e5 2e5
    3 archard 3e5 4e5; 5 archard 0 9e5; 1 rigid 2e5 2e5; 3 rigid 9e5 4e5""")
PROFILE = table("patch band model loss_um; 5 1 archard 9")
PROFILE = pd.concat(
    [PROFILE]
    + [
        pd.DataFrame({"band": range(1, 5), "loss_um": [of, 0.2, 0.1, 0.0]}).assign(
            patch=patch, model=model
        )
        for patch, model, of in (("1", "archard", 1.0), ("3", "archard", 3.0), ("1", "measured", 4))
    ]
)
TWO_SCALES = table("""patch variant f1; 1 paper 0.4; 3 paper 0.5; all paper 0.45
    1 equilibrium 0.9; 3 equilibrium 0.8; all equilibrium 0.85""")
ALONE["texture"] = table("""patch epoch Sq_um Sk_um Spk_um Svk_um Sal_um Str
    1 T0 2 1 1 1 1 1; 1 T1 1.5 1 1 1 1 1; 2 T0 3 1 1 1 1 1; 3 T0 4 1 1 1 1 1""")


def contact_at(heights, load):
    """Made-up contact where the surface is high, and a load path of four steps to it."""
    pressure = np.clip(heights - np.quantile(heights, 0.95), 0, None) * 1e4 * load
    path = xr.DataArray(np.arange(1, 5) / 4, dims="step")
    along = {"displacement": 0.02 * path, "mean_pressure": 40 * path * load}
    along |= {"contact_fraction": 0.05 * path, "stiffness": 2e3 * path, "pressure": path * pressure}
    found = contact_of(heights, pressure, displacement=0.02).to_dataset()
    found = found.assign(mean_pressure=40.0 * load, contact_modulus=12820.0)
    return found.assign({f"path_{name}": values for name, values in along.items()})


RNG = np.random.default_rng(0)
SQUARE = make_surface(RNG.normal(0, 5e-3, (20, 20)), 0.25)
SQUARE = contact_at(SQUARE, 4)
HEIGHTS = {patch: make_surface(RNG.normal(0, 2e-3, (60, 60)), 0.014) for patch in "123"}
CONTACTS = {patch: contact_at(height, 1 / int(patch)) for patch, height in HEIGHTS.items()}
T0, PRESSURE = CONTACTS["1"]["height"], CONTACTS["1"]["pressure"]
LOST = T0.copy(data=RNG.normal(0, 1e-4, T0.shape) - 1e-3 * (T0.values > 3e-3))
LOST[:, :6] = np.nan
CHANGE = {"t1": T0 + LOST, "change": LOST, "loss": LOST < -2e-4, "gain": LOST > 2e-4}
CHANGE["level_of_detection"] = xr.full_like(LOST, 2e-4)
CHANGE = xr.Dataset(CHANGE, attrs={"level_of_detection_um": 0.2, "overlap": 0.9})
# Points that do not wear have a depth, too, which no scan shows.
PREDICTED = (T0 - 2e-3).clip(0) + 5e-3
FORETOLD = (PREDICTED > 5.2e-3) & LOST.notnull()
PREPARED = {"height": T0, "measured": T0.where(T0 < 4e-3), "filled": T0 >= 4e-3}
PREPARED = xr.Dataset(PREPARED | {"outlier": T0 < -4e-3})
PREPARED.attrs = {"Sq_before_um": 3.0, "Sq_after_um": 2.0}
SIZE, PATCH = {"patch_size_mm": 0.85}, {"patch": "1"}
RESULT = PatchResult("1", CONTACTS["1"], CHANGE, PREDICTED)
TOOL = (
    trimesh.creation.box((9, 9, 4)).subdivide_to_size(0.5),
    Frame(origin=(-2.5, -2.5, 2), x_axis=(1, 0, 0), normal=(0, 0, 1)),
)
# What each figure is drawn from.
FROM = {
    "input": ((SQUARE["height"], PRESSURES), SIZE),
    "force": ((SQUARE, PRESSURES), SIZE),
    "preparation": (({"T0": PREPARED, "T1": PREPARED},), PATCH),
    "load_curves": ((SQUARE, CONTACTS), {}),
    "patch": ((RESULT,), {}),
    "overview": ((SQUARE, PRESSURES, TOOL, RESULT), SIZE | {"force_N": 550.0}),
    "contact_steps": ((SQUARE,), {"size_mm": 3.0}),
    "validation": ((IN_STATISTICS, LOSSES, SUMMARY), {}),
    "wear": ((WEAR, PROFILE, PRESSURES, ["1", "3"]), {}),
}
TOUCHED = {patch: CONTACTS[patch].pressure.values > 30 for patch in "13"}
FROM["two_scales"] = (({"paper": CONTACTS, "equilibrium": CONTACTS}, TOUCHED, TWO_SCALES), {})
ALONE["microscale_maps"] = CONTACTS
FROM |= {name: ((found,), {}) for name, found in ALONE.items()}
DRAWS = {"x_mm": [1.0, 2.0, 2.5], "y_mm": [2.0, 1.0, 1.5], "radius_mm": [90.0, 200.0, 150.0]}
DRAWS |= {"scatter_mm": [0.1, 0.2, 0.0], "stroke_mm": [0.0, 0.0, 1.0]}
DRAWS |= {"stroke_angle_deg": [0.0, 0.0, 90.0], "weight": [0.3, 0.6, 0.1]}
USE = xr.Dataset({name: ("draw", of) for name, of in DRAWS.items()})
STATED = pd.DataFrame({"parameter": ["load_point_x", "load_point_y", "radius"]}).assign(
    prior=[1.5, 1.5, 200.0]
)
FORETELLING = pd.DataFrame({"loss_um": [1.0, 0.2], "predicted_um": [0.9, 0.4]}).assign(
    low_um=[0.5, -0.1], high_um=[1.3, 0.9]
)
FROM["use"] = ((USE, STATED, FORETELLING, SQUARE["height"], PRESSURES), {"patch_size_mm": 0.8})
MASKS = [
    ("contact_steps", -1, style.BLACK, SQUARE["pressure"] > 0),
    ("preparation", 0, style.VERMILION, PREPARED["outlier"]),
    ("patch", 2, style.BLACK, PRESSURE > 0),
    ("patch", -1, style.BLUE, CHANGE["loss"] & FORETOLD),
    ("patch", -1, style.AMBER, CHANGE["loss"] & ~FORETOLD),
    ("patch", -1, style.PURPLE, FORETOLD & ~CHANGE["loss"]),
    ("overview", -1, "#ffffff", LOST.isnull()),
    ("two_scales", 0, style.BLUE, PRESSURE > 30),
    ("two_scales", 1, style.PURPLE, (PRESSURE > 0) & (PRESSURE <= 30)),
]
VECTORS = {"overview": "pdf"}  # of the others, SVG
CASES = [("13", {"in_study": False})]
CASES += [("3", {"pressure_MPa": [2.0, 9.0, 4.0], "in_study": True, "most": 1})]


def draw(name):
    rooms = macroscale, microscale, style, tables, use
    home = (m for m in rooms if f"{name}_figure" in m.__all__)
    return getattr(next(home), f"{name}_figure")(*FROM[name][0], **FROM[name][1])


def points_of(axes):
    return [line.get_xydata().tolist() for line in axes.lines if line.get_marker() == "o"]


def picture_of(axes):
    return np.asarray(axes.images[0].get_array()) / 255


def inputs_of(name):
    """What a figure is drawn from, one by one."""
    for given in FROM[name][0]:
        yield from vars(given).values() if isinstance(given, PatchResult) else [given]


@pytest.mark.parametrize("name", FROM)
def test_figure_has_the_same_bytes_each_time_and_leaves_its_input_alone(tmp_path, name):
    before, contents = copy.deepcopy(list(inputs_of(name))), []
    files = [tmp_path / f"figure.{kind}" for kind in ("png", VECTORS.get(name, "svg"))]
    for size in (10, 20):
        with matplotlib.rc_context({"font.size": size, "savefig.dpi": size}):
            figure = draw(name)
            style.save_figure(figure, *files, source_note="synthetic specimen")
        contents.append([file.read_bytes() for file in files])
    assert contents[0] == contents[1]
    texts = [text.get_text() for text in figure.findobj(matplotlib.text.Text)]
    assert "synthetic specimen" in texts
    assert not any("nan" in text for text in texts)
    for now, then in zip(inputs_of(name), before, strict=True):
        if isinstance(now, tuple):
            assert (now[0].vertices == then[0].vertices).all()
        else:
            assert now.equals(then) if hasattr(now, "equals") else list(now) == list(then)


def test_a_map_has_its_origin_its_scale_and_marks_of_the_right_area():
    mask = RNG.random((300, 300)) < 0.15
    axes = panel()
    maps.draw_map(axes, make_surface(np.zeros(mask.shape), 0.01), marks={"#000000": mask})
    axes.set_axis_off()
    origin, far = axes.transData.transform([(0, 0), (3, 3)])
    assert (origin < far).all()
    assert axes.images[0].get_extent() == pytest.approx((0, 3, 0, 3))
    shown = pixels(axes.figure)[..., 0] / 255 / maps.RELIEF_MAP(0.0)[0]
    shares = mask[::-1].reshape(5, 60, 5, 60).mean(axis=(1, 3))
    np.testing.assert_allclose(1 - shown.reshape(5, 30, 5, 30).mean(axis=(1, 3)), shares, atol=0.03)
    maps.scale_bar(axes)
    (bar,) = axes.artists
    assert bar.txt_label.get_text() == "0.7 mm"
    assert bar.size_bar.get_children()[0].get_width() == pytest.approx(0.7)


@pytest.mark.parametrize(("name", "panel", "colour", "mask"), MASKS)
def test_maps_show_their_classes_where_they_are(name, panel, colour, mask):
    colour = matplotlib.colors.to_rgb(colour)
    drawn = np.isclose(picture_of(draw(name).axes[panel]), colour, atol=0.01).all(axis=-1)
    np.testing.assert_array_equal(drawn, mask)


def test_forces_and_pressures_are_those_of_the_contact():
    square, bars = draw("force").axes
    assert picture_of(square).sum(axis=-1).argmin() == SQUARE["pressure"].values.argmax()
    most = float(SQUARE["pressure"].max()) * 0.25**2
    assert square.child_axes[0].get_xticks() == pytest.approx([0, most])
    assert sorted(bar.get_height() for bar in bars.patches) == [4.0, 20.0, 40.0]
    assert [line[:, 1].tolist() for line in bars.collections[0].get_segments()] == [[1, 90]] * 3
    assert [patch.get_linestyle() == "-" for patch in square.patches[:3]] == [True, False, True]
    corner = min(square.patches[1].get_xy().tolist())  # of patch 2, turned by 10 degrees
    assert corner == pytest.approx([2.5 - 0.425 * 1.1585, 1.5 + 0.425 * 0.8112], abs=1e-3)


def test_epochs_share_their_colours_and_what_was_or_will_be_lost_is_red():
    before, after, _, changed, predicted, _ = draw("patch").axes
    ends = [axes.child_axes[0].get_xticks().tolist() for axes in (before, after)]
    assert ends[0] == ends[1]
    redness, rose = picture_of(changed) @ [1, 0, -1], CHANGE["gain"].values
    assert redness[lost := CHANGE["loss"].values].min() > 0.1
    assert redness[rose].max() < -0.1
    assert np.abs(redness[~lost & ~rose]).max() < 0.03
    redness = picture_of(predicted) @ [1, 0, -1]
    assert redness[PREDICTED.values > 6e-3].min() > 0.1
    assert np.abs(redness[PREDICTED.values == 5e-3]).max() < 0.03


def test_the_lost_share_is_of_the_area_whose_change_is_known():
    assert CHANGE["change"].isnull().any()
    share = CHANGE["loss"].values[CHANGE["change"].notnull()].mean()
    titles = [panel.get_title() for panel in draw("patch").axes]
    assert any(title.endswith(f": {100 * share:.1f} %") for title in titles)


def test_a_patch_without_a_known_change_shows_its_scans_and_says_so():
    nothing = {"change": xr.full_like(LOST, np.nan), "loss": xr.zeros_like(CHANGE["loss"])}
    nothing |= {"t1": T0, "gain": nothing["loss"]}
    change = CHANGE.assign(nothing).assign_attrs(level_of_detection_um=np.nan)
    for predicted, count in ((None, 4), (PREDICTED, 5)):
        result = PatchResult("1", CONTACTS["1"], change, predicted)
        axes = microscale.patch_figure(result).axes
        titles = [panel.get_title() for panel in axes]
        assert titles[1] == "T1, after use, not laid on T0"
        assert titles[3] == "no change is known"
        assert len(titles) == count


def test_curves_and_tables_are_drawn_as_they_are():
    area, load, stiffness, of_square, pressed = draw("load_curves").axes
    np.testing.assert_allclose(area.lines[0].get_xydata()[-1], [40 / 12820, 5])
    np.testing.assert_allclose(load.lines[0].get_xydata()[-1], [20, 40])
    np.testing.assert_allclose(stiffness.lines[-1].get_ydata(), [0.5, 1, 1.5, 2])
    assert [text.get_text() for text in load.texts] == ["1", "2", "3"]
    # of a face's load, what its square bears, and not the mean over the face
    mean = SQUARE["pressure"].values.mean()
    np.testing.assert_allclose(pressed.lines[0].get_ydata(), mean * np.arange(1, 5) / 4)
    share = 100 * (SQUARE["pressure"].values > 0).mean()
    np.testing.assert_allclose(of_square.lines[0].get_xydata()[-1], [mean / 12820, share])
    after, before = points_of(draw("texture").axes[0])
    np.testing.assert_array_equal(after, [[0, 1.5], [1, np.nan], [2, np.nan]])
    assert before == [[0, 2], [1, 3], [2, 4]]


def test_validation_shows_what_the_tables_say():
    agreement, extent = draw("validation").axes
    assert [text.get_text() for text in agreement.texts] == [
        MODELS[name] for name in ("archard", "rigid", "oracle_area")
    ]
    assert points_of(agreement) == [[[0.5, 0]], [[0.4, 1]], [[0.8, 2]]]
    assert [0.4, 0] in agreement.lines[0].get_xydata().tolist()
    (most,) = (line for line in agreement.lines if line.get_marker() == "|")
    assert most.get_xydata().tolist() == [[0.7, 0]]
    studied, left_out, untouched = points_of(extent)
    assert (studied, left_out, untouched) == ([[40, 0.1], [20, 0.2]], [[9, 0.05]], [[0, 0.01]])
    _, pressed, touched = extent.get_title().splitlines()
    assert pressed.endswith("pressure and worn area: ρ = 0.5 [−0.1, 0.9], p = 0.2")
    assert touched.endswith("touched or not and loss: ρ = 0.4, not tested")


def test_wear_shows_the_counted_patches_and_no_others():
    volumes, heights = draw("wear").axes
    assert points_of(volumes) == [[[2, 1], [4, 3]]]
    # an interval in proportion to that of the pressure
    ends = [line[:, 1].tolist() for line in volumes.collections[0].get_segments()]
    np.testing.assert_allclose(ends, [[1 / 40, 90 / 40], [3 / 20, 3 * 90 / 20]])
    assert points_of(heights) == [[[2, 1], [0.2, 2], [0.1, 3], [0, 4]]]
    assert heights.lines[0].get_xydata()[0].tolist() == [4, 1]


def run(folder, *names, most=2, **columns):
    """Draw figures of the study in files; `columns` change the table of pressures."""
    datasets = {"change/1": CHANGE, "change/3": CHANGE, "square": SQUARE}
    datasets |= {f"t1/{patch}": CHANGE.rename(t1="height") for patch in "13"}
    for name in ("change", "contact", "t1"):
        (folder / name).mkdir()
    for name, dataset in (datasets | {f"contact/{p}": c for p, c in CONTACTS.items()}).items():
        dataset.to_netcdf(folder / f"{name}.h5", engine="h5netcdf")
    PRESSURES.assign(**columns).to_csv(folder / "pressures.csv", index=False)
    files = {"contact": folder / "square.h5", "pressures": folder / "pressures.csv"}
    files |= {"contacts": [folder / "contact"], "registered": [folder / "change"]}
    files |= {"t1": [folder / "t1"]}
    pictures = {f"{name}_png": folder / f"{name}.png" for name in names}
    if "patch" in names:
        pictures |= {"patch_png": folder / "patch", "load_curves_svg": folder / "load_curves.svg"}
    study = Results(files, "123", "13", most, size_mm=5.0, patch_mm=0.85, force_N=550.0)
    draw_study(study, pictures, note=None)


@pytest.mark.parametrize(("drawn", "columns"), CASES)
def test_study_draws_the_studied_patches_in_even_steps_of_pressure(tmp_path, columns, drawn):
    assert evenly("abcdefgh", 3) == ["a", "c", "f"]
    run(tmp_path, "load_curves", "microscale_maps", "patch", **columns)
    assert sorted(path.stem for path in (tmp_path / "patch").iterdir()) == list(drawn)
    assert len(list(tmp_path.glob("*.[ps][nv]g"))) == 3


def test_study_shows_the_loss_that_the_study_predicts(tmp_path):
    models = xr.concat(
        [PREDICTED, 2 * PREDICTED], pd.Index(["archard", "interlayer"], name="model")
    )
    models.to_dataset(name="depth").to_netcdf(tmp_path / "1.h5", engine="h5netcdf")
    study = Results({"depths": [tmp_path]})
    xr.testing.assert_allclose(predicted_loss(study, "1").drop_vars("model"), 2 * PREDICTED)
    assert predicted_loss(study, "2") is None


def test_study_refuses_a_table_of_other_patches(tmp_path):
    with pytest.raises(InputError, match=r"pressures\.csv.*one row for each patch"):
        run(tmp_path, "microscale_maps", patch=["1", "2", "4"])


def test_the_likelier_a_use_the_more_strikes_it_has():
    square, radius, losses = draw("use").axes[:3]
    strikes, centres = (np.array(line.get_xydata()) for line in square.lines[:2])
    for x, y, scatter, stroke, share in zip(
        *(DRAWS[name] for name in ("x_mm", "y_mm", "scatter_mm", "stroke_mm", "weight")),
        strict=True,
    ):
        chosen = (centres == [x, y]).all(axis=1)
        assert chosen.mean() == pytest.approx(share, abs=0.06)
        apart = (strikes - centres)[chosen]
        # the one stroke lies along y
        expected = [scatter, np.hypot(scatter, stroke / 12**0.5)]
        assert np.sqrt(np.square(apart).mean(axis=0)) == pytest.approx(expected, rel=0.25)
    bars = {bar.get_x(): bar.get_height() for bar in radius.patches if bar.get_height()}
    assert [bars[at] for at in sorted(bars)] == pytest.approx([0.3, 0.1, 0.6])
    assert points_of(losses) == [FORETELLING[["loss_um", "predicted_um"]].to_numpy().tolist()]


def test_two_scales_shows_what_was_found_and_missed():
    figure = draw("two_scales")
    assert "0.45 paper and 0.85 equilibrium" in figure.get_suptitle()
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:3] == ["1 paper: 0.40", "1 equilibrium: 0.90", "1 whole square"]
    assert titles[3:] == ["3 paper: 0.50", "3 equilibrium: 0.80", "3 whole square"]


# --- The whole stone -------------------------------------------------------------------------


ABOVE = Frame((0, 0, 0), (-1, 0, 0), (0, 0, 1))
BELOW = Frame((0, 0, 0), (1, 0, 0), (0, 0, -1))


def stone():
    return trimesh.creation.icosphere(subdivisions=4, radius=20.0)


def panel():
    return Figure(figsize=(3, 3)).add_axes((0, 0, 1, 1))


def pixels(figure):
    content = io.BytesIO()
    figure.savefig(content, format="rgba", dpi=50)
    size = (figure.get_size_inches() * 50).astype(int)
    return np.frombuffer(content.getvalue(), np.uint8).reshape(size[1], size[0], 4)


@pytest.mark.parametrize(("view", "seen"), [(ABOVE, 0), (BELOW, 2)])
def test_only_the_nearest_is_seen_lit_from_the_upper_left(view, seen):
    """Of a ball, red above and blue below."""
    axes, ball = panel(), stone()
    blue = ball.vertices[:, 2] <= 0
    colours = np.where(blue[:, None], [[0, 0, 255]], [[255, 0, 0]]).astype(np.uint8)
    draw_stone(axes, ball, view, colours=colours)
    picture = pixels(axes.figure)[..., :3]
    middle = picture[70:80, 70:80]
    assert middle[..., seen].min() > 50
    assert middle[..., 2 - seen].max() < 60  # seams between triangles are not quite shut
    assert picture[50, 50].mean() > picture[100, 100].mean() + 10


def test_the_square_is_outlined_in_a_view():
    axes = panel()
    draw_square(axes, ABOVE, Frame((2.5, 2.5, 19.5), (-1, 0, 0), (0, 0, 1)), 5.0)
    (outline,) = axes.patches
    assert np.allclose(outline.get_xy()[0], [-2.5, -2.5])
    assert np.ptp(outline.get_xy(), axis=0) == pytest.approx([5, 5])
    assert {text.get_text(): text.get_position() for text in axes.texts} == {
        "x": pytest.approx((4.25, -2.5)),
        "y": pytest.approx((-2.5, 4.25)),
    }


def test_the_check_shows_the_active_stone_and_where_it_is_pushed():
    frame = Frame((2.5, 2.5, 30), (-1, 0, 0), (0, 0, 1))
    height, round_stone = np.zeros((6, 6)), -0.1 * np.hypot(*np.mgrid[-2.5:3, -2.5:3]) ** 2
    face = xr.Dataset({"height": make_surface(height, 2.0)})
    face["counterface"] = face.height.copy(data=round_stone)
    pushed = np.array([[1.0, 2.0], [3.0, 4.0]])
    sizes = {"size_mm": 5.0, "patch_size_mm": 0.85}
    assert len(check_figure(stone(), frame, None, pd.DataFrame(), **sizes).axes) == 2
    pressed = PressedFace(face, pushed)
    figure = check_figure(stone(), frame, None, pd.DataFrame(), pressed=pressed, **sizes)
    (picture,) = figure.axes[2].images
    brightness = picture.get_array().sum(axis=2)
    assert brightness[2, 2] > brightness[0, 0]  # the nearer, the brighter
    (points,) = figure.axes[2].lines
    assert points.get_xydata().tolist() == [[2, 1], [4, 3]]
    (square,) = figure.axes[2].patches
    assert np.ptp(square.get_xy(), axis=0).tolist() == [5, 5]


@pytest.mark.parametrize("turn", [0.0, 30.0, 45.0, 90.0, 200.0])
def test_the_name_of_a_patch_is_inside_its_outline(turn):
    axes = panel()
    axes.set(xlim=(0, 5), ylim=(0, 5))
    patch = {"patch": ["7"], "x_mm": [2.0], "y_mm": [2.5], "rotation_deg": [turn]}
    draw_footprints(axes, pd.DataFrame(patch), 0.85, colour="black")
    (outline,), (name,) = axes.patches, axes.texts
    assert outline.get_path().contains_point(name.get_position())
    for grade in (3.0, np.nan):
        graded = pd.DataFrame(patch).assign(wear_grade=[grade])
        draw_footprints(axes, graded, 0.85, colour="black")
    assert [text.get_text() for text in axes.texts] == ["7", "7: 3", "7"]


def test_collided_labels_are_moved_apart():
    figure, (axes,) = style.panels(1, 2)
    axes.set(xlim=(0, 1), ylim=(0, 1))
    ends = [(0.5, 0.5), (0.5, 0.51), (0.51, 0.505), (0.9, 0.5)]
    style.write_all(axes, ["1", "22", "3", "4"], ends)
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    assert [text.xy for text in axes.texts] == ends
    assert axes.texts[3].get_position() == axes.texts[0].get_position()  # alone, it stays


def test_raking_light_is_of_one_brightness_and_shows_slopes():
    """A plane is as bright as its slope says, whatever the rest of the picture; polish is even."""
    y, x = np.meshgrid(*2 * [0.01 * np.arange(40)], indexing="ij")
    towards, away = (make_surface(slope * (x - y), 0.01) for slope in (0.1, -0.1))
    bright, dark, level = (
        np.asarray(maps.raking(of)) for of in (towards, away, make_surface(0 * x, 0.01))
    )
    assert (np.ptp(bright), np.ptp(level)) == (0, 0)
    assert dark.max() < level.min() < bright.min()
    assert level[0, 0, 0] == round(255 / np.sqrt(2))
