"""Placement: what all patches share is found; one patch is called wrong only when it surely is."""

import numpy as np
import pandas as pd
import pytest
import scipy
from contacts import laid
from scipy.ndimage import gaussian_filter
from stones import waves

from gstlib.coupling.comparison import (
    AGREES,
    CANNOT_TELL,
    ELSEWHERE,
    SHIFTED,
    Comparison,
    _shared_shift,
)
from gstlib.coupling.orientations import Mould, lying_right, oriented
from gstlib.coupling.placement import ALL, FAULT, check_placement
from gstlib.errors import InputError, InputsError
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import axis_coordinates, make_surface

SQUARE, SIZE = 5.0, 0.85
NINE = [(y, x) for y in (1.2, 2.5, 3.8) for x in (1.2, 2.5, 3.8)]
TABLE = pd.DataFrame(NINE, columns=["y_mm", "x_mm"])
TABLE = TABLE.assign(patch=[*"123456789"], rotation_deg=0.0)


def stone_of(seed):
    """Waves longer than those that the mesh does not show."""
    return waves(seed, 0.6, 2.5, 12e-3)


STONE = stone_of(6)
PLACES = axis_coordinates(100, SQUARE / 100)
MESH = make_surface(STONE(PLACES[:, None], PLACES), SQUARE / 100)


def patch_of(y, x, rotation_deg=0.0, stone=STONE):
    return laid(stone, PatchPosition(y, x, rotation_deg), SIZE, 64)[0]


def place(heights, mesh=MESH, rotation_deg=0.0, columns=None, **mould):
    """The table by patch, of as many patches as there are heights."""
    patches = TABLE[: len(heights)].assign(rotation_deg=rotation_deg, **columns or {})
    levels = [height.to_dataset(name="height") for height in heights]
    scans = dict(zip(patches.patch, levels, strict=True))
    table = check_placement(mesh, patches, scans, patch_mm=SIZE, **mould)
    return table.set_index("patch")


def nine(noise_um=0.0, rotation_deg=0.0, stone=STONE):
    """Scans with an error of their own, so that what is told is not told for certain."""
    scans = [patch_of(y, x, rotation_deg, stone) for y, x in NINE]
    noise = np.random.default_rng(0).normal(size=(9, 64, 64))
    errors = gaussian_filter(noise, 6, axes=(1, 2))
    return [*map(np.add, scans, 0.02 * noise_um * errors)]


def fault_of(*arguments, **options):
    """The one fault for which the patches are refused."""
    with pytest.raises(InputsError) as error:
        place(*arguments, **options)
    (fault,) = error.value.args[0]
    return fault


def test_a_shift_that_all_share_is_found_whatever_planes_and_scales_are(caplog):
    shifted = [patch_of(y + 0.06, x - 0.09, -7.0) for y, x in NINE]
    heights = [2.0 * (each + 0.01 * each.x - 0.02 * each.y + 3) for each in shifted]
    table = place(heights, MESH + 0.01 * MESH.y, rotation_deg=-7.0)
    row = table.loc[ALL]
    assert (row.status, row.orientation) == (SHIFTED, "as given")
    assert (row.shift_x_um, row.shift_y_um) == pytest.approx((-90, 60), abs=5)
    # after that shift, to the nearest step, the surfaces are one
    assert (table.correlation > 0.98).all()
    assert (table.status.drop(index=ALL) == AGREES).all()
    assert f"shifted in x by {row.shift_x_um:+.0f}" in caplog.text


@pytest.mark.parametrize(
    ("patches", "problem"),
    [
        (TABLE[:0], "has no patches"),
        (TABLE[:2].assign(patch="1"), "has patch 1 twice"),
        (TABLE[:2].assign(x_mm=[1.2, np.nan]), "has no position .* of patch 2"),
        (TABLE[:2], r"patch 1: the map is 1.7 × 1.7 mm, but its place is .* 0.85 mm"),
    ],
)
def test_tables_and_scans_that_cannot_be_compared_are_refused(patches, problem):
    scan = make_surface(np.zeros((64, 64)), 2 * SIZE / 64).to_dataset(name="height")
    with pytest.raises(InputError, match=problem):
        check_placement(MESH, patches, dict.fromkeys("12", scan), patch_mm=SIZE)


def test_a_shared_shift_is_as_certain_as_the_mean_of_the_patches():
    """Parabolas alike, whose sum has its peak at the mean of theirs: Hotelling's test."""
    steps, rng = np.linspace(-1, 1, 21), np.random.default_rng(1)
    y, x = peaks = rng.normal(0.05, 0.1, (2, 9))
    along_y, along_x = (np.square(steps - each[:, None]) for each in (y, x))
    maps = -along_y[:, :, None] - along_x[:, None, :]
    shared, mean = _shared_shift(maps, steps), peaks.mean(axis=1)
    np.testing.assert_allclose(shared.shift, mean)
    np.testing.assert_allclose(shared.errors, peaks.std(axis=1, ddof=1) / 3)
    t_squared = 9 * mean @ np.linalg.solve(np.cov(peaks), mean)
    expected = scipy.stats.f.sf(t_squared * (9 - 2) / (2 * (9 - 1)), 2, 9 - 2)
    assert shared.p_value == pytest.approx(expected)
    assert np.isnan(_shared_shift(maps[:3], steps).shift).all()


def test_patches_of_another_stone_or_of_wrong_places_are_noticed(caplog):
    wrong = nine(stone=stone_of(1006))
    assert (place(nine()).status == AGREES).all()
    assert caplog.text == ""
    assert "Check x_mm and y_mm" in fault_of(wrong).remedy
    assert AGREES not in set(place(wrong, accept=[FAULT]).status)
    # a mesh too smooth or too coarse to show the patches contradicts nothing
    for mesh in (0.1 * MESH, MESH.assign_attrs(mesh_edge_mm=0.6)):
        caplog.clear()
        place(wrong, mesh)
        assert [record.levelname for record in caplog.records] == ["WARNING"]


@pytest.mark.parametrize(
    ("orientation", "remedy"),
    [
        ("turned by 180°", "Set rotation_deg of patch 4 to -170."),
        (
            "reversed along x and turned by 90°",
            "Set flip of patch 4 to x, and set rotation_deg of patch 4 to 100.",
        ),
    ],
)
def test_one_patch_in_another_orientation_is_named_with_what_to_set(
    orientation, remedy
):
    heights = nine(0.5, rotation_deg=10.0)
    heights[3].values = oriented(heights[3].values, orientation)
    fault = fault_of(heights, rotation_deg=10.0)
    assert fault.patches == ("4",)
    assert fault.remedy.startswith(remedy)
    table = place(heights, rotation_deg=10.0, accept=[f"{FAULT}:4"])
    assert list(table.index[table.status == ELSEWHERE]) == ["4"]
    assert table.status[ALL] == AGREES
    # what the remedy says takes the fault away
    right, turn = lying_right(table.orientation["4"], Mould(False, None), is_alone=True)
    if right.flip:
        heights[3].values = np.flip(heights[3].values, "yx".index(right.flip))
    rotations = 3 * [10.0] + [10.0 + turn] + 5 * [10.0]
    assert (place(heights, rotation_deg=rotations).status == AGREES).all()


def test_exchanged_scans_are_named():
    heights = nine(0.5)
    heights[0], heights[4], heights[8] = heights[4], heights[8], heights[0]
    fault = fault_of(heights)
    assert fault.patches == ("1", "5", "9")
    ring = "1 at the position of 5, 5 at the position of 9, 9 at the position of 1"
    assert ring in fault.remedy


def test_one_right_study_of_a_hundred_has_a_patch_that_is_called_wrong():
    """Nine patches have sixteen ways each to be better somewhere; fifteen of them are looks."""
    settings = {"patch_mm": SIZE, "placement_um": 5.0}
    compared = Comparison(MESH, TABLE, nine(), **settings)
    of_one, of_all = compared.limit(9 + 15), compared.limit(9 * (9 + 15))
    leads = [-1.01 * of_one, -0.99 * of_one, 0, 1.01 * of_one, 0.99 * of_all]
    leads += [1.01 * of_all] * 4
    compared.alternatives = np.array(leads)
    assert of_all > 1.2 * of_one
    assert [*compared.status] == [AGREES] + 4 * [CANNOT_TELL] + 4 * [ELSEWHERE]


def test_a_patch_that_is_not_shown_is_not_said_to_agree():
    """Where the stone is as smooth as the scans are wrong."""
    heights = nine(0.5)
    heights[4] = heights[4] - 0.98 * patch_of(*NINE[4])
    far = np.maximum(abs(MESH.y - 2.5), abs(MESH.x - 2.5)) > 0.6
    table = place(heights, MESH.where(far, 0.02 * MESH))
    assert list(table.index[table.status == CANNOT_TELL]) == ["5"]


@pytest.mark.parametrize(
    ("table", "remedy"),
    [
        (lambda x, y: (SQUARE - x, y), "Set x_mm to 5 - x_mm in"),
        # from (x, y) to (S - y, x): the remedy is its inverse
        (lambda x, y: (SQUARE - y, x), "Set x_mm to y_mm and y_mm to 5 - x_mm in"),
    ],
)
def test_a_mirrored_table_is_a_fault_and_named(table, remedy):
    y, x = np.array([(1.0, 1.2, 2.3, 3.1, 3.9, 4.2), (0.7, 2.4, 3.9, 1.4, 3.1, 2.0)])
    heights = [*map(patch_of, y, x)]
    columns = dict(zip(["x_mm", "y_mm"], table(x, y), strict=True))
    fault = fault_of(heights, columns=columns)
    assert fault.remedy.startswith(remedy)


FLIPPED = {"invert": True, "flip": "x"}
NEITHER = "Set scans.mould.invert to false, and set scans.mould.flip to null."


@pytest.mark.parametrize(
    ("sign", "laid", "mould", "remedy"),
    [
        (1, "reversed along x", {}, "Set scans.mould.flip to x."),
        (-1, "reversed along x", FLIPPED, NEITHER),
        (1, "turned by 180°", {}, "Add 180 to the rotation_deg of every patch."),
    ],
)
def test_scans_laid_wrongly_are_noticed_and_the_remedy_named(sign, laid, mould, remedy):
    heights = nine()
    for height in heights:
        height.values = sign * oriented(height.values, laid)
    assert fault_of(heights, **mould).remedy == remedy
    # one patch is enough
    assert fault_of(heights[:1], **mould).remedy.startswith(remedy)
