"""How laboratories name their scans: each scheme is read right, or it is asked, never guessed."""

import pytest
import yaml

from gst.setup.file_names import read_names
from gstlib.errors import InputError

# By patch, the scan before, the one after (empty: none yet) and, where there is one, the repeat.
READ = yaml.load(
    """
with a repeat:
  1: 1_T0.plu, 1_T1.plu, 1_repeat.plu
  2: 2_T0.plu, 2_T1.plu
strokes, and all that the instrument did:
  loc1: ISEA-A1_LSM_20x-0.70_dorsal_loc1_shift-extract_0strokes.sur,
    ISEA-A1_LSM_20x-0.70_dorsal_loc1_shift-extract_2000strokes.sur
  loc2: ISEA-A1_LSM_20x-0.70_dorsal_loc2_shift-extract_0strokes.sur,
    ISEA-A1_LSM_20x-0.70_dorsal_loc2_shift-extract_2000strokes.sur
blanks:
  3: Stone 1 patch 3 before use.sur, Stone 1 patch 3 after use.sur
  4: Stone 1 patch 4 before use.sur, Stone 1 patch 4 after use.sur
camel case:
  Loc1: Loc1Before.x3p, Loc1After.x3p
  Loc2: Loc2Before.x3p, Loc2After.x3p
French, decomposed accents:
  1: z1_avant.sur, z1_apre\u0300s.sur
dates without hyphens:
  loc1: loc1_20230501.sur, loc1_20230612.sur
  loc2: loc2_20230502.sur, loc2_20230612.sur
epochs and dates with the day first:
  1: l1 T0 24.05.2023.sur, l1 T1 03.06.2023.sur
times of day:
  loc1: loc1_T0_20230501_143512.sur, loc1_T1_20230612_091122.sur
  loc2: loc2_T0_20230501_144003.sur, loc2_T1_20230612_092755.sur
cycles as words first:
  A: A_cycles0.sur, A_cycles10000.sur
  B: B_cycles0.sur, B_cycles10000.sur
first and second epoch:
  1: 1_T1.sur, 1_T2.sur
  2: 2_T1.sur, 2_T2.sur
some scanned before only:
  loc1: loc1_T0.sur, loc1_T1.sur
  loc2: loc2_T0.sur
numbered repeats:
  1: loc1_T0_rep2.sur, loc1_T1_rep2.sur, loc1_T0_rep10.sur
a control:
  C1: C1_T0.sur, , C1_repeat.sur
  E1: E1_T0.sur, E1_T1.sur
only what is worn is named:
  loc1: loc1.sur, loc1_worn.sur
  loc2: loc2.sur, loc2_worn.sur
umlauts in the places, and folders of epochs:
  Flache: T0/Fläche.sur, T1/Fläche.sur
  Hohe: T0/Höhe.sur, T1/Höhe.sur
""",
    yaml.BaseLoader,
)

# Files of which the names alone have two readings.
ASKED = yaml.safe_load("""
folders in words: 01 before/1.plux, 01 before/2.plux, 02 after/1.plux, 02 after/2.plux
dates against epochs: 20230501_loc1_T1.sur, 20230612_loc1_T0.sur
three states: l1_0strokes.sur, l1_500strokes.sur, l1_2000strokes.sur
each file in two formats: loc1_T0.plu, loc1_T0.sur, loc1_T1.plu, loc1_T1.sur
some scanned after only: loc1_T0.sur, loc1_T1.sur, loc2_T1.sur
a mark on a repeat alone: loc1.sur, loc1_T0_rep.sur
letters for epochs: S1a.sur, S1b.sur, S2a.sur, S2b.sur
tools that are named like epochs: T1_loc1_before.sur, T1_loc1_after.sur,
  T2_loc1_before.sur, T2_loc1_after.sur
two kinds of words, one of them on some: loc1_T0_before.sur, loc1_T1_after.sur,
  loc2_T0.sur, loc2_T1.sur
capitals alone tell two apart: a1_T0.sur, A1_T0.sur, a1_T1.sur, A1_T1.sur
""")


def check_read(right, pattern=None):
    """Files are read right, listed in one order and in the other."""
    expected = {
        patch: (*files.split(", "), "", "")[:3] for patch, files in right.items()
    }
    listed = [name for files in expected.values() for name in files if name]
    for names in (listed, listed[::-1]):
        read = read_names(names, pattern)
        assert (read.questions, read.left) == ([], [])
        rows = {row.patch: (row.t0, row.t1, row.repeat) for row in read.rows}
        assert rows == expected


@pytest.mark.parametrize("scheme", READ)
def test_names_are_read_right(scheme):
    check_read(READ[scheme])


@pytest.mark.parametrize("scheme", ASKED)
def test_names_with_two_readings_become_a_question(scheme):
    names = ASKED[scheme].split(", ")
    for listed in (names, names[::-1]):
        read = read_names(listed)
        assert read.questions
        used = [name for row in read.rows for name in row[1:] if name]
        assert len(used) == len(set(used))


def test_a_pattern_explains_other_names():
    check_read({"1": "1-2.sur, 1-10.sur", "2": "2-2.sur, 2-10.sur"}, "{patch}-{epoch}")
    check_read(
        {"A": "vor A.sur, nach A.sur", "B": "vor B.sur, nach B.sur"}, "{epoch} {patch}"
    )
    assert read_names(["1-1", "1-2", "1-3"], "{patch}-{epoch}").questions
    for pattern in ("{patch}_{epoch}", "{patch}", "{patch}-{epoch}{epoch}"):
        with pytest.raises(InputError):
            read_names(["1-1.sur"], pattern)
