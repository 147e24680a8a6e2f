"""Placement: what all patches share is found; one patch is called wrong only when it surely is."""

import numpy as np
import pandas as pd
import pytest
from gstlib.coupling.comparison import AGREES, CANNOT_TELL, ELSEWHERE, SHIFTED
from gstlib.coupling.orientations import Mould, lying_right, oriented
from gstlib.coupling.placement import ALL, FAULT, check_placement
from gstlib.errors import InputsError
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import axis_coordinates, make_surface
from scipy.ndimage import gaussian_filter

SQUARE, SIZE = 5.0, 0.85
# How one patch that was laid so is set right, by a patch table without flips.
ALONE = {
    "reversed along x": "Set flip of patch 4 to x.",
    "turned by 180°": "Set rotation_deg of patch 4 to 180.",
    "turned by 90°": "Set rotation_deg of patch 4 to -90.",
    "reversed along x and turned by 90°": (
        "Set flip of patch 4 to x, and set rotation_deg of patch 4 to 90."
    ),
}
NINE = [(y, x) for y in (1.2, 2.5, 3.8) for x in (1.2, 2.5, 3.8)]


class Waves:
    """A surface of waves longer than 0.6 mm, known at every point."""

    def __init__(self, seed, count=60):
        rng = np.random.default_rng(seed)
        wavelength, direction = rng.uniform(0.6, 2.5, count), rng.uniform(0, 2 * np.pi, count)
        self.y, self.x = 2 * np.pi / wavelength * [np.sin(direction), np.cos(direction)]
        self.phase = rng.uniform(0, 2 * np.pi, count)
        self.height = wavelength**1.8 * 1e-3

    def __call__(self, y, x):
        y, x = np.broadcast_arrays(y, x)
        return (
            self.height * np.cos(y[..., None] * self.y + x[..., None] * self.x + self.phase)
        ).sum(axis=-1)

    def square(self, count=100):
        places = axis_coordinates(count, SQUARE / count)
        return make_surface(self(places[:, None], places), SQUARE / count)

    def patch(self, y, x, rotation_deg=0.0, points=64):
        along = axis_coordinates(points, SIZE / points) - SIZE / 2
        heights = self(*PatchPosition(y, x, rotation_deg).points(along[:, None], along))
        return make_surface(heights, SIZE / points)


def place(square, heights, rotation_deg=0.0, columns=None, **mould):
    """The table by patch, of as many patches as there are heights."""
    y, x = np.transpose(NINE[: len(heights)])
    scans = {str(n): height.to_dataset(name="height") for n, height in enumerate(heights, 1)}
    patches = pd.DataFrame({"patch": list(scans), "x_mm": x, "y_mm": y} | (columns or {}))
    patches["rotation_deg"] = rotation_deg
    return check_placement(square, patches, scans, patch_mm=SIZE, **mould).set_index("patch")


def test_a_shift_that_all_share_is_found_whatever_planes_and_scales_are(caplog):
    stone, rotation = Waves(3), -7.0
    heights = [stone.patch(y + 0.06, x - 0.09, rotation) for y, x in NINE]
    heights = [2.0 * (height + 0.01 * height.x - 0.02 * height.y + 3) for height in heights]
    square = stone.square()
    found = place(square + 0.01 * square.y, heights, rotation_deg=rotation)
    row = found.loc[ALL]
    assert (row.status, row.orientation) == (SHIFTED, "as given")
    assert (row.shift_x_um, row.shift_y_um) == pytest.approx((-90, 60), abs=5)
    # after that shift, to the nearest step, the surfaces are one
    assert (found.correlation > 0.99).all()
    assert (found.status.drop(index=ALL) == AGREES).all()
    assert f"shifted in x by {row.shift_x_um:+.0f}" in caplog.text


def test_the_error_is_that_of_the_shift_and_alarms_are_rare(caplog):
    """Patches misplaced by 40 µm along each axis, each by itself."""
    off, status = [], []
    for seed in range(20):
        stone, rng = Waves(seed), np.random.default_rng(seed)
        own = rng.normal(0, 0.04, (len(NINE), 2))
        heights = [stone.patch(y + dy, x + dx) for (y, x), (dy, dx) in zip(NINE, own, strict=True)]
        found = place(stone.square(), heights, placement_um=40.0)
        row = found.loc[ALL]
        off += [row[f"shift_{axis}_um"] / row[f"shift_{axis}_error_um"] for axis in "xy"]
        status += [*found.status]
    assert 0.4 < np.median(np.abs(off)) < 1.0
    assert np.mean(np.abs(off) < 3) > 0.9
    assert set(status) <= {AGREES, SHIFTED, CANNOT_TELL}
    assert status.count(AGREES) > 0.7 * len(status)
    assert len(caplog.records) <= 1


def test_patches_of_another_stone_or_of_wrong_places_are_noticed(caplog):
    stone, other = Waves(6), Waves(1006)
    heights, square = [stone.patch(y, x) for y, x in NINE], stone.square()
    assert (place(square, heights).status == AGREES).all()
    assert caplog.text == ""
    wrong = [other.patch(y, x) for y, x in NINE]
    with pytest.raises(InputsError, match="Check x_mm and y_mm"):
        place(square, wrong)
    assert AGREES not in set(place(square, wrong, accept=[FAULT]).status)
    # a mesh too smooth or too coarse to show the patches contradicts nothing
    smooth, coarse = 0.1 * square, square.assign_attrs(mesh_edge_mm=0.6)
    for mesh in (smooth, coarse):
        caplog.clear()
        place(mesh, wrong)
        assert [record.levelname for record in caplog.records] == ["WARNING"]


def flipped(values, axis):
    return values if axis is None else np.flip(values, "yx".index(axis))


def seen(heights, noise_um, seed=0):
    """Scans with an error of their own, so that what is told is not told for certain."""
    rng = np.random.default_rng(seed)
    return [
        height + noise_um * 1e-3 * gaussian_filter(rng.normal(size=height.shape), 6) * 20
        for height in heights
    ]


@pytest.mark.parametrize(("orientation", "remedy"), ALONE.items())
def test_one_patch_in_another_orientation_is_named_with_what_to_set(orientation, remedy):
    stone = Waves(7)
    heights = seen([stone.patch(y, x) for y, x in NINE], 0.5)
    heights[3].values = oriented(heights[3].values, orientation)
    with pytest.raises(InputsError) as error:
        place(stone.square(), heights, rotation_deg=0.0)
    (fault,) = error.value.args[0]
    assert (fault.patches, fault.remedy) == (("4",), remedy)
    found = place(stone.square(), heights, accept=[f"{FAULT}:4"])
    assert list(found.index[found.status == ELSEWHERE]) == ["4"]
    assert found.status[ALL] == AGREES
    # what the remedy says takes the fault away
    right, turn = lying_right(found.orientation["4"], Mould(invert=False, flip=None))
    again = [*heights]
    again[3] = heights[3].copy(data=flipped(heights[3].values, right.flip))
    rotations = np.where(found.index[:-1] == "4", turn, 0.0)
    assert (place(stone.square(), again, rotation_deg=rotations).status == AGREES).all()


def test_a_half_turn_of_one_patch_is_its_own_and_not_that_of_its_mould():
    stone = Waves(7)
    heights = seen([stone.patch(y, x, 10.0) for y, x in NINE], 0.5)
    heights[3].values = heights[3].values[::-1, ::-1]
    with pytest.raises(InputsError, match="Set rotation_deg of patch 4 to -170"):
        place(stone.square(), heights, rotation_deg=10.0, flip="x")


@pytest.mark.parametrize("ring", [(1, 7), (0, 4, 8)])
def test_exchanged_scans_are_named(ring):
    stone = Waves(6)
    heights = seen([stone.patch(y, x) for y, x in NINE], 0.5)
    moved = {one: heights[other] for one, other in zip(ring, (*ring[1:], ring[0]), strict=True)}
    with pytest.raises(InputsError, match="each other's") as error:
        place(stone.square(), [moved.get(n, height) for n, height in enumerate(heights)])
    (fault,) = error.value.args[0]
    assert fault.patches == tuple(str(1 + n) for n in ring)


def test_a_patch_that_is_not_shown_is_not_said_to_agree():
    """Where the stone is as smooth as the scans are wrong."""
    stone = Waves(6)
    heights = seen([stone.patch(y, x) for y, x in NINE], 0.5)
    heights[4] = seen([0.02 * heights[4]], 0.5)[0]
    square = stone.square()
    near = np.abs(square.y - 2.5) < 0.6, np.abs(square.x - 2.5) < 0.6
    flat = square.where(~(near[0] & near[1]), 0.02 * square)
    found = place(flat, heights)
    assert list(found.index[found.status == CANNOT_TELL]) == ["5"]


@pytest.mark.parametrize(
    ("table", "remedy"),
    [
        (lambda x, y: (y, x), "Set x_mm to y_mm and y_mm to x_mm in"),
        (lambda x, y: (SQUARE - x, y), "Set x_mm to 5 - x_mm in"),
        (lambda x, y: (x, SQUARE - y), "Set y_mm to 5 - y_mm in"),
        (lambda x, y: (SQUARE - x, SQUARE - y), "Set x_mm to 5 - x_mm and y_mm to 5 - y_mm in"),
        (lambda x, y: (SQUARE - y, SQUARE - x), "Set x_mm to 5 - y_mm and y_mm to 5 - x_mm in"),
        # from (x, y) to (S - y, x): the remedy is its inverse
        (lambda x, y: (SQUARE - y, x), "Set x_mm to y_mm and y_mm to 5 - x_mm in"),
        (lambda x, y: (y, SQUARE - x), "Set x_mm to 5 - y_mm and y_mm to x_mm in"),
    ],
)
def test_a_mirrored_table_is_a_fault_and_named(table, remedy):
    """Also where some patches lie on the axis about which it was mirrored."""
    stone = Waves(11)
    truth = [(1.0, 0.7), (1.2, 2.4), (2.3, 3.9), (3.1, 1.4), (3.9, 3.1), (4.2, 2.0)]
    grid = [(y, x) for y in np.arange(0.7, 4.5, 0.6) for x in np.arange(0.7, 4.5, 0.6)]
    truth += [(y, x) for y, x in grid if np.allclose(table(x, y), (x, y))][:3]
    heights = [stone.patch(y, x) for y, x in truth]
    x, y = np.transpose([table(x, y) for y, x in truth])
    with pytest.raises(InputsError, match=remedy) as error:
        place(stone.square(), heights, columns={"x_mm": x, "y_mm": y})
    assert "accept: [placement]" in str(error.value)


@pytest.mark.parametrize(
    ("wrong", "mould", "remedy"),
    [
        (lambda h: h[:, ::-1], {}, "set scans.mould.flip to x"),
        (lambda h: h[:, ::-1], {"flip": "x"}, "set scans.mould.flip to null"),
        (lambda h: h[::-1], {"flip": "y"}, "set scans.mould.flip to null"),
        (lambda h: h[::-1, ::-1], {"flip": "y"}, "set scans.mould.flip to x"),
        (lambda h: -h, {}, "set scans.mould.invert to true"),
        (
            lambda h: -h[:, ::-1],
            {"invert": True, "flip": "x"},
            "set scans.mould.invert to false, and set scans.mould.flip to null",
        ),
        (lambda h: h[::-1, ::-1], {}, "add 180 to the rotation_deg of every patch"),
    ],
)
def test_a_scan_laid_wrongly_is_noticed_and_the_remedy_named(wrong, mould, remedy):
    stone = Waves(7)
    heights = [stone.patch(y + 0.02, x) for y, x in NINE[:6]]
    laid = [height.copy(data=wrong(height.values)) for height in heights]
    with pytest.raises(InputsError, match=f"{remedy[1:]}\\. If it is right"):
        place(stone.square(), laid, **mould)


@pytest.mark.parametrize(("own", "right"), [("", "y"), ("y", "none")])
def test_scans_of_one_instrument_that_alone_are_laid_wrongly_are_named(own, right):
    """Four matrices that begin at the top; the flip of their rows, or none, mends it."""
    stone = Waves(7)
    heights = [stone.patch(y, x) for y, x in NINE]
    for laid in heights[5:]:
        laid.values = laid.values[::-1]
    columns = {"t0": ["1.sur"] * 5 + ["1.asc"] * 4, "flip": [""] * 5 + [own] * 4}
    with pytest.raises(InputsError) as error:
        place(stone.square(), heights, columns=columns)
    (fault,) = error.value.args[0]
    assert (fault.patches, fault.remedy) == (
        ("6", "7", "8", "9"),
        f"Set flip of patches 6, 7, 8, 9 to {right}.",
    )


@pytest.mark.parametrize("count", [1, 3])
def test_of_few_patches_a_clear_flip_is_told(count):
    stone = Waves(7)
    laid = seen([stone.patch(y, x) for y, x in NINE[:count]], 0.1)
    laid = [height.copy(data=height.values[:, ::-1]) for height in laid]
    with pytest.raises(InputsError, match=r"Set scans\.mould\.flip to x"):
        place(stone.square(), laid)


@pytest.mark.parametrize(("count", "shifted"), [(3, False), (4, True)])
def test_four_patches_are_enough_for_a_shift_that_all_share(count, shifted):
    stone = Waves(3)
    heights = [stone.patch(y + 0.06, x - 0.09) for y, x in NINE[:count]]
    found = place(stone.square(), heights)
    assert (ALL in found.index and found.loc[ALL].status == SHIFTED) == shifted
