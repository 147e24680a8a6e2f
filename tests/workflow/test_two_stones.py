"""A second stone on the first, pressed in one pose and in a gesture: a tiny study of its own."""

import re

import numpy as np
import pytest
import trimesh
from gstlib.contact import laid_height
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.footprints import square_of

from .conftest import assert_stored, fresh, intervals_of, opened


@pytest.fixture(scope="module")
def two_stones(tmp_path_factory):
    study = fresh(tmp_path_factory.mktemp("two_stones"))
    study.change(
        specimen={"counterface_seed": 8},
        counterface=None,
        gesture={"stroke_mm": 1.0, "poses": 5},
        reference_draws=None,
        grinding=None,
        hardness=None,
    )
    study.succeed()
    return study


def test_both_faces_make_the_gap(two_stones, tmp_path):
    """The macroscale contact keeps its conditions on the sum of both heights."""
    contact = read_dataset(two_stones.results / "macroscale/contact.h5")
    assert float(contact.counterface.std()) > 5e-3
    faces = laid_height(contact).values
    rigid = faces - faces.max() + float(contact.displacement)
    touching = contact.pressure.values > 0
    displaced = contact.gap.values + rigid  # K p, which is smooth; what touches follows the faces
    np.testing.assert_allclose(displaced[touching], rigid[touching], atol=1e-9)
    assert 0.01 < touching.mean() < 0.5
    # the other stone of the same kind is another
    both = contact.height.values.ravel(), contact.counterface.values.ravel()
    assert abs(np.corrcoef(*both)[0, 1]) < 0.7
    # and a patch is pressed by the face over it
    places = read_table(two_stones.results / "tables/patch_pressures.csv").set_index("patch")
    for file in two_stones.results.glob("microscale/*/*.h5"):
        place, patch = places.loc[file.stem], read_dataset(file)
        away = {axis: abs(contact[axis] - place[f"{axis}_mm"]) for axis in "yx"}
        near = contact.counterface.where((away["y"] < 0.2) & (away["x"] < 0.2))
        middle = float(patch.counterface.values[30:34, 30:34].mean())
        assert float(near.min()) - 1e-3 < middle < float(near.max()) + 1e-3
    # the intervals are those under it, too
    stored = two_stones.results / "tables/patch_intervals.csv"
    assert_stored(intervals_of(two_stones), stored, tmp_path)


def test_the_pose_in_the_middle_of_a_stroke_is_the_single_one(two_stones):
    found = read_dataset(two_stones.results / "gesture/exposure.h5")
    pressures = read_table(two_stones.results / "tables/patch_pressures.csv")
    assert found.patch.values.tolist() == pressures.patch.tolist()
    np.testing.assert_allclose(
        found.patch_pressure[2], pressures.pressure_MPa, rtol=1e-4, atol=1e-6
    )
    assert float(abs(found.patch_pressure[0] - found.patch_pressure[2]).max()) > 1
    # 550 N on a face of 10 mm, over a stroke of 1 mm
    np.testing.assert_allclose(found.mean_pressure.mean(), 5.5, rtol=1e-6)
    np.testing.assert_allclose(found.exposure.mean(), 5.5, rtol=1e-6)
    table = read_table(two_stones.results / "tables/exposure.csv").set_index("patch")
    np.testing.assert_allclose(
        table.mean_pressure_MPa, found.patch_pressure.mean("pose"), rtol=1e-4, atol=1e-6
    )


def test_wear_follows_the_gesture(two_stones):
    """Patches lose in proportion to their exposure, as long as little is lost."""
    path = read_dataset(two_stones.results / "wear/square.h5")
    table = read_table(two_stones.results / "tables/exposure.csv").set_index("patch")
    first = path.pressed.sel(ratio=0, body="stone").isel(step=1).to_series()
    rate = first / float(path.kappa.sel(ratio=0)[1])
    np.testing.assert_allclose(rate, table.exposure_N_per_mm[rate.index], rtol=1e-3, atol=1e-4)


def test_the_page_shows_the_gesture(two_stones):
    page = (two_stones.results / "index.html").read_text(encoding="utf-8")
    assert "what a gesture leaves on the square" in page
    assert "Archard&#39;s law over a gesture of 5 poses predicts" in page
    names = ("macroscale/contact", "pressure"), ("gesture/exposure", "exposure")
    fields = [read_dataset(two_stones.results / f"{file}.h5")[name] for file, name in names]
    highest = [float(square_of(field, 5.0).max()) for field in fields]
    said = re.findall(r"<span>([\d.]+) (MPa|N/mm)</span></span>", page.replace("\u202f", ""))
    assert [unit for _, unit in said] == ["MPa", "N/mm"]
    assert [float(value) for value, _ in said] == pytest.approx(highest, rel=5e-3)
    assert (two_stones.results / "figures/exposure.png").stat().st_size > 10_000


@pytest.mark.browser
def test_the_other_stone_is_lifted_on_the_page(two_stones, browser):
    with opened(browser, two_stones.results / "index.html") as page:
        pictures = []
        for lifted in ("1", "4"):
            page.locator("#lift").fill(lifted)
            pictures.append(page.locator("#viewer canvas").screenshot())
    assert pictures[0] != pictures[1]


@pytest.mark.slow
def test_a_flat_second_stone_changes_no_digit(tiny):
    flat = trimesh.creation.box((12, 12, 1), trimesh.transformations.translation_matrix((7, 1, 2)))
    flat.subdivide_to_size(0.4).export(tiny.folder / "flat.stl")
    corners = [[4.5, -1.5, 2.5], [9.5, -1.5, 2.5], [4.5, 3.5, 2.5]]
    tiny.change(counterface=None)
    tiny.succeed()
    before = tiny.tables()
    tiny.change(counterface={"mesh": "flat.stl", "pose": {"points_mm": corners}})
    tiny.succeed()
    assert tiny.tables() == before
    contact = read_dataset(tiny.results / "macroscale/contact.h5")
    assert float(abs(contact.counterface).max()) < 1e-12
