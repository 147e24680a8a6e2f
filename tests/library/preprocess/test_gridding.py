"""Gridding: the right sheet, exactly where it is linear, converging where it is curved; and how
well left-out vertices are predicted."""

import numpy as np
import pytest
import trimesh
from gstlib.errors import InputError
from gstlib.face import grid_macroscale
from gstlib.geometry import Frame, square_of
from gstlib.preprocess import gridding
from gstlib.preprocess.gridding import grid_mesh, gridding_table
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


def test_grid_is_the_square():
    surface = grid(sheet(lambda x, y: 0 * x))
    assert surface.shape == (40, 40)
    assert 29**2 <= surface.attrs["mesh_points"] < 33**2  # the crop's, of 33² vertices
    assert surface.y.attrs["spacing"] == 5 / 40
    assert surface.x.attrs["spacing"] == 5 / 40
    assert surface.x.values[0] == pytest.approx(0.0625)
    assert surface.attrs["mesh_edge_mm"] == pytest.approx(0.28, rel=0.1)


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


def test_speck_over_the_surface_is_not_the_use_face():
    plane = sheet(lambda x, y: 0 * x - 0.5)
    speck = sheet(lambda x, y: 0 * x, low=1.0, high=2.0)
    surface = grid(trimesh.util.concatenate([plane, speck]))
    np.testing.assert_allclose(surface.values, -0.5, atol=1e-12)


def innermost(mesh):
    """Mask of the face at the middle of the square."""
    distance = np.linalg.norm(mesh.triangles_center[:, :2] - 2.5, axis=1)
    return np.arange(len(mesh.faces)) == distance.argmin()


@pytest.mark.parametrize("turned", [False, True])
def test_a_pin_hole_or_a_face_turned_over_is_bridged(turned, caplog):
    plane = sheet(lambda x, y: 0.1 * x)
    one = innermost(plane)
    if turned:
        plane.faces[one] = plane.faces[one][:, ::-1]
    else:
        plane.update_faces(~one)
    surface = grid(plane)
    np.testing.assert_allclose(surface.values, 0.1 * np.broadcast_to(surface.x, (40, 40)))
    assert "holes of the mesh were bridged" in caplog.text


def without(faces):
    """A plane without the faces that a function of the mesh selects."""
    plane = sheet(lambda x, y: 0 * x)
    plane.update_faces(~faces(plane))
    return plane


def turned_over():
    plane = sheet(lambda x, y: 0.1 * x)
    many = np.linalg.norm(plane.triangles_center[:, :2] - 2.5, axis=1) < 1.0
    plane.faces[many] = plane.faces[many][:, ::-1]
    return plane


def inverted():
    shell = sheet(hills)
    shell.invert()
    return shell


def breaking_wave():
    """The surface leans over by more than it advances."""
    flat = sheet(lambda x, y: 0 * x, edge=0.1)
    x, y, _ = flat.vertices.T
    crest = np.exp(-((x - 2.5) ** 2))
    flat.vertices = np.c_[x + 2.0 * crest, y, 1.5 * crest]
    return flat


def at(x, y=0.0, normal=1.0):
    return Frame((x, y, 0), (1, 0, 0), (0, 0, normal))


@pytest.mark.parametrize(
    ("match", "mesh", "frame"),
    [
        (
            r"no part of the mesh.*x -101\.5 to -93\.5 and y -1\.5 to 6\.5 mm.*mesh_unit",
            lambda: sheet(hills),
            at(100),
        ),
        ("no part of the mesh", lambda: sheet(hills, high=-0.5), UP),  # in the crop alone
        (
            r"sticks out.*20 % of the square \(x 4\.06 to 4\.94, y 0\.\d+ to 4\.9\d* mm\)",
            lambda: sheet(lambda x, y: 0 * x, low=-2.0, high=9.0),
            at(5.0),
        ),
        (
            r"sticks out.* 0\.\d+ % of the square",  # with a corner alone
            lambda: without(lambda m: m.vertices[m.faces, :2].sum(axis=2).max(axis=1) >= 9.8),
            UP,
        ),
        (
            r"the mesh has a hole.* % of the square \(x 1\.",
            lambda: without(
                lambda m: np.linalg.norm(m.triangles_center[:, :2] - 2.5, axis=1) <= 0.8
            ),
            UP,
        ),
        ("faces turned inside out", turned_over, UP),
        ("point against the frame's normal.*points 2 and 3", lambda: sheet(hills), at(0, 5, -1)),
        ("point against the frame's normal.*turn the mesh's faces", inverted, UP),
        (r"folds over within the square: .* % of the square .* two heights", breaking_wave, UP),
        (r"has 1\d vertices .* 30 .*finer mesh", lambda: sheet(hills, edge=1.3), UP),
    ],
)
def test_a_square_that_cannot_be_gridded(match, mesh, frame):
    with pytest.raises(InputError, match=match) as caught:
        grid(mesh(), frame)
    assert "stone.stl" in str(caught.value)


# --- Left-out vertices ------------------------------------------------------------------------


def smooth(x, y):
    """Some waves at random, none shorter than 2 mm."""
    rng = np.random.default_rng(3)
    waves = rng.uniform(-2.2, 2.2, (12, 2)) @ np.stack([x, y]) + rng.uniform(0, 6, (12, 1))
    return 0.02 * np.sin(waves).sum(axis=0)


def rms_of(surface):
    return dict(zip(KINDS, surface.left_out_rms.values, strict=True))


def test_on_a_smooth_surface_a_smooth_interpolation_is_best():
    mesh = sheet(smooth, edge=0.4)
    best = gridded(mesh)
    rms, chosen = rms_of(best), best.height.attrs["interpolation"]
    assert max(rms["clough-tocher"], rms["cubic"]) < 0.8 * rms["linear"]
    assert chosen == min(KINDS[1:], key=rms.get)
    exact = smooth(*(axis.ravel() for axis in np.meshgrid(best.x, best.y))).reshape(40, 40)
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
    monkeypatch.setattr(gridding, "_left_out", lambda cloud, inside, tried: (inside[:2], errors))
    surface = gridded(sheet(smooth, edge=0.5))
    assert surface.height.attrs["interpolation"] == chosen
    np.testing.assert_allclose(surface.left_out_rms, 1e-3 * np.array(rms))
    np.testing.assert_array_equal(surface.left_out_error, errors[KINDS.index(chosen)])


def test_errors_are_those_of_a_group_left_out(monkeypatch):
    mesh = sheet(smooth)
    monkeypatch.setattr(gridding, "_MARGIN_MM", 9.0)  # the cloud is the whole sheet
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
    points = points.reshape(-1, 2)
    mesh = trimesh.Trimesh(
        np.c_[points, smooth(*points.T)], Delaunay(points).simplices, process=False
    )
    best = gridded(mesh)
    assert rms_of(best)["cubic"] == np.inf
    assert best.height.attrs["interpolation"] != "cubic"


def test_what_the_square_is_stored_with():
    square = {"size_mm": 5.0, "points_mm": [[0, 0, 0], [5, 0, 0], [0, 5, 0]]}
    settings = {"grid": 20, "source": "stone.stl"}
    mesh = sheet(lambda x, y: smooth(x, y) + 0.1 * x)
    surface, second = grid_macroscale(mesh, **square, interpolation="best", **settings)
    assert second is None
    assert abs(np.polyfit(surface.x, surface.height.mean("y"), 1)[0]) < 1e-9  # level
    table = gridding_table(surface)
    assert list(table.interpolation) == KINDS
    assert table.chosen.sum() == 1
    direct = gridded(mesh)
    np.testing.assert_array_equal(table.left_out_rms_um, 1e3 * direct.left_out_rms)
    linear, _ = grid_macroscale(mesh, **square, interpolation="linear", **settings)
    assert gridding_table(linear).interpolation.tolist() == ["linear"]
    assert list(gridding_table(linear).chosen) == [True]


# --- The face around the square ----------------------------------------------------------------


def test_the_face_continues_the_square():
    """The same heights in the square, the mesh's around it, the square's corner at (0, 0)."""
    mesh, exact = sheet(hills, low=-5.0, high=10.0), {}
    square, face = (grid(mesh, around=around) for around in (0, 16))
    assert face.shape == (72, 72)
    np.testing.assert_allclose(face.x.values, (np.arange(72) - 15.5) * 0.125, atol=1e-12)
    assert face.y.attrs["spacing"] == 0.125
    np.testing.assert_allclose(square_of(face, 5.0), square, atol=1e-12)
    exact = hills(*np.meshgrid(face.x, face.y))
    np.testing.assert_allclose(face, exact, atol=0.01)


def test_a_cubic_on_nodes_is_that_on_every_element(monkeypatch):
    """Where elements are much smaller than the mesh's edges, nodes hold the cubic."""
    mesh = sheet(smooth, edge=0.4)
    found = grid(mesh, interpolation="cubic")
    monkeypatch.setattr(gridding, "_POINTS_PER_EDGE", 1e3)
    on_all = grid(mesh, interpolation="cubic")
    exact = smooth(*(axis.ravel() for axis in np.meshgrid(found.x, found.y))).reshape(40, 40)
    misfit, error = (float(np.sqrt((of**2).mean())) for of in (found - on_all, on_all - exact))
    assert 0 < misfit < 0.2 * error


def macroscale(mesh, face_mm, **more):
    points = [[0, 0, 0], [5, 0, 0], [0, 5, 0]]
    settings = {"size_mm": 5.0, "grid": 20, "interpolation": "linear", "source": "stone.stl"}
    return grid_macroscale(mesh, points_mm=points, face_mm=face_mm, **settings | more)[0]


def test_an_edge_of_the_mesh_in_the_face_is_no_stone_and_is_warned_of(caplog):
    sound = macroscale(sheet(hills, low=-4.0, high=9.0), 10.0)
    assert sound.height.shape == (40, 40)
    assert sound.size_mm == 5
    assert not np.isnan(sound.height).any()
    assert caplog.messages == []
    cut = macroscale(sheet(lambda x, y: hills(x, y), low=-4.0, high=6.5), 10.0)
    absent = np.isnan(cut.height)
    (warning,) = caplog.messages
    assert "stone.stl" in warning
    assert f"{100 * float(absent.mean()):.2g} % of the face of 10 mm has no stone" in warning
    assert "face_mm smaller" in warning
    beyond = (cut.x > 6.5) | (cut.y > 6.5)
    np.testing.assert_array_equal(absent, beyond.transpose("y", "x"))
    # planes are those of the square
    np.testing.assert_allclose(cut.height, sound.height.where(~absent), atol=0.01)


def test_a_face_that_turns_away_ends_there(caplog):
    """Beside the square, a wall hangs over: two heights, of which neither is the use-face."""
    flat = sheet(lambda x, y: 0 * x, edge=0.1, low=-4.0, high=9.0)
    x, y, _ = flat.vertices.T
    crest = np.exp(-(((x - 6.3) / 0.4) ** 2))
    flat.vertices = np.c_[x + 1.0 * crest, y, 0.5 * crest]
    found = macroscale(flat, 10.0)
    absent = np.isnan(found.height).any("y")
    assert "has no stone" in caplog.text
    assert not absent.where(found.x < 6.0, False).any()
    assert absent.any()
    assert not np.isnan(square_of(found.height, 5.0)).any()


def test_a_face_mostly_beyond_the_stone_is_refused():
    with pytest.raises(InputError, match=r"6\d % of the face of 13 mm lies beyond the stone"):
        macroscale(sheet(hills), 13.0)
