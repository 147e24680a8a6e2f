"""Pictures of the whole stone: what is nearest is seen, and the square where it lies."""

import io

import numpy as np
import pandas as pd
import pytest
import trimesh
import xarray as xr
from gst.figures.maps import draw_footprints
from gst.figures.tool import check_figure, draw_square, draw_stone
from gstlib.geometry import Frame
from gstlib.surface import make_surface
from matplotlib.figure import Figure

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


def painted(mesh, blue):
    """Blue vertices among red ones."""
    return np.where(blue[:, None], [[0, 0, 255]], [[255, 0, 0]]).astype(np.uint8)


@pytest.mark.parametrize(("view", "colour"), [(ABOVE, 0), (BELOW, 2)])
def test_only_the_nearest_is_seen(view, colour):
    """Of a ball, red above; and of two balls, of which the blue one is above."""
    ball = stone()
    small = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    small.apply_translation((0, 0, 30))
    two = trimesh.util.concatenate([small, stone()])
    is_small = np.arange(len(two.vertices)) < len(small.vertices)
    for mesh, blue, seen in ((ball, ball.vertices[:, 2] <= 0, colour), (two, is_small, 2 - colour)):
        axes = panel()
        draw_stone(axes, mesh, view, colours=painted(mesh, blue))
        middle = pixels(axes.figure)[70:80, 70:80, :3]
        assert (middle.argmax(axis=2) == seen).all()
        assert middle[..., seen].min() > 50
        assert middle[..., 2 - seen].max() < 60  # seams between triangles are not quite shut


def test_the_light_comes_from_the_upper_left():
    axes = panel()
    draw_stone(axes, stone(), ABOVE)
    picture = pixels(axes.figure)[..., :3].mean(axis=2)
    assert picture[50, 50] > picture[100, 100] + 30


def test_the_square_is_outlined_in_a_view():
    axes = panel()
    view = Frame((0, 0, 0), (-1, 0, 0), (0, 0, 1))
    draw_square(axes, view, Frame((2.5, 2.5, 19.5), (-1, 0, 0), (0, 0, 1)), 5.0)
    (outline,) = axes.patches
    assert np.allclose(outline.get_xy()[0], [-2.5, -2.5])
    assert np.ptp(outline.get_xy(), axis=0) == pytest.approx([5, 5])
    assert {text.get_text(): text.get_position() for text in axes.texts} == {
        "x": pytest.approx((4.25, -2.5)),
        "y": pytest.approx((-2.5, 4.25)),
    }


def test_the_check_has_a_picture_even_where_the_square_cannot_be_gridded():
    frame = Frame((2.5, 2.5, 30), (-1, 0, 0), (0, 0, 1))
    sizes = {"size_mm": 5.0, "patch_size_mm": 0.85}
    assert len(check_figure(stone(), frame, None, pd.DataFrame(), **sizes).axes) == 2


def test_the_check_shows_the_active_stone_and_where_it_is_pushed():
    frame = Frame((2.5, 2.5, 30), (-1, 0, 0), (0, 0, 1))
    height, round_stone = np.zeros((6, 6)), -0.1 * np.hypot(*np.mgrid[-2.5:3, -2.5:3]) ** 2
    face = xr.Dataset({"height": make_surface(height, 2.0)})
    face["counterface"] = face.height.copy(data=round_stone)
    pushed = np.array([[1.0, 2.0], [3.0, 4.0]])
    sizes = {"size_mm": 5.0, "patch_size_mm": 0.85}
    figure = check_figure(stone(), frame, None, pd.DataFrame(), face=face, pushed=pushed, **sizes)
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
