"""Figures: faithful to their data, and the same bytes each time."""

import io
from dataclasses import replace

import matplotlib
import numpy as np
import pandas as pd
import pytest
import trimesh
import xarray as xr
from contacts import contact_of, written
from in_memory import InMemory
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from scipy.spatial.distance import pdist

from gst.page.figures import macroscale, maps, microscale, style, tables, use
from gst.page.figures.tool import draw_stone
from gst.page.results import PatchResult
from gst.page.verdict import MODELS
from gstlib.surfaces.frames import Frame
from gstlib.surfaces.grid import make_surface

# Of three patches, "2" is not in the study.
PRESSURES = written(
    """patch,x_mm,y_mm,rotation_deg,pressure_MPa,in_study,low_MPa,high_MPa
    1,0.5,0.5,0,40,True,1,90
    2,2.5,1.5,10,4,False,1,90
    3,4.5,4.4,-3,20,True,1,90"""
)
RNG = np.random.default_rng(0)


def contact_at(heights, load):
    """Made-up contact where the surface is high, and a load path of four steps to it."""
    high = heights - np.quantile(heights, 0.95)
    pressure = np.clip(high, 0, None) * 1e4 * load
    contact = contact_of(heights, pressure, displacement=0.02).to_dataset()
    path = xr.DataArray(np.arange(1, 5) / 4, dims="step")
    return contact.assign(
        mean_pressure=40.0 * load,
        contact_modulus=12820.0,
        path_displacement=0.02 * path,
        path_mean_pressure=40 * path * load,
        path_contact_fraction=0.05 * path,
        path_stiffness=2e3 * path,
        path_pressure=path * contact["pressure"],
    )


SQUARE = contact_at(make_surface(RNG.normal(0, 5e-3, (20, 20)), 0.25), 4)
CONTACTS = {
    str(number): contact_at(
        make_surface(RNG.normal(0, 2e-3, (60, 60)), 0.014), 1 / number
    )
    for number in (1, 2, 3)
}
T0 = CONTACTS["1"].height
LOST = T0.copy(data=RNG.normal(0, 1e-4, T0.shape) - 1e-3 * (T0.values > 3e-3))
LOST[:, :6] = np.nan
CHANGE = xr.Dataset(
    {
        "t1": T0 + LOST,
        "change": LOST,
        "loss": LOST < -2e-4,
        "gain": LOST > 2e-4,
        "level_of_detection": xr.full_like(LOST, 2e-4),
    },
    attrs={"level_of_detection_um": 0.2, "overlap": 0.9},
)
# Points that do not wear have a depth, too, which no scan shows.
PREDICTED = (T0 - 2e-3).clip(0) + 5e-3
MARKED = (PREDICTED > 5.2e-3) & LOST.notnull()
RESULT = PatchResult("1", CONTACTS["1"], CHANGE, PREDICTED)
USES = written(
    """x_mm,y_mm,radius_mm,scatter_mm,stroke_mm,stroke_angle_deg,weight
    1,2,90,0.1,0,0,0.3
    2,1,200,0.2,0,0,0.6
    2.5,1.5,150,0,1,90,0.1"""
).astype(float)
LOSSES_PREDICTED = written(
    "loss_um,predicted_um,low_um,high_um\n1,0.9,0.5,1.3\n0.2,0.4,-0.1,0.9"
)


USE_TABLE = written("parameter,prior\nload_point_x,1.5\nload_point_y,1.5\nradius,200")


def study_of(**files):
    files = {
        "contact.h5": SQUARE,
        "surface.h5": SQUARE,
        "use.h5": xr.Dataset({name: ("draw", each) for name, each in USES.items()}),
        "use": USE_TABLE,
        "predicted_losses": LOSSES_PREDICTED,
        "patch_pressures": PRESSURES,
        "patch_intervals": PRESSURES,
    } | files
    study = InMemory(files, size_mm=5.0, patch_mm=0.85, places=PRESSURES)
    study.__dict__["contacts"] = CONTACTS
    return study


DRAW = {
    "contact_steps": lambda: macroscale.contact_steps_figure(study_of()),
    "force": lambda: macroscale.forces_figure(study_of()),
    "patch": lambda: microscale.patch_figure(RESULT),
    "use": lambda: use.use_figure(study_of()),
}


def lines_of(lines):
    return [line.get_xydata().tolist() for line in lines]


def points_of(axes):
    return lines_of(line for line in axes.lines if line.get_marker() == "o")


def picture_of(axes):
    return np.asarray(axes.images[0].get_array())[..., :3] / 255


@pytest.mark.parametrize(("name", "kind"), [("patch", "svg"), ("use", "pdf")])
def test_figure_has_the_same_bytes_each_time(tmp_path, name, kind):
    files = [tmp_path / f"figure.{suffix}" for suffix in ("png", kind)]
    contents = []
    for size in (10, 20):
        with matplotlib.rc_context({"font.size": size, "savefig.dpi": size}):
            figure = style.styled(DRAW[name])()
            style.save_figure(figure, *files, source_note="synthetic specimen")
        contents.append([file.read_bytes() for file in files])
    assert contents[0] == contents[1]
    texts = [text.get_text() for text in figure.findobj(matplotlib.text.Text)]
    assert "synthetic specimen" in texts
    assert not any("nan" in text for text in texts)


def test_a_figure_in_the_layout_of_another_looks_as_in_its_own(tmp_path):
    other = CONTACTS["1"].assign(mean_pressure=1234.5), CHANGE.assign(t1=10 * T0)
    layouts = {}
    for result in (RESULT, PatchResult("long name", *other, PREDICTED / 100)):
        kept, own = (tmp_path / f"{name}.png" for name in ("kept", "own"))
        figures = [microscale.patch_figure(result) for _ in range(2)]
        style.save_figure(figures[0], kept, source_note="note", layouts=layouts)
        style.save_figure(figures[1], own, source_note="note")
        assert kept.read_bytes() == own.read_bytes()
    assert len(layouts) == 1


def test_a_map_has_its_origin_its_scale_and_marks_of_the_right_area():
    mask, axes = RNG.random((300, 300)) < 0.15, panel()
    flat = make_surface(np.zeros(mask.shape), 0.01)
    maps.draw_map(axes, flat, marks={style.BLACK: mask})
    axes.set_axis_off()
    assert axes.axis() == pytest.approx((0, 3, 0, 3))
    brightness = pixels(axes.figure)[..., 0] / 255 / maps.RELIEF_MAP(0.0)[0]
    dark = 1 - brightness.reshape(5, 30, 5, 30).mean(axis=(1, 3))
    share = mask[::-1].reshape(5, 60, 5, 60).mean(axis=(1, 3))
    np.testing.assert_allclose(dark, share, atol=0.03)
    maps.scale_bar(axes)
    (bar,) = axes.artists
    assert bar.txt_label.get_text() == "0.7 mm"
    assert bar.size_bar.get_children()[0].get_width() == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("name", "panel", "colour", "mask"),
    [
        ("contact_steps", -1, style.BLACK, SQUARE.pressure > 0),
        ("patch", 2, style.BLACK, CONTACTS["1"].pressure > 0),
        ("patch", -1, style.BLUE, CHANGE.loss & MARKED),
        ("patch", -1, style.AMBER, CHANGE.loss & ~MARKED),
        ("patch", -1, style.PURPLE, MARKED & ~CHANGE.loss),
    ],
)
def test_maps_show_their_classes_where_they_are(name, panel, colour, mask):
    picture = picture_of(DRAW[name]().axes[panel])
    is_shown = np.isclose(picture, to_rgb(colour), atol=0.01).all(axis=-1)
    np.testing.assert_array_equal(is_shown, mask)


def test_forces_and_pressures_are_those_of_the_contact():
    square, bars = DRAW["force"]().axes
    darkest = picture_of(square).sum(axis=-1).argmin()
    assert darkest == SQUARE.pressure.values.argmax()
    heights = [bar.get_height() for bar in bars.patches]
    assert sorted(filter(np.isfinite, heights)) == [4.0, 20.0, 40.0]
    outlines = square.patches[:3]
    assert [outline.get_linestyle() for outline in outlines] == ["-", "--", "-"]
    corner = min(outlines[1].get_xy().tolist())  # of patch 2, turned by 10 degrees
    assert corner == pytest.approx([2.0076, 1.8448], abs=1e-3)


def test_epochs_share_their_colours_and_lost_or_predicted_height_is_red():
    before, after, _, changed, predicted, _ = DRAW["patch"]().axes
    ends = [axes.child_axes[0].get_xticks().tolist() for axes in (before, after)]
    assert ends[0] == ends[1]
    loss, gain = CHANGE.loss.values, CHANGE.gain.values
    redness = picture_of(changed) @ [1, 0, -1]
    assert redness[loss].min() > 0.1
    assert redness[gain].max() < -0.1
    assert np.abs(redness[~loss & ~gain]).max() < 0.03
    is_deep = PREDICTED.values > 6e-3
    assert (picture_of(predicted)[is_deep] @ [1, 0, -1]).min() > 0.1
    # of the area whose change is measured
    share = 100 * loss[LOST.notnull()].mean()
    assert changed.get_title().endswith(f": {share:.1f} %")


def test_a_patch_without_a_known_change_shows_its_scans():
    nowhere = xr.zeros_like(CHANGE.loss)
    unknown = CHANGE.assign(t1=T0, change=LOST * np.nan, loss=nowhere, gain=nowhere)
    unknown.attrs["level_of_detection_um"] = np.nan
    panels = microscale.patch_figure(RESULT._replace(change=unknown)).axes
    assert panels[3].get_title() == "the change is unknown"
    assert len(panels) == 5


def test_load_curves_are_those_of_the_patches_and_of_the_square():
    panels = microscale.load_curves_figure(study_of()).axes
    ends = [panel.lines[0].get_xydata()[-1] for panel in panels]
    assert ends[0] == pytest.approx([40 / 12820, 5])
    assert ends[1] == pytest.approx([20, 40])
    assert panels[2].lines[-1].get_ydata() == pytest.approx([0.5, 1, 1.5, 2])
    # of a face's load, the part on its square, and not the mean over the face
    mean = float(SQUARE.pressure.mean())
    share = 100 * float((SQUARE.pressure > 0).mean())
    assert ends[3] == pytest.approx([mean / 12820, share])
    assert ends[4][1] == pytest.approx(mean)


def test_validation_shows_the_numbers_of_the_tables():
    summary = written(
        """model,statistic,x,y,value,low,high,p_value,n
        archard,mean,mcc,,0.5,0.4,0.6,NA,3
        archard,mean,attainable_mcc,,0.7,NA,NA,NA,3
        rigid,mean,mcc,,0.4,NA,NA,NA,3
        NA,spearman,pressure_MPa,loss_fraction,0.5,-0.1,0.9,0.2,3
        NA,spearman,touched,mean_wear_depth_um,0.4,NA,NA,NA,4"""
    )
    losses = written(
        """patch,stated_MPa,mean_wear_depth_um,above_noise
        1,40,0.1,True
        2,4,NA,True
        3,20,0.2,True
        4,30,0.3,False
        5,0,0.01,True
        6,9,0.05,True"""
    )
    patches = written("patch,in_statistics\n1,True\n3,True\n5,False\n6,False")
    study = study_of(
        validation_summary=summary,
        validation_patches=patches,
        patch_pressures=losses[["patch", "stated_MPa"]].assign(pressure_MPa=1.0),
        registration=losses.drop(columns="stated_MPa"),
    )
    agreement, extent = tables.validation_figure(study).axes
    names = [text.get_text() for text in agreement.texts]
    assert names == [MODELS["archard"], MODELS["rigid"]]
    lines = lines_of(agreement.lines)
    interval, mean, attainable = [[0.4, 0], [0.6, 0]], [[0.5, 0]], [[0.7, 0]]
    assert lines[:3] == [interval, mean, attainable]
    assert lines[4] == [[0.4, 1]]
    studied, left_out, untouched = points_of(extent)
    assert studied == [[40, 0.1], [20, 0.2]]
    assert left_out == [[9, 0.05]]
    assert untouched == [[0, 0.01]]
    _, pressed, touched = extent.get_title().splitlines()
    assert pressed.endswith("ρ = 0.5 [−0.1, 0.9], p = 0.2")
    assert touched.endswith("ρ = 0.4, not tested")


def test_wear_shows_the_counted_patches_and_no_others():
    wear = written(
        """patch,model,predicted_volume_um3,measured_volume_um3
        1,archard,1e5,2e5
        3,archard,3e5,4e5
        5,archard,0,9e5
        1,rigid,2e5,2e5"""
    )
    profile = written(
        """patch,model,band,loss_um
        5,archard,1,9
        1,archard,1,1
        3,archard,1,3
        1,measured,3,4"""
    )
    patches = written("patch,in_statistics\n1,True\n3,True\n5,False")
    study = study_of(wear=wear, wear_profile=profile, validation_patches=patches)
    volumes, heights = tables.wear_figure(study).axes
    assert points_of(volumes) == [[[2, 1], [4, 3]]]
    # an interval in proportion to that of the pressure
    ends = [line[:, 1].tolist() for line in volumes.collections[0].get_segments()]
    np.testing.assert_allclose(ends, [[1 / 40, 90 / 40], [3 / 20, 3 * 90 / 20]])
    assert points_of(heights) == [[[2, 1]]]
    assert [[4, 3]] in lines_of(heights.lines)


@pytest.mark.parametrize("after", [2.0, np.nan])
def test_texture_is_shown_of_the_epochs_that_have_it(after):
    texture = pd.DataFrame(1.0, index=[0], columns=[*tables._TEXTURE])
    texture = texture.assign(patch="1", epoch="T0")
    if after > 0:
        texture = pd.concat([texture, texture.replace({1.0: after, "T0": "T1"})])
    for panel in tables.texture_figure(study_of(texture=texture)).axes:
        np.testing.assert_equal(points_of(panel), [[[0, after]], [[0, 1.0]]])


def test_the_most_loaded_patches_with_a_t1_are_drawn():
    study = study_of()
    assert replace(study, worn="23", max_plotted_patches=1).compared == ["3"]
    assert replace(study, worn="23", max_plotted_patches=2).drawn == ["1", "3"]


def test_the_likelier_a_use_the_more_strikes_it_has():
    square, radius, _ = DRAW["use"]().axes
    strikes, centres = (np.array(line.get_xydata()) for line in square.lines[:2])
    # the one stroke, of 1 mm, lies along y
    for one, spread in zip(
        USES.itertuples(), ([0.1, 0.1], [0.2, 0.2], [0, 12**-0.5]), strict=True
    ):
        chosen = (centres == [one.x_mm, one.y_mm]).all(axis=1)
        assert chosen.mean() == pytest.approx(one.weight, abs=0.06)
        off = (strikes - centres)[chosen]
        assert np.sqrt(np.mean(off**2, axis=0)) == pytest.approx(spread, rel=0.25)
    heights = [bar.get_height() for bar in radius.patches]
    assert [height for height in heights if height] == pytest.approx([0.3, 0.1, 0.6])


# --- The whole stone -------------------------------------------------------------------------


ABOVE = Frame((0, 0, 0), (-1, 0, 0), (0, 0, 1))
BELOW = Frame((0, 0, 0), (1, 0, 0), (0, 0, -1))


def panel():
    return Figure(figsize=(3, 3)).add_axes((0, 0, 1, 1))


def pixels(figure):
    content = io.BytesIO()
    figure.savefig(content, format="rgba", dpi=50)
    width, height = (figure.get_size_inches() * 50).astype(int)
    return np.frombuffer(content.getvalue(), np.uint8).reshape(height, width, 4)


@pytest.mark.parametrize(("view", "seen"), [(ABOVE, 0), (BELOW, 2)])
def test_only_the_nearest_is_seen_lit_from_the_upper_left(view, seen):
    """Of a ball, red above and blue below."""
    axes, ball = panel(), trimesh.creation.icosphere(subdivisions=4, radius=20.0)
    colours = np.zeros_like(ball.vertices, dtype=np.uint8)
    is_blue = ball.vertices[:, 2] <= 0
    colours[is_blue, 2] = colours[~is_blue, 0] = 255
    draw_stone(axes, ball, view, colours)
    picture = pixels(axes.figure)[..., :3]
    middle = picture[70:80, 70:80]
    assert middle[..., seen].min() > 50
    # seams between triangles are not quite shut
    assert middle[..., 2 - seen].max() < 60
    assert picture[50, 50].mean() > picture[100, 100].mean() + 10


# Linear RGB as seen without red, green or blue cones (Machado, Oliveira & Fernandes 2009).
COLOUR_BLIND = [
    "0.152 1.053 -0.205  0.115 0.786  0.099  -0.004 -0.048 1.052",
    "0.367 0.861 -0.228  0.280 0.673  0.047  -0.012  0.043 0.969",
    "1.256 -0.077 -0.179  -0.078 0.931 0.148  0.005  0.691 0.304",
]


@pytest.mark.parametrize("seen", ["1 0 0 0 1 0 0 0 1", *COLOUR_BLIND])
def test_everybody_can_tell_the_classes_of_agreement_apart(seen):
    matrix = np.reshape(seen.split(), (3, 3)).astype(float)
    linear = np.array([to_rgb(one) for one in style.AGREEMENT.values()]) ** 2.2
    colours = np.clip([*linear, np.ones(3)] @ matrix.T, 0, 1) ** (1 / 2.2)
    assert pdist(colours).min() > 0.3
