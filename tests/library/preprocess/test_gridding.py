"""Gridding: the right sheet, exactly where it is linear, converging where it is curved; and how
well left-out vertices are predicted."""

import numpy as np
import pytest
import trimesh
from gstlib.errors import InputError, accepting
from gstlib.macroscale.face import grid_macroscale, thin_stone
from gstlib.preprocess import interpolation, use_face
from gstlib.preprocess.mesh import grid_mesh, gridding_table
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.frames import Frame
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

KINDS = ["linear", "clough-tocher", "cubic"]
UP = Frame(origin=(0, 0, 0), x_axis=(1, 0, 0), normal=(0, 0, 1))


def sheet(function, edge=0.25, low=-1.5, high=6.5, seed=0):
    """An open mesh z = function(x, y) on jittered points, faces looking up."""
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


def gridded(mesh, frame=UP, **other):
    settings = {"size_mm": 5.0, "grid": 40, "source": "stone.stl"}
    return grid_mesh(mesh, frame, **settings | other)


def grid(mesh, frame=UP, **other):
    return gridded(mesh, frame, **{"interpolation": "linear"} | other).height


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-2, 2), st.integers(0, 100))
def test_plane_is_exact(slope_x, slope_y, offset, seed):
    plane = sheet(lambda x, y: offset + slope_x * x + slope_y * y, edge=0.5, seed=seed)
    surface = grid(plane)
    expected = (offset + slope_x * surface.x + slope_y * surface.y).transpose("y", "x").values
    np.testing.assert_allclose(surface.values, expected, atol=1e-9)


def hills(x, y):
    return 0.1 * np.sin(1.3 * x) * np.cos(0.9 * y)


def test_converges_at_second_order():
    errors = []
    for edge in (0.5, 0.25, 0.125):
        surface = grid(sheet(hills, edge=edge), grid=47)  # elements at all places between vertices
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
    surface = grid(ball, on_top(radius))
    x, y = np.meshgrid(surface.x - 2.5, surface.y - 2.5)
    exact = np.sqrt(radius**2 - x**2 - y**2) - radius - 0.2
    np.testing.assert_allclose(surface.values, exact, atol=0.02)


@pytest.mark.parametrize("high", [2.0, 4.0])  # the larger covers a third of the square
def test_speck_over_the_surface_is_not_the_use_face(high):
    plane = sheet(lambda x, y: 0 * x - 0.5)
    speck = sheet(lambda x, y: 0 * x, low=1.0, high=high)
    surface = grid(trimesh.util.concatenate([plane, speck]))
    np.testing.assert_allclose(surface.values, -0.5, atol=1e-12)


def ball_with(*others):
    """A stone of 40 mm, and other bodies."""
    return trimesh.util.concatenate([trimesh.creation.icosphere(5, radius=20.0), *others])


def ball_with_flap():
    """A ball, and a triangle that hangs on its top and looks down, under 1 % of the square."""
    ball = ball_with()
    top = int(ball.vertices[:, 2].argmax())
    corners = ball.vertices[top] + [[0.6, 0.0, -0.02], [0.0, 0.6, -0.02]]
    last = len(ball.vertices)
    faces = np.vstack([ball.faces, [[top, last + 1, last]]])
    return trimesh.Trimesh(np.vstack([ball.vertices, corners]), faces, process=False)


def cavity():
    """The inside of a hollow ball."""
    ball = trimesh.creation.icosphere(5, radius=19.5)
    ball.invert()
    return ball


def plate(thickness):
    box = trimesh.creation.box([20.0, 20.0, thickness]).subdivide_to_size(0.5)
    return box.apply_translation([0, 0, 20.0 - thickness / 2])


@pytest.mark.parametrize(
    ("mesh", "thickness", "is_fault"),
    [
        (ball_with(), 39.5, False),
        (ball_with_flap(), 39.5, False),
        (ball_with(cavity()), 39.5, False),
        (plate(0.5), 0.5, True),
        (plate(1.5), 1.5, False),
    ],
)
def test_the_thickness_is_that_of_the_stone(mesh, thickness, is_fault):
    surface = grid(mesh, on_top(20.0))
    assert surface.attrs["thickness_mm"] == pytest.approx(thickness, abs=0.3)
    assert [fault.name for fault in thin_stone(surface, source="mesh")] == ["thickness"] * is_fault


@pytest.mark.parametrize(("apart", "is_warned"), [(0.01, True), (0.3, True), (2.0, False)])
def test_a_stone_that_was_scanned_twice_is_warned_of(caplog, apart, is_warned):
    grid(trimesh.util.concatenate([sheet(hills), sheet(lambda x, y: hills(x, y) + apart)]))
    assert ("second surface" in caplog.text) == is_warned


def near(mesh, radius):
    """Mask of the faces around the middle of the square; the innermost alone for a radius of 0."""
    distance = np.linalg.norm(mesh.triangles_center[:, :2] - 2.5, axis=1)
    return distance <= max(radius, distance.min())


def without(faces, **where):
    """A slope without the faces that a function of the mesh selects."""
    plane = sheet(lambda x, y: 0.1 * x, **where)
    plane.update_faces(~faces(plane))
    return plane


def turned_over(faces):
    """A slope that shows the backs of the faces that a function of the mesh selects."""
    plane = sheet(lambda x, y: 0.1 * x)
    plane.faces[faces(plane)] = plane.faces[faces(plane)][:, ::-1]
    return plane


@pytest.mark.parametrize("damaged", [without, turned_over])
def test_a_pin_hole_or_a_face_turned_over_is_bridged(damaged, caplog):
    surface = grid(damaged(lambda mesh: near(mesh, 0)))
    np.testing.assert_allclose(surface.values, 0.1 * np.broadcast_to(surface.x, (40, 40)))
    assert "holes of the mesh were bridged" in caplog.text


def corner(mesh):
    return mesh.vertices[mesh.faces, :2].sum(axis=2).max(axis=1) >= 9.8


def leaning(by, over, width, **where):
    """A flat that rises to a crest at x = `over`, which leans over by more than it advances."""
    flat = sheet(lambda x, y: 0 * x, edge=0.1, **where)
    x, y, _ = flat.vertices.T
    crest = np.exp(-(((x - over) / width) ** 2))
    flat.vertices = np.c_[x + by * crest, y, by * crest]
    return flat


def at(x, y=0.0, normal=1.0):
    return Frame((x, y, 0), (1, 0, 0), (0, 0, normal))


@pytest.mark.parametrize(
    ("match", "mesh", "frame"),
    [
        ("no part of the mesh", sheet(hills), at(100)),
        (r"20 % of the square \(x 4\.06 to 4\.94", sheet(hills, low=-2.0, high=9.0), at(5)),
        ("sticks out", without(corner), UP),
        ("the mesh has a hole", without(lambda mesh: near(mesh, 0.8)), UP),
        ("faces turned inside out", turned_over(lambda mesh: near(mesh, 1.0)), UP),
        ("points 2 and 3", sheet(hills), at(0, 5, -1)),
        ("turn the mesh's faces", turned_over(lambda mesh: near(mesh, 99)), UP),
        ("folds over within the square", leaning(2.0, 2.5, 1.0), UP),
        ("finer mesh", sheet(hills, edge=1.3), UP),
    ],
)
def test_a_square_that_cannot_be_gridded(match, mesh, frame):
    with pytest.raises(InputError, match=match) as caught:
        grid(mesh, frame)
    assert "stone.stl" in str(caught.value)


# --- Left-out vertices ------------------------------------------------------------------------


def smooth(x, y):
    """Some waves at random, none shorter than 2 mm."""
    rng = np.random.default_rng(3)
    (a, b), phase = rng.uniform(-2.2, 2.2, (12, 2)).T, rng.uniform(0, 6, 12)
    return 0.02 * np.sin(x[..., None] * a + y[..., None] * b + phase).sum(axis=-1)


def rms_of(surface):
    return dict(zip(KINDS, surface.left_out_rms.values, strict=True))


def test_on_a_smooth_surface_a_smooth_interpolation_is_best():
    mesh = sheet(smooth, edge=0.4)
    best = gridded(mesh)
    rms, chosen = rms_of(best), best.height.attrs["interpolation"]
    assert max(rms["clough-tocher"], rms["cubic"]) < 0.8 * rms["linear"]
    assert chosen == min(KINDS[1:], key=rms.get)
    exact = smooth(*np.meshgrid(best.x, best.y))
    errors = {kind: np.std(grid(mesh, interpolation=kind) - exact) for kind in KINDS}
    assert errors[chosen] < 0.5 * errors["linear"]
    np.testing.assert_array_equal(best.height, grid(mesh, interpolation=chosen))


@pytest.mark.parametrize(
    ("rms", "chosen"),
    [
        ([1.009, 1.005, 1.0], "linear"),
        ([1.02, 1.009, 1.0], "clough-tocher"),
        ([1.02, 1.02, 1.0], "cubic"),
        ([1.0, 1.02, np.inf], "linear"),
    ],
)
def test_a_tie_goes_to_the_simpler(rms, chosen, monkeypatch):
    errors = 1e-3 * np.array(rms)[:, None] * [1.0, -1.0]
    monkeypatch.setattr(
        interpolation, "_left_out", lambda cloud, inside, tried: (inside[:2], errors)
    )
    surface = gridded(sheet(smooth, edge=0.5))
    assert surface.height.attrs["interpolation"] == chosen
    np.testing.assert_allclose(surface.left_out_rms, 1e-3 * np.array(rms))
    np.testing.assert_array_equal(surface.left_out_error, errors[KINDS.index(chosen)])


def test_errors_are_those_of_a_group_left_out(monkeypatch):
    mesh = sheet(smooth)
    monkeypatch.setattr(use_face, "_MARGIN_MM", 9.0)  # the cloud is the whole sheet
    surface = gridded(mesh, interpolation="linear")
    x, y, z = mesh.vertices.T
    inside = np.flatnonzero((np.abs(x - 2.5) <= 2.5) & (np.abs(y - 2.5) <= 2.5))
    np.testing.assert_array_equal(surface.vertex_x, x[inside])
    np.testing.assert_array_equal(surface.vertex_y, y[inside])
    group = np.random.default_rng(1).permutation(len(inside)) % 8 == 3
    others, left = np.setdiff1d(np.arange(len(x)), inside[group]), inside[group]
    predicted = LinearNDInterpolator(mesh.vertices[others, :2], z[others])
    errors = z[left] - predicted(mesh.vertices[left, :2])
    np.testing.assert_allclose(surface.left_out_error[group], errors, atol=1e-12)
    everywhere = np.sqrt(np.mean(surface.left_out_error**2))
    np.testing.assert_allclose(surface.left_out_rms.sel(candidate="linear"), everywhere)


def test_vertices_in_lines_allow_no_cubic():
    points = np.stack(np.meshgrid(np.arange(-0.8, 5.9, 0.03), np.arange(-0.8, 6.5, 0.8)), axis=-1)
    x, y = points.reshape(-1, 2).T
    faces = Delaunay(np.c_[x, y]).simplices
    best = gridded(trimesh.Trimesh(np.c_[x, y, smooth(x, y)], faces, process=False))
    assert rms_of(best)["cubic"] == np.inf
    assert best.height.attrs["interpolation"] != "cubic"


def macroscale(mesh, face_mm=None, interpolation="linear"):
    settings = {"size_mm": 5.0, "grid": 20, "source": "stone.stl"}
    points = [[0, 0, 0], [5, 0, 0], [0, 5, 0]]
    return grid_macroscale(
        mesh, points_mm=points, face_mm=face_mm, interpolation=interpolation, **settings
    )[0]


def test_the_square_is_stored_level_with_the_errors_of_each_interpolation():
    mesh = sheet(lambda x, y: smooth(x, y) + 0.1 * x)
    surface = macroscale(mesh, interpolation="best")
    assert abs(np.polyfit(surface.x, surface.height.mean("y"), 1)[0]) < 1e-9
    table = gridding_table(surface)
    assert list(table.interpolation) == KINDS
    assert table.chosen.sum() == 1
    np.testing.assert_array_equal(table.left_out_rms_um, 1e3 * gridded(mesh).left_out_rms)
    alone = gridding_table(macroscale(mesh))
    assert (alone.interpolation.tolist(), alone.chosen.tolist()) == (["linear"], [True])


# --- The face around the square ----------------------------------------------------------------


def test_the_face_continues_the_square():
    """The same heights in the square, the mesh's around it, the square's corner at (0, 0)."""
    mesh = sheet(hills, low=-5.0, high=10.0)
    square, face = (grid(mesh, around=around) for around in (0, 16))
    assert face.shape == (72, 72)
    np.testing.assert_allclose(face.x.values, (np.arange(72) - 15.5) * 0.125, atol=1e-12)
    assert square.attrs["mesh_edge_mm"] == pytest.approx(0.28, rel=0.1)
    np.testing.assert_allclose(square_of(face, 5.0), square, atol=1e-12)
    exact = hills(*np.meshgrid(face.x, face.y))
    np.testing.assert_allclose(face, exact, atol=0.01)


def test_a_cubic_on_nodes_is_that_on_every_element(monkeypatch):
    """Where elements are much smaller than the mesh's edges, nodes hold the cubic."""
    mesh = sheet(smooth, edge=0.4)
    found = grid(mesh, interpolation="cubic")
    monkeypatch.setattr(interpolation, "_POINTS_PER_EDGE", 1e3)
    on_all = grid(mesh, interpolation="cubic")
    exact = smooth(*np.meshgrid(found.x, found.y))
    misfit, error = (float(np.sqrt((of**2).mean())) for of in (found - on_all, on_all - exact))
    assert 0 < misfit < 0.2 * error


def test_an_edge_of_the_mesh_in_the_face_is_no_stone_and_is_warned_of(caplog):
    sound = macroscale(sheet(hills, low=-4.0, high=9.0), 10.0)
    assert not np.isnan(sound.height).any()
    assert caplog.messages == []
    cut = macroscale(sheet(hills, low=-4.0, high=6.5), 10.0)
    absent = np.isnan(cut.height)
    (warning,) = caplog.messages
    assert f": {100 * float(absent.mean()):.2g} % of the face of 10 mm has no stone" in warning
    beyond = (cut.x > 6.5) | (cut.y > 6.5)
    np.testing.assert_array_equal(absent, beyond.transpose("y", "x"))
    # planes are those of the square
    np.testing.assert_allclose(cut.height, sound.height.where(~absent), atol=0.01)


def test_a_face_that_turns_away_ends_there(caplog):
    """Beside the square, a wall hangs over: two heights, of which neither is the use-face."""
    found = macroscale(leaning(1.0, 6.3, 0.4, low=-4.0, high=9.0), 10.0)
    absent = np.isnan(found.height).any("y")
    assert "has no stone" in caplog.text
    assert not absent.where(found.x < 6.0, False).any()
    assert absent.any()


def test_a_face_mostly_beyond_the_stone_is_refused():
    with pytest.raises(InputError, match=r"6\d % of the face of 13 mm lies beyond the stone"):
        macroscale(sheet(hills), 13.0)
    with accepting(["face"]):
        assert np.isnan(macroscale(sheet(hills), 13.0).height).mean() > 0.6
