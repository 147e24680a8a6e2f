"""`gst check --fix`: what has one cure gets it, what has two does not; nothing is lost."""

import io
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.ndimage import gaussian_filter

from gst.check.fixing import Cure, cures_of, offer
from gst.config.reading import complete
from gstlib.coupling.orientations import oriented
from gstlib.errors import ConfigError
from gstlib.surfaces.footprints import PatchPosition, on_patch, spline_of
from gstlib.surfaces.grid import make_surface

SQUARE, SIZE, POINTS = 5.0, 0.85, 48
NAMES = [*"123456789"]
NINE = np.array([(y, x) for y in (1.2, 2.5, 3.8) for x in (1.2, 2.5, 3.8)])
MIRRORED = (0.0, SQUARE) + NINE * (1, -1)


def study(
    laid="as given",
    only=NAMES,
    moved=0.0,
    mirrored=False,
    height=1.0,
    rose=(),
    fell=(),
    thickness=30.0,
):
    """Nine patches of a stone, of which some rose and some fell.

    They, or `only` some, are `laid` so. In the table their places are `moved` or `mirrored`. The
    `height` is that of the mesh beside that of the scans.
    """
    rough = gaussian_filter(np.random.default_rng(5).normal(size=(100, 100)), 2)
    stone = make_surface(
        0.1 * rough, SQUARE / 100, mesh_edge_mm=0.1, thickness_mm=thickness
    )
    scans = {}
    for name, (y, x) in zip(NAMES, NINE, strict=True):
        heights = on_patch(
            spline_of(stone), PatchPosition(y, x, 0.0), (POINTS, POINTS), SIZE
        )
        if name in only:
            heights = oriented(heights, laid)
        scans[name, "T0"] = make_surface(heights, SIZE / POINTS).to_dataset(
            name="height"
        )
    patches = pd.DataFrame({"patch": NAMES, "rotation_deg": 0.0, "flip": ""})
    patches[["y_mm", "x_mm"]] = MIRRORED if mirrored else NINE + moved
    registration = pd.DataFrame({"patch": NAMES, "found": 1})
    registration["gain_fraction"] = [0.2 * (n in rose) for n in range(9)]
    registration["loss_fraction"] = [0.2 * (n in fell) for n in range(9)]
    mould = {"invert": False, "flip": None}
    return SimpleNamespace(
        config=complete({"scans": {"mould": mould}}),
        settings={"check_placement": {"patch_mm": SIZE, **mould}},
        face=SimpleNamespace(height=stone.copy(data=height * stone.values)),
        patches=patches,
        prepared=scans,
        registration=registration,
    )


ROW = {"patch": "4", "x_mm": "1,2", "y_mm": "1.2", "t0": "a", "t1": "b"}


@pytest.mark.parametrize(
    ("faults", "mended"),
    [
        ("{}", "{}"),
        ("laid: reversed along x", "scans.mould.flip: x"),
        ("{laid: turned by 90°, only: '4'}", "rotation_deg: -90"),
        # the row is that of patch 4
        ("{laid: turned by 90°, only: '5'}", "{}"),
        ("moved: [-0.06, 0.09]", "{x_mm: 1.11, y_mm: 1.26}"),
        ("mirrored: true", "{x_mm: 3.8, y_mm: 1.2}"),
        ("rose: [0, 1, 2, 3, 4, 5]", "{t0: b, t1: a}"),
        ("thickness: 12.34", "macroscale.face_mm: 12.3"),
        # two cures, or none: exchanged in some rows, or worn otherwise
        ("{rose: [0, 1, 2, 3, 4, 5], fell: [7]}", "{}"),
        # or a mould: the mesh does not tell
        ("{rose: [0, 1, 2, 3, 4, 5], height: 0.0}", "{}"),
        # no face is as small as that
        ("thickness: 3.0", "{}"),
    ],
)
def test_a_fault_with_one_cure_has_that_alone(faults, mended):
    found = {}
    for cure in cures_of(study(**yaml.safe_load(faults))):
        cells = cure.cells(ROW) if cure.cells else {}
        found |= cure.values | {
            name: cell if name[0] == "t" else float(cell)
            for name, cell in cells.items()
        }
    assert found == pytest.approx(yaml.safe_load(mended), abs=5e-3)


STUDY, PATCHES = Path("study.yaml"), Path("mine.csv")
CONFIG = "patches: mine.csv  # my table\nscans:\n  mould: {invert: true, flip: y}  # of silicone\n"
TABLE = '# places\npatch;x_mm;t0;t1\n1;1,5;"a; b";c\n2;2,5;d;\n'


@pytest.fixture(autouse=True)
def _files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    STUDY.write_text(CONFIG)
    PATCHES.write_text(TABLE)


CURES = [
    Cure(
        "they are turned", {"scans.mould.flip": "x"}, lambda _: {"rotation_deg": "90"}
    ),
    Cure("they are exchanged", {}, lambda row: {"t0": row["t1"], "t1": row["t0"]}),
]


def offered(monkeypatch, answer):
    monkeypatch.setattr("sys.stdin", io.StringIO(answer))
    return offer(STUDY, CURES)


def test_the_difference_is_shown_and_copies_are_kept(monkeypatch, capsys):
    assert not offered(monkeypatch, "")  # nobody can answer
    assert STUDY.read_text() == CONFIG
    shown = capsys.readouterr().out
    assert "+  mould: {invert: true, flip: x}  # of silicone" in shown
    assert '+1;1,5;c;"a; b";90' in shown
    assert offered(monkeypatch, "y\n")
    assert STUDY.read_text() == CONFIG.replace("flip: y", "flip: x")
    expected = (
        '# places\npatch;x_mm;t0;t1;rotation_deg\n1;1,5;c;"a; b";90\n2;2,5;;d;90\n'
    )
    assert PATCHES.read_text() == expected
    assert offer(STUDY, CURES[1:], is_confirmed=True)  # back again
    assert Path("mine.csv.bak").read_text() == TABLE
    assert Path("mine.csv.bak2").read_text() == expected


def test_a_file_that_changes_while_it_is_shown_stays(monkeypatch):
    def answer():
        PATCHES.write_text(f"{TABLE}3;3,5;e;\n")
        return "y"

    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=bool, readline=answer))
    with pytest.raises(ConfigError, match=r"mine\.csv: has changed"):
        offer(STUDY, CURES)
    assert STUDY.read_text() == CONFIG
