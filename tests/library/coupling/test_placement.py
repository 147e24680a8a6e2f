"""Placement: what all patches share is found; one patch is called wrong only when it surely is."""

import numpy as np
import pandas as pd
import pytest
from gstlib.coupling.placement import (
    AGREES,
    ALL,
    CANNOT_TELL,
    ELSEWHERE,
    FAULT,
    SHIFTED,
    place_patches,
)
from gstlib.errors import InputsError
from gstlib.surfaces.footprints import Place
from gstlib.surfaces.grid import axis_coordinates, make_surface

SQUARE, SIZE = 5.0, 0.85
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
        heights = self(*Place(y, x, rotation_deg).points(along[:, None], along))
        return make_surface(heights, SIZE / points)


def place(square, heights, rotation_deg=0.0, columns=None, **mould):
    """The table by patch, of as many patches as there are heights."""
    y, x = np.transpose(NINE[: len(heights)])
    scans = {str(n): height.to_dataset(name="height") for n, height in enumerate(heights, 1)}
    patches = pd.DataFrame({"patch": list(scans), "x_mm": x, "y_mm": y} | (columns or {}))
    patches["rotation_deg"] = rotation_deg
    return place_patches(square, patches, scans, patch_mm=SIZE, **mould).set_index("patch")


@pytest.mark.parametrize("rotation", [0.0, -7.0, 90.0])
def test_a_shift_that_all_share_is_found_whatever_planes_and_scales_are(rotation, caplog):
    stone = Waves(3)
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
    assert f"shifted in x by {row.shift_x_um:+.0f} ± {row.shift_x_error_um:.0f} µm" in caplog.text


def test_the_error_is_that_of_the_shift_and_alarms_are_rare(caplog):
    """Patches misplaced by 40 µm along each axis, each by itself."""
    off, alarms = [], 0
    for seed in range(20):
        stone, rng = Waves(seed), np.random.default_rng(seed)
        own = rng.normal(0, 0.04, (len(NINE), 2))
        heights = [stone.patch(y + dy, x + dx) for (y, x), (dy, dx) in zip(NINE, own, strict=True)]
        found = place(stone.square(), heights)
        row = found.loc[ALL]
        off += [row[f"shift_{axis}_um"] / row[f"shift_{axis}_error_um"] for axis in "xy"]
        alarms += (found.status != AGREES).sum()
    assert 0.4 < np.median(np.abs(off)) < 1.0
    assert np.mean(np.abs(off) < 3) > 0.9
    assert alarms == len(caplog.records) <= 1


def test_patches_of_another_stone_or_of_wrong_places_are_noticed(caplog):
    stone, other = Waves(6), Waves(1006)
    heights, square = [stone.patch(y, x) for y, x in NINE], stone.square()
    assert (place(square, heights).status == AGREES).all()
    assert caplog.text == ""
    # two exchanged: half of such are found, these two among them
    swapped = place(square, [heights[i] for i in (0, 7, 2, 3, 4, 5, 6, 1, 8)])
    assert list(swapped.index[swapped.status == ELSEWHERE]) == ["2", "8"]
    assert caplog.text.count("patches 2, 8: no correlation") == 1
    for wrong in ([other.patch(y, x) for y, x in NINE], heights[4:] + heights[:4]):
        with pytest.raises(InputsError, match="Check x_mm and y_mm"):
            place(square, wrong)
        caplog.clear()
        found = place(square, wrong, accept=[FAULT])
        assert (found.status == CANNOT_TELL).all()
        assert [record.levelname for record in caplog.records] == ["ERROR"]
    # a mesh too smooth or too coarse to show the patches contradicts nothing
    smooth, coarse = 0.1 * square, square.assign_attrs(mesh_edge_mm=0.6)
    for mesh in (smooth, coarse):
        caplog.clear()
        place(mesh, heights[4:] + heights[:4])
        assert [record.levelname for record in caplog.records] == ["WARNING"]


@pytest.mark.parametrize(
    ("table", "remedy"),
    [
        (lambda x, y: (y, x), "x_mm and y_mm exchanged: correct"),
        (lambda x, y: (SQUARE - x, y), "x_mm measured from the other side"),
        (lambda x, y: (x, SQUARE - y), "y_mm measured from the other side"),
        (lambda x, y: (SQUARE - y, SQUARE - x), "both then measured from the other sides"),
    ],
)
@pytest.mark.parametrize("right", [0, 3])
def test_a_mirrored_table_is_a_fault_and_named(table, remedy, right):
    """Also where some patches lie on the axis about which it was mirrored."""
    stone = Waves(11)
    truth = [(1.0, 0.7), (1.2, 2.4), (2.3, 3.9), (3.1, 1.4), (3.9, 3.1), (4.2, 2.0)]
    grid = [(y, x) for y in np.arange(0.7, 4.5, 0.6) for x in np.arange(0.7, 4.5, 0.6)]
    truth += [(y, x) for y, x in grid if np.allclose(table(x, y), (x, y))][:right]
    heights = [stone.patch(y, x) for y, x in truth]
    stated = np.array([table(x, y) for y, x in truth])
    with pytest.raises(InputsError, match=remedy) as error:
        place(stone.square(), heights, columns={"x_mm": stated[:, 0], "y_mm": stated[:, 1]})
    assert "accept: [placement]" in str(error.value)


@pytest.mark.parametrize(
    ("wrong", "mould", "remedy"),
    [
        (lambda h: h[:, ::-1], {}, "set scans.mould.flip to x"),
        (lambda h: h[::-1], {}, "set scans.mould.flip to y"),
        (lambda h: h[:, ::-1], {"flip": "x"}, "set scans.mould.flip to null"),
        (lambda h: h[::-1], {"flip": "y"}, "set scans.mould.flip to null"),
        (lambda h: h[::-1, ::-1], {"flip": "x"}, "set scans.mould.flip to y"),
        (lambda h: h[::-1, ::-1], {"flip": "y"}, "set scans.mould.flip to x"),
        (lambda h: -h, {}, "set scans.mould.invert to true"),
        (
            lambda h: -h[:, ::-1],
            {"invert": True, "flip": "x"},
            "set scans.mould.invert to false and scans.mould.flip to null",
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
def test_scans_of_one_instrument_that_alone_are_laid_wrongly_are_named(own, right, caplog):
    """Four matrices that begin at the top; the flip of their rows, or none, mends it."""
    stone = Waves(7)
    heights = [stone.patch(y, x) for y, x in NINE]
    for laid in heights[5:]:
        laid.values = laid.values[::-1]
    columns = {"t0": ["1.sur"] * 5 + ["1.asc"] * 4, "flip": [""] * 5 + [own] * 4}
    with pytest.raises(InputsError, match=r"patches 6, 7, 8, 9 \(.asc\): they fit") as error:
        place(stone.square(), heights, columns=columns)
    assert "reversed along y" in str(error.value)
    assert f"flip in their rows of the patch table to {right}" in str(error.value)
    assert "x_mm" not in str(error.value) + caplog.text


def test_three_scans_of_one_instrument_are_too_few_to_be_named():
    stone = Waves(7)
    heights = [stone.patch(y, x) for y, x in NINE]
    for laid in heights[6:]:
        laid.values = laid.values[::-1]
    found = place(stone.square(), heights, columns={"t0": ["1.sur"] * 6 + ["1.asc"] * 3})
    assert found.orientation.fillna("").eq("").all()


@pytest.mark.parametrize(("count", "told"), [(1, False), (2, True), (3, True)])
def test_of_few_patches_a_clear_flip_is_told_and_of_one_none(caplog, count, told):
    stone = Waves(7)
    laid = [stone.patch(y, x) for y, x in NINE[:count]]
    laid = [height.copy(data=height.values[:, ::-1]) for height in laid]
    found = place(stone.square(), laid, accept=[FAULT])
    assert (found.status == CANNOT_TELL).all()
    assert ("et scans.mould.flip to x" in caplog.text) == told


@pytest.mark.parametrize(("count", "shifted"), [(3, False), (4, True)])
def test_four_patches_are_enough_for_a_shift_that_all_share(count, shifted):
    stone = Waves(3)
    heights = [stone.patch(y + 0.06, x - 0.09) for y, x in NINE[:count]]
    found = place(stone.square(), heights)
    assert (ALL in found.index and found.loc[ALL].status == SHIFTED) == shifted
