"""Gridding: the right sheet, exact on a flat mesh, and how left-out vertices are predicted."""

import numpy as np
import pytest
import trimesh
from mesh_files import sheet
from numpy.testing import assert_allclose, assert_array_equal
from stones import waves

from gstlib.errors import InputError, accepting
from gstlib.macroscale.face import grid_macroscale, thin_stone
from gstlib.preprocess.mesh import grid_mesh, gridding_table
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.frames import Frame

KINDS = ["linear", "clough-tocher", "cubic"]


def at(*origin, normal=1):
    return Frame(origin=origin, x_axis=(1, 0, 0), normal=(0, 0, normal))


UP = at(0, 0, 0)


def gridded(mesh, frame=UP, **other):
    settings = {"size_mm": 5.0, "grid": 40, "source": "stone.stl"}
    return grid_mesh(mesh, frame, **settings | other)


def grid(mesh, frame=UP, **other):
    return gridded(mesh, frame, **{"interpolation": "linear"} | other).height


def hills(x, y):
    return 0.1 * np.sin(1.3 * x) * np.cos(0.9 * y)


def slope(x, y):
    return 0.3 + 0.1 * x - 0.2 * y


def errors_of(surface, function):
    return surface.values - function(*np.meshgrid(surface.x, surface.y))


# --- The use-face -----------------------------------------------------------------------------


def test_a_speck_over_the_surface_is_not_the_use_face():
    """It covers a third of the square, and lies nearer to its plane."""
    speck = sheet(lambda x, y: 0 * x, low=1.0, high=4.0)
    plane = sheet(lambda x, y: 0 * x - 0.5)
    surface = grid(trimesh.util.concatenate([plane, speck]))
    assert_allclose(surface.values, -0.5, atol=1e-12)


def stone_with_flap():
    """A ball, and a triangle that hangs on its top and looks down, under 1 % of the square."""
    ball = trimesh.creation.icosphere(5, radius=20.0)
    top = ball.vertices[ball.vertices[:, 2].argmax()]
    corners = np.add(top, [[0, 0, 0], [0.6, 0, -0.02], [0, 0.6, -0.02]])
    both = ball + trimesh.Trimesh(corners, [[0, 2, 1]])
    both.merge_vertices()
    return both


def plate():
    box = trimesh.creation.box([20.0, 20.0, 0.5]).subdivide_to_size(0.5)
    return box.apply_translation([0, 0, 19.75])


@pytest.mark.parametrize(
    ("stone", "thickness", "faults"),
    [(stone_with_flap, 39.5, []), (plate, 0.5, ["thickness"])],
)
def test_the_thickness_is_that_of_the_stone(stone, thickness, faults):
    # a square on the top of the ball, 0.2 mm off its surface
    frame = Frame(origin=(2.5, 2.5, 20.2), x_axis=(-1, 0, 0), normal=(0, 0, 1))
    surface = grid(stone(), frame)
    assert float(surface.max()) == pytest.approx(-0.2, abs=0.02)
    assert surface.attrs["thickness_mm"] == pytest.approx(thickness, abs=0.3)
    assert [fault.name for fault in thin_stone(surface, source="mesh")] == faults


def near(mesh, radius):
    """Mask of the faces around the middle of the square; the innermost alone for a radius of 0."""
    distance = np.linalg.norm(mesh.triangles_center[:, :2] - 2.5, axis=1)
    return distance <= max(radius, distance.min())


def without(radius):
    """A slope without the faces around the middle of the square."""
    plane = sheet(slope)
    plane.update_faces(~near(plane, radius))
    return plane


def turned_over(radius):
    """A slope that shows the backs of the faces around the middle of the square."""
    plane = sheet(slope)
    is_near = near(plane, radius)
    plane.faces[is_near] = plane.faces[is_near][:, ::-1]
    return plane


@pytest.mark.parametrize("damaged", [without, turned_over])
def test_a_pin_hole_or_a_face_turned_over_is_bridged(damaged, caplog):
    surface = grid(damaged(0))
    assert np.abs(errors_of(surface, slope)).max() < 1e-9
    assert "holes of the mesh were bridged" in caplog.text


def leaning():
    """A flat that rises to a crest, which leans over by more than it advances."""
    flat = sheet(lambda x, y: 0 * x, edge=0.1)
    x, y, _ = flat.vertices.T
    crest = 2 * np.exp(-((x - 2.5) ** 2))
    flat.vertices = np.c_[x + crest, y, crest]
    return flat


def test_an_unknown_interpolation_is_refused():
    with pytest.raises(InputError, match="interpolation: is 'spline'"):
        grid(sheet(hills), interpolation="spline")


@pytest.mark.parametrize(
    ("match", "mesh", "frame"),
    [
        ("no part of the mesh", sheet(hills), at(100, 0, 0)),
        (r"20 % of the square \(x 4\.0", sheet(hills), at(2.5, 0, 0)),
        ("the mesh has a hole", without(0.8), UP),
        ("points 2 and 3", sheet(hills), at(0, 5, 0, normal=-1)),
        ("folds over within the square", leaning(), UP),
        ("finer mesh", sheet(hills, edge=1.3), UP),
    ],
)
def test_a_square_that_cannot_be_gridded(match, mesh, frame):
    with pytest.raises(InputError, match=rf"(?s)stone\.stl.*{match}"):
        grid(mesh, frame)


# --- Left-out vertices ------------------------------------------------------------------------


def test_on_a_smooth_surface_a_smooth_interpolation_is_best():
    smooth = waves(3, 2.0, 10.0, 0.05)
    mesh = sheet(smooth, edge=0.4)
    best = gridded(mesh)
    chosen = best.height.attrs["interpolation"]
    rms = best.left_out_rms.to_series()
    assert list(rms.index) == KINDS
    assert max(rms[1:]) < 0.8 * rms["linear"]
    assert chosen == rms.idxmin()
    heights = {kind: grid(mesh, interpolation=kind) for kind in (chosen, "linear")}
    assert_array_equal(best.height, heights[chosen])
    errors = {kind: errors_of(height, smooth).std() for kind, height in heights.items()}
    assert errors[chosen] < 0.5 * errors["linear"]
    table = gridding_table(best)
    assert table.interpolation[table.chosen].tolist() == [chosen]
    assert_array_equal(table.left_out_rms_um, 1e3 * rms)


# --- The face around the square ----------------------------------------------------------------


def test_the_face_continues_the_square():
    """The same heights in the square, the mesh's around it, the square's corner at (0, 0)."""
    mesh = sheet(hills, low=-3.0, high=8.0)
    square, face = (grid(mesh, around=around) for around in (0, 8))
    assert_allclose(face.x, (np.arange(56) - 7.5) * 0.125, atol=1e-12)
    assert_allclose(square_of(face, 5.0), square, atol=1e-12)
    assert np.abs(errors_of(face, hills)).max() < 0.01


def macroscale(mesh, face_mm):
    square, _ = grid_macroscale(
        mesh,
        points_mm=[[0, 0, 0], [5, 0, 0], [0, 5, 0]],
        size_mm=5.0,
        grid=20,
        face_mm=face_mm,
        interpolation="linear",
        source="stone.stl",
    )
    return square.height


def test_an_edge_of_the_mesh_in_the_face_is_no_stone_and_is_warned_of(caplog):
    sound = macroscale(sheet(hills, low=-4.0, high=9.0), 10.0)
    assert not np.isnan(sound).any()
    assert caplog.messages == []
    cut = macroscale(sheet(hills, low=-4.0, high=6.5), 10.0)
    assert "of the face of 10 mm" in caplog.text
    is_beyond = (cut.x > 6.5) | (cut.y > 6.5)
    assert_array_equal(np.isnan(cut), is_beyond.transpose("y", "x"))
    # planes are those of the square
    assert_allclose(cut, sound.where(~is_beyond), atol=0.01)


def test_a_face_mostly_beyond_the_stone_is_refused_unless_accepted():
    with pytest.raises(
        InputError, match=r"6\d % of the face of 13 mm lies beyond the stone"
    ):
        macroscale(sheet(hills), 13.0)
    with accepting(["face"]):
        assert np.isnan(macroscale(sheet(hills), 13.0)).mean() > 0.6
