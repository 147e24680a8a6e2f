"""Gridding: the right sheet, exactly where it is linear, converging where it is curved."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from gstlib.errors import InputError
from gstlib.preprocess.frame import Frame
from gstlib.preprocess.gridding import grid_mesh

UP = Frame(origin=(0, 0, 0), x_axis=(1, 0, 0), normal=(0, 0, 1))


def sheet(function, edge=0.25, low=-1.5, high=6.5, seed=0):
    """An open mesh z = function(x, y) on jittered points, faces looking up."""
    from scipy.spatial import Delaunay

    axis = np.arange(low, high + edge / 2, edge)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    inner = ((points > low) & (points < axis[-1])).all(axis=1)
    jitter = np.random.default_rng(seed).uniform(-0.3, 0.3, points.shape) * edge
    points = points + jitter * inner[:, None]
    faces = Delaunay(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    turned = np.cross(np.c_[b - a, 0 * a[:, 0]], np.c_[c - a, 0 * a[:, 0]])[:, 2] < 0
    faces[turned] = faces[turned][:, ::-1]
    return trimesh.Trimesh(np.c_[points, function(*points.T)], faces, process=False)


def grid(mesh, frame=UP, *, margin_mm=1.0):
    return grid_mesh(
        mesh, frame, size_mm=5.0, shape=(40, 50), margin_mm=margin_mm, source="stone.stl"
    )


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-2, 2), st.integers(0, 100))
def test_plane_is_exact(slope_x, slope_y, offset, seed):
    plane = sheet(lambda x, y: offset + slope_x * x + slope_y * y, edge=0.5, seed=seed)
    surface = grid(plane)
    expected = (offset + slope_x * surface.x + slope_y * surface.y).transpose("y", "x").values
    np.testing.assert_allclose(surface.values, expected, atol=1e-9)


def test_grid_is_the_square():
    surface = grid(sheet(lambda x, y: 0 * x))
    assert surface.shape == (40, 50)
    assert 29**2 <= surface.attrs["mesh_points"] < 33**2  # the crop's, of 33² vertices
    assert surface.y.attrs["spacing"] == 5 / 40
    assert surface.x.attrs["spacing"] == 5 / 50
    assert surface.x.values[0] == pytest.approx(0.05)
    assert surface.attrs["mesh_edge_mm"] == pytest.approx(0.28, rel=0.1)


def hills(x, y):
    return 0.1 * np.sin(1.3 * x) * np.cos(0.9 * y)


def test_converges_at_second_order():
    errors = []
    for edge in (0.5, 0.25, 0.125):
        surface = grid(sheet(hills, edge=edge))
        exact = hills(*np.meshgrid(surface.x, surface.y))
        errors.append(np.sqrt(np.mean((surface.values - exact) ** 2)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (rates > 1.7).all(), errors


def on_top(radius):
    """A square of 5 mm on the top of a ball, 0.2 mm off its surface."""
    return Frame(origin=(2.5, 2.5, radius + 0.2), x_axis=(-1, 0, 0), normal=(0, 0, 1))


@pytest.mark.parametrize("radius", [20.0, 4.0])  # the small one is in the crop with both its sides
def test_ball_gives_the_side_that_the_normal_leaves(radius):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    surface = grid(ball, on_top(radius), margin_mm=2.0)
    x, y = np.meshgrid(surface.x - 2.5, surface.y - 2.5)
    exact = np.sqrt(radius**2 - x**2 - y**2) - radius - 0.2
    np.testing.assert_allclose(surface.values, exact, atol=0.02)


def test_closed_mesh_inside_out_is_turned(caplog):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=20)
    below = np.argsort(ball.triangles_center[:, 2]) < 3
    ball.update_faces(~below)  # pin-holes, as scanners leave them
    right = grid(ball, on_top(20))
    ball.invert()
    np.testing.assert_array_equal(grid(ball, on_top(20)).values, right.values)
    assert "inside out" in caplog.text


def test_speck_over_the_surface_is_not_the_use_face():
    plane = sheet(lambda x, y: 0 * x - 0.5)
    speck = sheet(lambda x, y: 0 * x, low=1.0, high=2.0)
    surface = grid(trimesh.util.concatenate([plane, speck]))
    np.testing.assert_allclose(surface.values, -0.5, atol=1e-12)


def innermost(mesh):
    """Mask of the face at the middle of the square."""
    distance = np.linalg.norm(mesh.triangles_center[:, :2] - 2.5, axis=1)
    return np.arange(len(mesh.faces)) == distance.argmin()


def test_pin_hole_is_bridged(caplog):
    plane = sheet(lambda x, y: 0.1 * x)
    plane.update_faces(~innermost(plane))
    surface = grid(plane)
    np.testing.assert_allclose(surface.values, 0.1 * np.broadcast_to(surface.x, (40, 50)))
    assert "holes of the mesh were bridged" in caplog.text


def test_a_face_turned_over_is_bridged_and_many_are_refused(caplog):
    plane = sheet(lambda x, y: 0.1 * x)
    wrong = innermost(plane)
    plane.faces[wrong] = plane.faces[wrong][:, ::-1]
    np.testing.assert_allclose(grid(plane).values, 0.1 * np.broadcast_to(grid(plane).x, (40, 50)))
    many = np.linalg.norm(plane.triangles_center[:, :2] - 2.5, axis=1) < 1.0
    plane.faces[many] = plane.faces[many][:, ::-1]
    refused("faces turned inside out", plane)


def refused(match, mesh, frame=UP):
    with pytest.raises(InputError, match=match) as caught:
        grid(mesh, frame)
    assert "stone.stl" in str(caught.value)


def test_square_beside_the_mesh():
    plane = sheet(lambda x, y: 0 * x)
    beside = Frame((100, 0, 0), (1, 0, 0), (0, 0, 1))
    refused(
        r"no part of the mesh.*x -101\.5 to -93\.5 and y -1\.5 to 6\.5 mm.*mesh_unit", plane, beside
    )
    refused("no part of the mesh", sheet(lambda x, y: 0 * x, high=-0.5))  # in the crop alone


def test_mesh_in_metres_covers_nothing():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    refused("mesh_unit", ball, on_top(50))


def test_square_that_sticks_out_says_how_much_and_where():
    refused(
        r"sticks out of the mesh.*20 % of the square \(x 4\.05 to 4\.95, y 0\.\d+ to 4\.9\d* mm\)",
        sheet(lambda x, y: 0 * x, low=-2.0, high=9.0),
        Frame((5.0, 0, 0), (1, 0, 0), (0, 0, 1)),
    )


def test_hole_in_the_mesh():
    plane = sheet(lambda x, y: 0 * x)
    plane.update_faces(np.linalg.norm(plane.triangles_center[:, :2] - 2.5, axis=1) > 0.8)
    refused(r"the mesh has a hole.* % of the square \(x 1\.", plane)


def test_faces_that_look_inwards():
    shell = sheet(hills)
    inwards = Frame((0, 5, 0), (1, 0, 0), (0, 0, -1))
    refused("look against the frame's normal.*normal points into the stone", shell, inwards)
    shell.invert()
    refused("look against the frame's normal.*turn the mesh's faces", shell)
    ball = trimesh.creation.icosphere(subdivisions=5, radius=20)
    refused("look against the frame's normal", ball, Frame((-2.5, 2.5, 20), (1, 0, 0), (0, 0, -1)))


def test_overhang():
    # A wave that breaks: the surface leans over by more than it advances.
    flat = sheet(lambda x, y: 0 * x, edge=0.1)
    x, y, _ = flat.vertices.T
    crest = np.exp(-((x - 2.5) ** 2))
    flat.vertices = np.c_[x + 2.0 * crest, y, 1.5 * crest]
    refused(r"folds over within the square: .* % of the square .* two heights", flat)
