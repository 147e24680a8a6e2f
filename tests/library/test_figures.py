"""Figures: written from stored results, the same bytes each time, and faithful to their input."""

import copy

import matplotlib
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.image import imread

import gstlib.figures as figures
from gstlib.figures.style import block_of, draw_classes, draw_heights, draw_mask, new_figure
from gstlib.surface import make_surface
from gstlib.validation.change import no_change

STEPS = 4


def contact_of(height, *, every_step, rng):
    """A made-up contact dataset: pressure where the surface stands high."""
    depth = height.values - np.quantile(height.values, 0.95)
    pressure = np.clip(depth, 0, None) * 1e4
    fields = {"pressure": pressure, "gap": np.clip(-depth, 0, None)}
    dims = ("y", "x")
    if every_step:
        fields = {
            name: np.stack([field * (k + 1) / STEPS for k in range(STEPS)])
            for name, field in fields.items()
        }
        dims = ("step", "y", "x")
    path = np.arange(1, STEPS + 1) / STEPS
    return xr.Dataset(
        {
            "height": height,
            **{name: (dims, field) for name, field in fields.items()},
            "displacement": ("step", 0.02 * path),
            "mean_pressure": ("step", (10 + 40 * rng.random()) * path**2),
            "contact_fraction": ("step", 0.05 * path),
            "stiffness": ("step", 2e3 * path),
        },
        attrs={"contact_modulus_MPa": 12820.0},
    )


def slip_of(contact):
    """Made up: what carries much sticks, the rest of the contact slips."""
    pressure = contact["pressure"].values
    stick = pressure > 0.3 * pressure.max()
    return xr.Dataset(
        {
            "stick": (("y", "x"), stick),
            "slip": (("y", "x"), (pressure > 0) & ~stick),
            "mean_traction": 3.0,
        },
        attrs={"friction": 0.6, "tangential_ratio": 0.5},
    )


def limited_of(contact):
    """Made up: the pressure cut at a third, and a little contact more."""
    hardness = float(contact["pressure"].max()) / 3
    pressure = np.minimum(contact["pressure"].values + 1e-3, hardness)
    pressure[:40] = np.minimum(contact["pressure"].values[:40], hardness)
    return xr.Dataset({"pressure": (("y", "x"), pressure)}, attrs={"hardness_MPa": hardness})


@pytest.fixture
def study():
    """What the figures take, small."""
    rng = np.random.default_rng(0)
    square = make_surface(rng.normal(0, 5e-3, (20, 20)), 0.25)
    patches = {name: make_surface(rng.normal(0, 2e-3, (60, 60)), 0.014) for name in ("1", "2", "3")}
    contacts = {
        name: contact_of(height, every_step=False, rng=rng) for name, height in patches.items()
    }
    t0 = patches["1"]
    change = rng.normal(0, 1e-4, t0.shape) - 1e-3 * (t0.values > 3e-3)
    change[:, :6] = np.nan
    registered = xr.Dataset(
        {
            "t1": (("y", "x"), t0.values + change),
            "change": (("y", "x"), change),
            "loss": (("y", "x"), np.nan_to_num(change) < -2e-4),
            "gain": (("y", "x"), np.nan_to_num(change) > 2e-4),
        },
        coords=t0.coords,
        attrs={"level_of_detection_um": 0.2, "overlap": 0.9},
    )
    prepared = xr.Dataset(
        {
            "height": t0,
            "filled": (("y", "x"), rng.random(t0.shape) < 0.01),
            "outlier": (("y", "x"), rng.random(t0.shape) < 0.01),
            "outlier_window": (("y", "x"), rng.random(t0.shape) < 0.01),
            "outlier_median": (("y", "x"), rng.random(t0.shape) < 0.01),
        },
        attrs={
            "tilt_x_mrad": 1.0,
            "tilt_y_mrad": -2.0,
            "Sq_before_um": 3.0,
            "Sq_after_um": 2.0,
            "highest_before_um": 30.0,
            "highest_after_um": 8.0,
            "outlier_rule": "window",
            "outlier_k_window": 1.8,
            "outlier_k_median": 6.0,
        },
    )
    pressures = pd.DataFrame(
        {
            "patch": ["1", "2", "3"],
            "x_mm": [0.5, 2.5, 4.5],
            "y_mm": [0.5, 1.5, 4.4],
            "rotation_deg": [0.0, 10.0, -3.0],
            "pressure_MPa": [30.0, 0.0, 5.0],
            "in_study": [True, False, True],
        }
    )
    scores = pd.DataFrame({"patch": ["1", "2", "3"], "loss_fraction": [0.1, np.nan, 0.2]})
    for score in ("mcc", "pr_auc"):
        for front in ("", "highest_", "curvature_"):
            scores[f"{front}{score}"] = [0.5, np.nan, 0.7]
    gains = pd.DataFrame(
        [
            {"patch": patch, "score": score, "value": value, "null_low": 0.0, "null_high": 0.2}
            | {"p_value": p_value}
            for score in ("mcc", "pr_auc")
            for patch, value, p_value in (("1", 0.5, 1e-4), ("2", np.nan, np.nan), ("3", 0.1, 0.5))
        ]
    )
    failures = pd.DataFrame(
        [
            {"patch": patch, "split": split, "band": band, "area_share": 0.5}
            | {"loss_share": share, "hit_share": share / 4}
            for patch in ("1", "3")
            for split in ("height", "gap")
            for band, share in (("0-50 %", 0.2), ("50-100 %", 0.8))
        ]
    )
    return {
        "square": square,
        "macroscale": contact_of(square, every_step=True, rng=rng),
        "contacts": contacts,
        "slips": {name: slip_of(contact) for name, contact in contacts.items()},
        "limited": {name: limited_of(contact) for name, contact in contacts.items()},
        "registered": registered,
        "prepared": {"T0": prepared, "T1": prepared},
        "measured": {"T0": t0.where(t0 < 5e-3), "T1": t0 + 1.0},
        "pressures": pressures,
        "scores": scores,
        "gains": gains,
        "failures": failures,
        "summary": pd.DataFrame(
            {
                "statistic": [
                    "spearman(pressure_MPa, loss_fraction)",
                    "gain(mcc)",
                    "gain(pr_auc)",
                    "gain(f1)",
                ],
                "value": [0.5, -0.2, 0.1, np.nan],
                "low": [-0.1, -0.3, -0.1, np.nan],
                "high": [0.9, -0.1, 0.3, np.nan],
                "p_value": [0.2, 0.01, 0.3, np.nan],
                "n": [2, 2, 2, 0],
                "against": ["other pairings", "rigid", "highest", ""],
            }
        ),
        "truth": pd.DataFrame(
            {
                "stage": ["a", "a", "a", "b", "c"],
                "quantity": ["tilt", "tilt", "tilt", "precision", "missing"],
                "patch": ["1", "2", "3", "1", ""],
                "unit": ["mrad", "mrad", "mrad", "1", "um"],
                "true": [1.0, 2.0, 3.0, 1.0, np.nan],
                "recovered": [1.1, 2.1, np.nan, 0.9, 3.0],
            }
        ),
        "published": pd.DataFrame(
            {
                "quantity": ["displacement", "patch pressure", "patch pressure"],
                "patch": [np.nan, "1", "2"],
                "unit": ["um", "MPa", "MPa"],
                "published": [27.0, 8.0, 20.0],
                "computed": [28.0, 9.0, 18.0],
            }
        ),
    }


SIZE = {"patch_size_mm": 0.85}
DRAW = {
    "input": lambda s, **n: figures.input_figure(s["square"], s["pressures"], **SIZE, **n),
    "steps": lambda s, **n: figures.contact_steps_figure(s["macroscale"], **n),
    "rigid": lambda s, **n: figures.elastic_rigid_figure(s["macroscale"], **n),
    "curves": lambda s, **n: figures.macroscale_curves_figure(s["macroscale"], **n),
    "force": lambda s, **n: figures.force_figure(s["macroscale"], s["pressures"], **SIZE, **n),
    "pressure": lambda s, **n: figures.patch_pressure_figure(
        s["pressures"].assign(low_MPa=0.0, high_MPa=90.0), **n
    ),
    "preparation": lambda s, **n: figures.preparation_figure(
        s["prepared"], s["measured"], patch="1", **n
    ),
    "maps": lambda s, **n: figures.microscale_maps_figure(s["contacts"], **n),
    "slip": lambda s, **n: figures.slip_figure(
        {name: contact["height"] for name, contact in s["contacts"].items()}, s["slips"], **n
    ),
    "hardness": lambda s, **n: figures.hardness_figure(s["contacts"], s["limited"], **n),
    "paths": lambda s, **n: figures.microscale_curves_figure(s["contacts"], **n),
    "patch": lambda s, **n: figures.patch_figure(
        s["contacts"]["1"], s["registered"], patch="1", **n
    ),
    "validation": lambda s, **n: figures.validation_figure(
        s["contacts"],
        {name: s["registered"] for name in s["contacts"]},
        *(s[name] for name in ("scores", "gains", "failures", "summary")),
        **n,
    ),
    "truth": lambda s, **n: figures.truth_figure(s["truth"], **n),
    "published": lambda s, **n: figures.published_figure(s["published"], **n),
    "overview": lambda s, **n: figures.overview_figure(
        s["macroscale"],
        s["pressures"],
        s["contacts"]["1"],
        s["registered"],
        patch="1",
        **SIZE,
        **n,
    ),
}


def leaves(value):
    """Every dataset, array and table in a nest of mappings."""
    if isinstance(value, dict):
        for item in value.values():
            yield from leaves(item)
    else:
        yield value


@pytest.mark.parametrize("name", DRAW)
def test_figure_is_drawn_noted_and_leaves_its_input_alone(study, tmp_path, name):
    before = copy.deepcopy(study)
    figure = DRAW[name](study, source_note="generated specimen")
    assert "generated specimen" in [text.get_text() for text in figure.texts]
    figures.save_figure(figure, tmp_path / "figure.png")
    pixels = imread(tmp_path / "figure.png")
    assert pixels[..., :3].min() < 0.3
    assert pixels.shape[1] > 600
    for now, then in zip(leaves(study), leaves(before), strict=True):
        if isinstance(now, pd.DataFrame):
            pd.testing.assert_frame_equal(now, then)
        else:
            xr.testing.assert_identical(now, then)


@pytest.mark.parametrize("name", ["force", "patch", "truth"])
def test_same_input_gives_the_same_bytes(study, tmp_path, name):
    for run in ("a", "b"):
        figures.save_figure(DRAW[name](study), tmp_path / f"{run}.png", tmp_path / f"{run}.svg")
    for kind in ("png", "svg"):
        one, other = ((tmp_path / f"{run}.{kind}").read_bytes() for run in ("a", "b"))
        assert one == other
    assert b"matplotlib" not in (tmp_path / "a.png").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a.svg", "b.png", "b.svg"]


def test_the_last_digits_of_a_layout_do_not_show_in_an_svg(tmp_path):
    """The solver that lays a figure out sums in another order from run to run."""
    for name, width in [("a", 0.8 / 3), ("b", 0.8 / 3 + 1e-14)]:
        figure = new_figure(3, 2)
        figure.set_layout_engine("none")
        figure.add_axes((0.1, 0.1, width, 0.8)).plot([0, 2], [0, 1])
        figures.save_figure(figure, tmp_path / f"{name}.png", tmp_path / f"{name}.svg")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_users_matplotlib_settings_do_not_matter(study, tmp_path):
    figures.save_figure(
        figures.force_figure(study["macroscale"], study["pressures"], **SIZE), tmp_path / "a.png"
    )
    with matplotlib.rc_context({"font.size": 20, "image.cmap": "jet", "savefig.dpi": 40}):
        figures.save_figure(
            figures.force_figure(study["macroscale"], study["pressures"], **SIZE),
            tmp_path / "b.png",
        )
        assert matplotlib.rcParams["font.size"] == 20
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_maps_are_images_in_svg(study, tmp_path):
    figure = DRAW["maps"](study)
    figures.save_figure(figure, tmp_path / "a.png", tmp_path / "a.svg")
    text = (tmp_path / "a.svg").read_text()
    assert text.count("<image") == len(study["contacts"])
    assert len(text) < 1e6
    assert "<dc:date>" not in text


def test_origin_is_at_the_top_right():
    surface = make_surface(np.zeros((10, 20)), 0.1)
    surface[0, 0] = 1.0
    axes = new_figure(4, 2).subplots()
    draw_heights(axes, surface, limits=(0, 1))
    origin, far_x, far_y = axes.transData.transform([(0, 0), (2, 0), (0, 1)])
    assert origin[0] > far_x[0]
    assert origin[1] > far_y[1]
    image = axes.images[0]
    x, y = surface.x.values[0], surface.y.values[0]
    assert image.get_extent() == pytest.approx((0, 2, 0, 1))
    assert image.get_array()[int(y / 0.1), int(x / 0.1)] == 1000


def test_one_element_is_not_lost_when_thickened_and_fades_otherwise():
    surface = make_surface(np.zeros((30, 31)), 0.1)
    mask = np.zeros(surface.shape, dtype=bool)
    mask[7, 30] = True
    axes = new_figure(3, 3).subplots()
    draw_heights(axes, surface)
    draw_mask(axes, surface, mask, "black", block=4, thicken=True)
    draw_mask(axes, surface, mask, "black", block=4)
    thick, fair = (np.asarray(image.get_array())[..., 3] for image in axes.images[1:])
    assert thick[1, 7] == 1
    assert thick.sum() == 1
    assert fair[1, 7] == pytest.approx(1 / 16)
    assert axes.get_xlim() == pytest.approx((3.1, 0))


def test_a_block_has_the_colour_of_most_of_its_marks():
    surface = make_surface(np.zeros((4, 6)), 0.1)
    red, blue = np.zeros((2, 4, 6), dtype=bool)
    red[0, :2], blue[1, 0] = True, True
    blue[0, 2] = True
    axes = new_figure(3, 3).subplots()
    draw_heights(axes, surface)
    draw_classes(axes, surface, {"red": red, "blue": blue}, block=2)
    painted = np.asarray(axes.images[-1].get_array())
    assert painted.shape == (2, 3, 4)
    assert painted[0, 0].tolist() == [1, 0, 0, 1]
    assert painted[0, 1].tolist() == [0, 0, 1, 1]
    assert painted[..., 3].sum() == 2


def test_block_matches_the_panel():
    assert block_of((100, 100), 2.0) == 1
    assert block_of((512, 512), 2.0) == 2
    assert block_of((512, 300), 1.0) == 4


def test_rigid_interpenetration_contains_elastic_contact(study):
    figure = figures.elastic_rigid_figure(study["macroscale"])
    legend = figure.axes[0].get_legend()
    assert [text.get_text().split(":")[0] for text in legend.get_texts()] == [
        "elastic contact",
        "rigid interpenetration",
    ]


def test_patch_figure_shares_the_colours_of_both_epochs(study):
    figure = figures.patch_figure(study["contacts"]["1"], study["registered"], patch="1")
    named = {axes.get_title(): axes for axes in figure.axes if axes.get_title()}
    assert (
        named["T0, before use"].images[0].get_clim() == named["T1, after use"].images[0].get_clim()
    )


def test_validation_figure_says_what_the_tables_say(study):
    figure = DRAW["validation"](study)
    title = figure.get_suptitle()
    assert "in 1 of 2 patches" in title
    assert "does worse than rigid interpenetration (MCC −0.2 [−0.3, −0.1])" in title
    assert "is not told apart from highest points (PR-AUC 0.1 [−0.1, 0.3])" in title
    patches = [axes.get_ylabel() for axes in figure.subfigs[1].axes if axes.get_ylabel()]
    # the hardest pressed first
    pressures = [float(label.split("\n")[1].removesuffix(" MPa")) for label in patches]
    assert len(patches) == 3
    assert pressures == sorted(pressures, reverse=True)


@pytest.mark.parametrize("name", ["patch", "overview", "validation"])
def test_a_patch_of_whose_change_nothing_is_known_can_be_drawn(study, tmp_path, name):
    study["registered"] = no_change(study["contacts"]["1"]["height"]).assign_attrs(overlap=0.9)
    figures.save_figure(DRAW[name](study), tmp_path / "a.png")


def test_validation_leaves_out_a_studied_patch_without_t1(study):
    del study["contacts"]["2"]
    figure = figures.validation_figure(
        study["contacts"],
        {name: study["registered"] for name in study["contacts"]},
        study["scores"][study["scores"].patch != "2"],
        *(study[name] for name in ("gains", "failures", "summary")),
        pressures={"1": 30.0, "2": 40.0, "3": 5.0},
    )
    worn = next(axes for axes in figure.subfigs[0].axes if "worn" in axes.get_title())
    named = {text.get_text() for text in worn.texts}
    assert {"1", "3"} <= named
    assert "2" not in named


def texts_of(figure):
    return " ".join(text.get_text() for text in figure.findobj(matplotlib.text.Text))


def test_validation_of_few_patches_shows_no_p_value_and_no_interval(study):
    """Of 3 to 5 patches there is a rank correlation, but no interval, and of 3 no p-value."""
    study["summary"][["low", "high", "p_value"]] = np.nan
    said = texts_of(DRAW["validation"](study))
    assert "Spearman ρ = 0.5" in said
    assert "nan" not in said
    assert "bootstrap" not in said


def test_validation_of_many_patches_says_what_its_intervals_are(study):
    said = texts_of(DRAW["validation"](study))
    assert "Spearman ρ = 0.5 [−0.1, 0.9]\np = 0.20" in said
    assert "Bars and brackets: 95 % bootstrap over patches." in said


@pytest.mark.parametrize("count", [1, 2])
def test_validation_of_few_patches_can_be_drawn(study, tmp_path, count):
    study["contacts"] = dict(list(study["contacts"].items())[:count])
    study["summary"] = study["summary"][:0]
    figures.save_figure(DRAW["validation"](study), tmp_path / "a.png")


def test_a_study_without_t1_and_without_patches_can_be_drawn(study, tmp_path):
    one = {"T0": study["prepared"]["T0"]}
    figures.save_figure(
        figures.preparation_figure(one, study["measured"], patch="1"), tmp_path / "a.png"
    )
    figure = figures.overview_figure(
        study["macroscale"],
        study["pressures"],
        study["contacts"]["1"],
        None,
        patch="1",
        **SIZE,
    )
    assert len(figure.axes) == 3
    for draw in (figures.microscale_maps_figure, figures.microscale_curves_figure):
        figures.save_figure(draw({}), tmp_path / "b.png")
    assert len(list(tmp_path.iterdir())) == 2
