"""The frame of the square: by axes, by three points, by a marker; one frame, whichever way."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gstlib.errors import ConfigError, InputError
from gstlib.preprocess.frame import Frame, find_frame, frame_from_points
from gstlib.preprocess.gridding import grid_mesh

SIZE = 5.0
CORNERS = np.array([(0, 0, 0), (SIZE, 0, 0), (SIZE, SIZE, 0), (0, SIZE, 0)], dtype=float)


class TestFrame:
    def test_paper_corner_is_top_right(self):
        frame = Frame(origin=(2.5, 2.5, 0), x_axis=(-1, 0, 0), normal=(0, 0, 1))
        assert frame.y_axis == (0, -1, 0)
        np.testing.assert_allclose(
            frame.to_frame([[2.5, 2.5, 1], [-2.5, 2.5, 0], [2.5, -2.5, 0]]),
            [[0, 0, 1], [5, 0, 0], [0, 5, 0]],
        )

    @given(st.lists(st.floats(-50, 50), min_size=3, max_size=3), st.integers(0, 1000))
    def test_there_and_back(self, origin, seed):
        rng = np.random.default_rng(seed)
        normal, other = rng.normal(size=(2, 3))
        frame = Frame(origin, np.cross(normal, other), normal)
        points = rng.normal(scale=30, size=(5, 3))
        local = frame.to_frame(points)
        np.testing.assert_allclose(frame.from_frame(local), points, atol=1e-10)
        distances = np.linalg.norm(local[1:] - local[0], axis=1)
        np.testing.assert_allclose(distances, np.linalg.norm(points[1:] - points[0], axis=1))
        handed = np.dot(np.cross(frame.x_axis, frame.y_axis), frame.normal)
        assert handed == pytest.approx(1)

    def test_typed_digits_are_made_perpendicular(self):
        frame = Frame((0, 0, 0), (0.7071, 0.7071, 0.001), (0, 0, 2))
        assert np.dot(frame.x_axis, frame.normal) == pytest.approx(0, abs=1e-15)
        assert frame.normal == (0, 0, 1)

    @pytest.mark.parametrize(
        ("x_axis", "normal", "match"),
        [
            ((1, 0, 0.1), (0, 0, 1), "x_axis and normal enclose 84"),
            ((0, 0, 0), (0, 0, 1), "x_axis: has length zero"),
            ((1, 0), (0, 0, 1), "x_axis: .* is not three numbers"),
            ((1, 0, 0), (0, 0, float("nan")), "normal: .* is not three numbers"),
        ],
    )
    def test_bad_axes(self, x_axis, normal, match):
        with pytest.raises(ConfigError, match=match):
            Frame((0, 0, 0), x_axis, normal)


def ask(mesh, *, unit="mm", **frame):
    """What the config's other keys say besides is not looked at."""
    given = {"origin_mm": [0, 0, 0], "x_axis": [1, 0, 0], "normal": [0, 0, 1]}
    given |= {"points_mm": None, "marker": None} | frame
    return find_frame({"size_mm": SIZE, "frame": given}, mesh, unit=unit, source="stone.stl")


def random_frame(seed):
    """A square that touches a ball of radius 20 with its centre, and the ball's mesh."""
    rng = np.random.default_rng(seed)
    centre, other = rng.normal(size=(2, 3))
    normal = centre / np.linalg.norm(centre)
    x_axis = np.cross(normal, other)
    x_axis /= np.linalg.norm(x_axis)
    corner = 20 * normal - SIZE / 2 * (x_axis + np.cross(normal, x_axis))
    shift = rng.uniform(-100, 100, 3)
    return Frame(corner + shift, x_axis, normal), ball(shift)


def ball(shift=(0, 0, 0)):
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=20)
    mesh.apply_translation(shift)
    return mesh


def assert_same(found, expected, atol=1e-9):
    for name in ("origin", "x_axis", "y_axis", "normal"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=atol)


def test_axes_are_taken_as_they_are():
    frame = ask(ball(), origin_mm=[1, 2, 3], x_axis=[0, 2, 0], normal=[0, 0, 1])
    assert_same(frame, Frame([1, 2, 3], [0, 1, 0], [0, 0, 1]))


class TestPoints:
    @settings(deadline=None)
    @given(
        st.integers(0, 1000),
        st.tuples(st.floats(0.5, 50), st.floats(-20, 20), st.floats(2.5, 50)),
    )
    def test_are_the_axes_in_other_words(self, seed, places):
        along, beside, up = places
        frame, _ = random_frame(seed)
        points = frame.from_frame([(0, 0, 0), (along, 0, 0), (beside, up, 0)])
        if abs(beside) < 5 * up:  # else they are in line
            assert_same(frame_from_points(points), frame)

    @settings(deadline=None, max_examples=10)
    @given(st.integers(0, 1000))
    def test_on_a_stone(self, seed):
        frame, mesh = random_frame(seed)
        points = frame.from_frame(CORNERS[[0, 1, 3]]).tolist()
        assert_same(ask(mesh, points_mm=points), frame)
        with pytest.raises(ConfigError, match=r"points_mm: .*clockwise.*Exchange points 2 and 3"):
            ask(mesh, points_mm=[points[0], points[2], points[1]])

    def test_on_a_stone_that_is_inside_out(self):
        frame, mesh = random_frame(1)
        mesh.invert()
        assert_same(ask(mesh, points_mm=frame.from_frame(CORNERS[[0, 1, 3]]).tolist()), frame)

    def test_corners_of_another_square_are_warned_of(self, caplog):
        frame, mesh = random_frame(1)
        for size, warned in ((1.2, False), (0.85, False), (1.6, True), (0.5, True)):
            caplog.clear()
            points = frame.from_frame(size * CORNERS[[0, 1, 3]]).tolist()
            assert_same(ask(mesh, points_mm=points), frame)
            assert ("correct square.size_mm" in caplog.text) == warned
        assert "2.5 and 2.5 mm from point 1, the square is 5 × 5 mm" in caplog.text

    @pytest.mark.parametrize(
        ("points", "match"),
        [
            ([[0, 0, 20], [1, 0, 20], [3, 0.01, 20]], "in line"),
            ([[0, 0, 20], [0, 0, 20], [0, 3, 20]], "in line, or two of them are one"),
            ([[0, 0, 20], [0.1, 0, 20], [0, 3, 20]], "point 2 is only 0.1 mm from point 1"),
            (
                [[0, 0, 20], [3, 0, 20], [0, 300, 20]],
                r"point 3, \[0, 300, 20\], is 280.* z -20 to 20",
            ),
            ([[0, 0, 20], [3, 0, 20]], "not three points"),
            ([[0, 0, 20], [3, 0, 20], [0, 3, float("nan")]], "not three points"),
        ],
    )
    def test_that_make_no_frame(self, points, match):
        with pytest.raises(ConfigError, match=match) as caught:
            ask(ball(), points_mm=points)
        assert "square.frame.points_mm" in str(caught.value)

    def test_in_the_units_of_a_mesh_in_metres(self):
        points = [[1, 1, 0.2], [1.005, 1, 0.2], [1, 1.005, 0.2]]
        with pytest.raises(ConfigError, match="a viewer of this mesh shows m"):
            ask(ball([1000, 1000, 180]), points_mm=points, unit="m")


def write_marker(path, points, unit_mm=1.0):
    """Points, in turn around their outline, as whatever file the name asks for."""
    points = np.asarray(points) / unit_mm
    quads = range(0, len(points), 4)
    faces = [(a, a + second, a + second + 1) for a in quads for second in (1, 2)]
    match path.suffix:
        case ".csv":
            np.savetxt(path, points, delimiter=",", header="x,y,z", comments="")
        case ".xyz":
            np.savetxt(path, points)
        case ".obj":
            lines = ["v {} {} {}".format(*point) for point in points]
            path.write_text("\n".join([*lines, "l 1 2 3 4 1", ""]))
        case _:
            trimesh.Trimesh(points, faces, process=False).export(path)
    return str(path)


class TestMarker:
    @settings(deadline=None, max_examples=20)
    @given(
        st.integers(0, 1000),
        st.sampled_from([".csv", ".xyz", ".obj", ".ply", ".stl"]),
        st.sampled_from([[0.0], [1.2], [-1.5], [1.2, -1.2], [0.3, -1.5]]),
        st.sampled_from(["mm", "m", "in"]),
    )
    def test_on_a_tilted_stone_gives_the_frame(self, tmp_path_factory, seed, suffix, heights, unit):
        frame, mesh = random_frame(seed)
        outline = np.concatenate([np.add(CORNERS, [0, 0, height]) for height in heights])
        path = tmp_path_factory.mktemp("marker") / f"square{suffix}"
        unit_mm = {"mm": 1.0, "m": 1000.0, "in": 25.4}[unit]
        found = ask(mesh, unit=unit, marker=write_marker(path, frame.from_frame(outline), unit_mm))
        raised = Frame(frame.from_frame([[0, 0, np.mean(heights)]])[0], frame.x_axis, frame.normal)
        assert_same(found, raised, atol=2e-4)  # STL and PLY have six digits

    @pytest.mark.parametrize("first", range(4))
    @pytest.mark.parametrize("step", [1, -1])
    def test_reference_corner_is_at_its_first_point(self, tmp_path, first, step):
        """Whichever way round it was drawn."""
        frame, mesh = random_frame(3)
        order = [(first + step * k) % 4 for k in range(4)]
        points = frame.from_frame(CORNERS[order])
        found = ask(mesh, marker=write_marker(tmp_path / "a.csv", points))
        np.testing.assert_allclose(found.origin, points[0], atol=1e-6)
        np.testing.assert_allclose(found.normal, frame.normal, atol=1e-6)
        np.testing.assert_allclose(
            np.sort(np.abs(np.array(found.x_axis) @ np.array([frame.x_axis, frame.y_axis]).T)),
            [0, 1],
            atol=1e-6,
        )

    def test_rough_outline_of_another_shape(self, tmp_path, caplog):
        """A square of 5 mm on the centre of a hand-drawn rectangle of 6.5 × 5.4 mm."""
        frame, mesh = random_frame(4)
        rng = np.random.default_rng(0)
        around = np.linspace(0, 1, 40, endpoint=False)[:, None]
        sides = [
            a + around * (b - a) for a, b in zip(CORNERS, np.roll(CORNERS, -1, 0), strict=True)
        ]
        drawn = (np.concatenate(sides) - SIZE / 2) * [1.3, 1.08, 1] + SIZE / 2 + [0, 0, SIZE / 2]
        drawn += rng.normal(scale=0.03, size=drawn.shape)
        found = ask(mesh, marker=write_marker(tmp_path / "a.xyz", frame.from_frame(drawn)))
        assert "the square is put at its centre" in caplog.text
        centre = frame.to_frame(found.from_frame([[SIZE / 2, SIZE / 2, 0]]))[0]
        np.testing.assert_allclose(centre[:2], SIZE / 2, atol=0.1)
        assert np.dot(found.normal, frame.normal) > np.cos(np.radians(1))
        assert np.dot(found.x_axis, frame.x_axis) > np.cos(np.radians(2))

    def test_square_is_centred_on_the_outline_not_on_its_points(self, tmp_path):
        """One side was drawn with many points."""
        frame, mesh = random_frame(4)
        side = np.linspace(CORNERS[0], CORNERS[1], 30)
        outline = frame.from_frame(np.concatenate([CORNERS, side]))
        found = ask(mesh, marker=write_marker(tmp_path / "a.csv", outline))
        assert_same(found, frame, atol=1e-6)

    def test_first_point_at_no_corner(self, tmp_path, caplog):
        frame, mesh = random_frame(5)
        points = frame.from_frame(np.concatenate([[[SIZE / 2, 0, 0]], CORNERS]))
        ask(mesh, marker=write_marker(tmp_path / "a.csv", points))
        assert "first point is at no corner" in caplog.text

    @pytest.mark.parametrize(
        ("outline", "match"),
        [
            (CORNERS[:2], "2 different points"),
            (np.linspace(0, SIZE, 9)[:, None] * [1, 0.01, 0], "in line"),
            (np.random.default_rng(0).normal(size=(50, 3)), "not near a plane"),
            (3 * CORNERS, "15 × 15 mm, the square 5 × 5 mm"),
            (0.4 * CORNERS, "2 × 2 mm, the square 5 × 5 mm"),
            (
                np.add(CORNERS, [0, 0, 30]),
                "centre .* is 30.*stone.stl, which spans.*inputs.mesh_unit",
            ),
        ],
    )
    def test_that_makes_no_frame(self, tmp_path, outline, match):
        frame, mesh = random_frame(6)
        with pytest.raises(InputError, match=match) as caught:
            ask(mesh, marker=write_marker(tmp_path / "a.csv", frame.from_frame(outline)))
        assert "a.csv" in str(caught.value)

    def test_that_is_not_there(self, tmp_path):
        with pytest.raises(InputError, match="no such file"):
            ask(ball(), marker=str(tmp_path / "gone.ply"))


def test_the_three_ways_give_the_same_heights(tmp_path):
    """On a stone that is the same ball after a turn about the square's normal."""
    frame, mesh = random_frame(7)
    corners = frame.from_frame(CORNERS)
    frames = [
        frame,
        ask(mesh, points_mm=corners[[0, 1, 3]].tolist()),
        ask(mesh, marker=write_marker(tmp_path / "a.xyz", corners)),
    ]
    heights = [
        grid_mesh(mesh, frame, size_mm=SIZE, shape=(20, 20), margin_mm=1.0).values
        for frame in frames
    ]
    np.testing.assert_allclose(heights[1], heights[0], atol=1e-6)
    # The marker's first point is its corner, so x may run along either edge.
    assert min(np.abs(heights[2] - other).max() for other in (heights[0], heights[0].T)) < 1e-6


def test_turning_stone_and_square_together_changes_nothing():
    frame, mesh = random_frame(8)
    turn = Rotation.from_euler("xyz", [0.3, -1.1, 2.0]).as_matrix()
    other = mesh.copy()
    other.vertices = other.vertices @ turn.T
    points = frame.from_frame(CORNERS[[0, 1, 3]])
    first = grid_mesh(
        mesh, ask(mesh, points_mm=points.tolist()), size_mm=SIZE, shape=(20, 20), margin_mm=1.0
    )
    turned = ask(other, points_mm=(points @ turn.T).tolist())
    second = grid_mesh(other, turned, size_mm=SIZE, shape=(20, 20), margin_mm=1.0)
    np.testing.assert_allclose(second.values, first.values, atol=1e-9)
