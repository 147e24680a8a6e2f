"""Pictures of the whole stone: what is nearest is seen, and the square where it lies."""

import io

import numpy as np
import pandas as pd
import pytest
import trimesh
from matplotlib.figure import Figure

from gstlib.figures.tool import check_figure, draw_square, draw_stone
from gstlib.preprocess.frame import Frame

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


@pytest.mark.parametrize(("view", "colour"), [(ABOVE, 0), (BELOW, 2)])
def test_only_the_nearest_is_seen(view, colour):
    mesh = stone()
    colours = np.zeros((len(mesh.vertices), 3), np.uint8)
    up = mesh.vertices[:, 2] > 0
    colours[up, 0] = colours[~up, 2] = 255  # red above, blue below
    axes = panel()
    draw_stone(axes, mesh, view, colours=colours)
    middle = pixels(axes.figure)[65:85, 65:85, :3]
    assert (middle.argmax(axis=2) == colour).all()
    assert middle[..., colour].min() > 50
    assert middle[..., 2 - colour].max() < 60  # seams between triangles are not quite shut


def test_a_part_before_another_hides_it():
    small = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    small.apply_translation((0, 0, 30))
    mesh = trimesh.util.concatenate([small, stone()])
    colours = np.zeros((len(mesh.vertices), 3), np.uint8)
    colours[: len(small.vertices), 2] = colours[len(small.vertices) :, 0] = 255
    for view, colour in ((ABOVE, 2), (BELOW, 0)):
        axes = panel()
        draw_stone(axes, mesh, view, colours=colours)
        assert (pixels(axes.figure)[70:80, 70:80, :3].argmax(axis=2) == colour).all()


def test_the_light_comes_from_the_upper_left():
    axes = panel()
    draw_stone(axes, stone(), ABOVE)
    picture = pixels(axes.figure)[..., :3].mean(axis=2)
    assert picture[50, 50] > picture[100, 100] + 30


def test_the_square_is_outlined_in_a_view():
    axes = panel()
    view = Frame((0, 0, 0), (-1, 0, 0), (0, 0, 1))
    draw_square(axes, view, Frame((2.5, 2.5, 19.5), (-1, 0, 0), (0, 0, 1)), 5.0)
    (corner,), (outline,) = axes.lines, axes.patches
    assert np.allclose(np.ravel(corner.get_data()), [-2.5, -2.5])
    assert np.ptp(outline.get_xy(), axis=0) == pytest.approx([5, 5])
    assert {text.get_text(): text.get_position() for text in axes.texts} == {
        "x": pytest.approx((4.25, -2.5)),
        "y": pytest.approx((-2.5, 4.25)),
    }


def test_the_check_has_a_picture_even_where_the_square_cannot_be_gridded():
    frame = Frame((2.5, 2.5, 30), (-1, 0, 0), (0, 0, 1))
    sizes = {"size_mm": 5.0, "patch_size_mm": 0.85}
    assert len(check_figure(stone(), frame, None, pd.DataFrame(), **sizes).axes) == 2
