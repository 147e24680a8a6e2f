"""`gst check --fix`: what has one cure gets it, what has two does not; nothing is lost."""

import io
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from gst.check.fixing import Cure, cures_of, offer
from gstlib.coupling.placement import Mould, oriented
from gstlib.errors import ConfigError
from gstlib.surfaces.footprints import Place, on_patch, spline_of
from gstlib.surfaces.grid import make_surface
from scipy.ndimage import gaussian_filter

SQUARE, SIZE, POINTS = 5.0, 0.85, 48
NINE = [(y, x) for y in (1.2, 2.5, 3.8) for x in (1.2, 2.5, 3.8)]


def study(
    laid="as given",
    shift=(0.0, 0.0),
    height=1.0,
    rose=(),
    fell=(),
    thickness=30.0,
    mould=None,
    only=None,
):
    """Nine patches of a stone, of which some rose and some fell.

    They, or `only` one, are `laid` so; `height` is that of the mesh beside that of the scans.
    """
    rough = gaussian_filter(np.random.default_rng(5).normal(size=(100, 100)), 2)
    stone = make_surface(0.1 * rough, SQUARE / 100, mesh_edge_mm=0.1, thickness_mm=thickness)
    mould = mould or Mould(invert=False, flip=None)
    names = [str(n) for n in range(1, 10)]
    scans = {}
    for name, (y, x) in zip(names, NINE, strict=True):
        place = Place(y + shift[0], x + shift[1], 0.0)
        heights = on_patch(spline_of(stone), place, (POINTS, POINTS), SIZE)
        is_laid = only in (None, name)
        seen = make_surface(oriented(heights, laid) if is_laid else heights, SIZE / POINTS)
        scans[name, "T0"] = seen.to_dataset(name="height")
    y, x = np.transpose(NINE)
    patches = pd.DataFrame({"patch": names, "x_mm": x, "y_mm": y, "rotation_deg": 0.0, "flip": ""})
    shares = {"found": 1, "loss_fraction": 0.0, "gain_fraction": 0.0}
    registration = pd.DataFrame({"patch": names} | shares)
    for column, which in (("gain_fraction", rose), ("loss_fraction", fell)):
        registration.loc[list(which), column] = 0.2
    return SimpleNamespace(
        config={"scans": {"size_mm": SIZE, "mould": mould._asdict()}}
        | {"square": {"size_mm": SQUARE}, "macroscale": {"face_mm": 15.0}},
        settings={"place_patches": {"patch_mm": SIZE, **mould._asdict()}},
        face=SimpleNamespace(height=stone.copy(data=height * stone.values)),
        patches=patches,
        prepared=scans,
        registration=registration,
    )


ROW = {"patch": "4", "x_mm": "1,2", "y_mm": "1.2", "t0": "a", "t1": "b"}


@pytest.mark.parametrize(
    ("given", "values", "cells"),
    [
        ({}, {}, {}),
        ({"laid": "reversed along x"}, {"scans.mould.flip": "x"}, {}),
        ({"laid": "turned by 90°"}, {}, {"rotation_deg": -90}),
        (
            {"laid": "reversed along x", "mould": Mould(invert=False, flip="x")},
            {"scans.mould.flip": None},
            {},
        ),
        ({"shift": (0.06, -0.09)}, {}, {"x_mm": 1.11, "y_mm": 1.26}),
        ({"laid": "turned by 90°", "only": "4"}, {}, {"rotation_deg": -90}),
        ({"laid": "turned by 90°", "only": "5"}, {}, {}),  # the row is that of patch 4
        ({"rose": range(6)}, {}, {"t0": "b", "t1": "a"}),
        ({"thickness": 12.34}, {"macroscale.face_mm": 12.3}, {}),
    ],
)
def test_what_has_one_cure(given, values, cells):
    found = cures_of(study(**given))
    assert {key: value for cure in found for key, value in cure.values.items()} == values
    written = {name: of for cure in found if cure.cells for name, of in cure.cells(ROW).items()}
    numbers = {name: float(of) for name, of in written.items() if name not in ("t0", "t1")}
    assert written | numbers == pytest.approx(cells, abs=5e-3)


def test_a_mirrored_table_is_turned_back():
    given = study()
    given.patches["x_mm"] = SQUARE - given.patches.x_mm
    (cure,) = cures_of(given)
    assert cure.cells(ROW) == {"x_mm": "3.8", "y_mm": "1.2"}


def test_places_by_hand_snap_to_the_mesh():
    given = study()
    off = np.random.default_rng(2).uniform(-0.4, 0.4, (9, 2))
    off[4] = 0.0
    right = given.patches[["y_mm", "x_mm"]].to_numpy()
    given.patches[["y_mm", "x_mm"]] = right + off
    (cure,) = cures_of(given)
    cells = {patch: cure.cells({"patch": patch}) for patch in given.patches.patch}
    assert cells["5"] == {}  # that is where it lies
    found = [[float(cells[p][c]) for c in ("y_mm", "x_mm")] for p in cells if cells[p]]
    np.testing.assert_allclose(found, np.delete(right, 4, axis=0), atol=0.03)


@pytest.mark.parametrize(
    "given",
    [
        {"rose": range(6), "fell": [7]},  # exchanged in some rows, or worn otherwise
        {"rose": range(6), "height": 0.0},  # exchanged, or a mould: the mesh does not tell
        {"thickness": 3.0},  # no face is as small as that
        {"thickness": np.nan},
    ],
)
def test_what_has_two_cures_or_none_has_none(given):
    assert cures_of(study(**given)) == []


CONFIG = "patches: mine.csv  # my table\nscans:\n  mould: {invert: true, flip: y}  # of silicone\n"
TABLE = '# places\npatch;x_mm;t0;t1\n1;1,5;"a; b";c\n2;2,5;d;\n'


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.yaml").write_text(CONFIG)
    (tmp_path / "mine.csv").write_text(TABLE)
    return tmp_path


def answered(monkeypatch, answer):
    monkeypatch.setattr("sys.stdin", io.StringIO(9 * f"{answer}\n"))


CURES = [
    Cure("they are turned", {"scans.mould.flip": "x"}, lambda _: {"rotation_deg": "90"}),
    Cure("they are exchanged", {}, lambda row: {"t0": row["t1"], "t1": row["t0"]}),
]


def test_the_difference_is_shown_and_copies_are_kept(files, monkeypatch, capsys):
    answered(monkeypatch, "")
    assert not offer(files / "study.yaml", CURES)
    assert (files / "study.yaml").read_text() == CONFIG
    shown = capsys.readouterr().out
    assert "-  mould: {invert: true, flip: y}  # of silicone" in shown
    assert "+  mould: {invert: true, flip: x}  # of silicone" in shown
    assert '+1;1,5;c;"a; b";90' in shown
    answered(monkeypatch, "y")
    assert offer(files / "study.yaml", CURES)
    assert (files / "study.yaml").read_text() == CONFIG.replace("flip: y", "flip: x")
    expected = '# places\npatch;x_mm;t0;t1;rotation_deg\n1;1,5;c;"a; b";90\n2;2,5;;d;90\n'
    assert (files / "mine.csv").read_text() == expected
    assert (files / "mine.csv.bak").read_text() == TABLE
    assert offer(files / "study.yaml", CURES[1:])  # back again
    assert (files / "mine.csv.bak").read_text() == TABLE
    assert (files / "mine.csv.bak2").read_text() == expected


def test_where_nobody_can_answer_nothing_is_written_unless_it_is_confirmed(files, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert not offer(files / "study.yaml", CURES)
    assert (files / "study.yaml").read_text() == CONFIG
    assert offer(files / "study.yaml", CURES, is_confirmed=True)
    assert "flip: x" in (files / "study.yaml").read_text()


def test_what_changes_nothing_is_not_asked(files, monkeypatch):
    answered(monkeypatch, "y")
    assert not offer(files / "study.yaml", [Cure("it is so already", {"scans.mould.flip": "y"})])
    assert not (files / "study.yaml.bak").exists()


def test_a_link_and_a_mode_stay_and_the_copy_is_no_more_readable(files):
    (files / "study.yaml").rename(files / "real.yaml")
    (files / "study.yaml").symlink_to("real.yaml")
    (files / "real.yaml").chmod(0o600)
    assert offer(files / "study.yaml", CURES, is_confirmed=True)
    assert (files / "study.yaml").is_symlink()
    assert "flip: x" in (files / "real.yaml").read_text()
    modes = {file.stat().st_mode & 0o777 for file in files.glob("*.yaml*")}
    assert modes == {0o600}


def test_a_file_that_changes_while_it_is_shown_stays(files, monkeypatch):
    def answer():
        (files / "mine.csv").write_text(f"{TABLE}3;3,5;e;\n")
        return "y"

    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=bool, readline=answer))
    with pytest.raises(ConfigError, match=r"mine\.csv: has changed"):
        offer(files / "study.yaml", CURES)
    assert (files / "study.yaml").read_text() == CONFIG
