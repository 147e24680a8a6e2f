"""How laboratories name their scans: each scheme is read right, or it is asked, never guessed."""

import pytest
from gst.setup.file_names import read_names
from gstlib.errors import InputError

# By patch, the scan before, the one after (empty: none yet) and, where there is one, the repeat.
READ = {
    "as the program proposes": {"E1": "E1_T0.sur, E1_T1.sur", "E2": "E2_T0.sur, E2_T1.sur"},
    "with a repeat": {"1": "1_T0.plu, 1_T1.plu, 1_repeat.plu", "2": "2_T0.plu, 2_T1.plu"},
    "strokes, and all that the instrument did": {
        "loc1": "ISEA-A1_LSM_20x-0.70_dorsal_loc1_shift-extract_0strokes.sur, "
        "ISEA-A1_LSM_20x-0.70_dorsal_loc1_shift-extract_2000strokes.sur",
        "loc2": "ISEA-A1_LSM_20x-0.70_dorsal_loc2_shift-extract_0strokes.sur, "
        "ISEA-A1_LSM_20x-0.70_dorsal_loc2_shift-extract_2000strokes.sur",
    },
    "before and after": {
        "loc1": "Pebble03_loc1_before.sur, Pebble03_loc1_after.sur",
        "loc2": "Pebble03_loc2_before.sur, Pebble03_loc2_after.sur",
    },
    "blanks": {
        "3": "Stone 1 patch 3 before use.sur, Stone 1 patch 3 after use.sur",
        "4": "Stone 1 patch 4 before use.sur, Stone 1 patch 4 after use.sur",
    },
    "camel case": {
        "Loc1": "Loc1Before.x3p, Loc1After.x3p",
        "Loc2": "Loc2Before.x3p, Loc2After.x3p",
    },
    "the epoch first": {"A": "before_A.sur, after_A.sur", "B": "before_B.sur, after_B.sur"},
    "German": {
        "Stelle1": "Stein1_Stelle1_vorher.plux, Stein1_Stelle1_nachher.plux",
        "Stelle2": "Stein1_Stelle2_vorher.plux, Stein1_Stelle2_nachher.plux",
    },
    "German, short": {"S1": "S1_vor.sur, S1_nach.sur", "S2": "S2_vor.sur, S2_nach.sur"},
    "French, with accents": {
        "zone1": "galet zone1 avant.sur, galet zone1 après.sur",
        "zone2": "galet zone2 avant.sur, galet zone2 après.sur",
    },
    "French, decomposed accents": {"1": "z1_avant.sur, z1_apre\u0300s.sur"},
    "Italian": {
        "area1": "M12_area1_prima.plu, M12_area1_dopo.plu",
        "area2": "M12_area2_prima.plu, M12_area2_dopo.plu",
    },
    "Spanish": {"p1": "p1-antes.plux, p1-despues.plux", "p2": "p2-antes.plux, p2-después.plux"},
    "Portuguese": {"1": "p1 antes.sur, p1 depois.sur"},
    "unused and used": {"1": "1_unused.sur, 1_used.sur", "2": "2_unused.sur, 2_used.sur"},
    "capitals": {"A1": "A1_PRE.x3p, A1_POST.x3p", "A2": "A2_PRE.x3p, A2_POST.x3p"},
    "folders of epochs": {"loc1": "T0/loc1.sur, T1/loc1.sur", "loc2": "T0/loc2.sur, T1/loc2.sur"},
    "folders of places": {"loc1": "loc1/T0.sur, loc1/T1.sur", "loc2": "loc2/T0.sur, loc2/T1.sur"},
    "dates": {
        "loc1": "2023-05-01_loc1.sur, 2023-06-12_loc1.sur",
        "loc2": "2023-05-01_loc2.sur, 2023-06-12_loc2.sur",
    },
    "dates without hyphens": {
        "loc1": "loc1_20230501.sur, loc1_20230612.sur",
        "loc2": "loc2_20230502.sur, loc2_20230612.sur",
    },
    "epochs and dates with the day first": {"1": "l1 T0 24.05.2023.sur, l1 T1 03.06.2023.sur"},
    "dates and epochs": {
        "loc1": "20230501_loc1_T0.sur, 20230612_loc1_T1.sur",
        "loc2": "20230502_loc2_T0.sur, 20230613_loc2_T1.sur",
    },
    "times of day": {
        "loc1": "loc1_T0_20230501_143512.sur, loc1_T1_20230612_091122.sur",
        "loc2": "loc2_T0_20230501_144003.sur, loc2_T1_20230612_092755.sur",
    },
    "minutes": {"loc1": "loc1_0min.sur, loc1_60min.sur", "loc2": "loc2_0min.sur, loc2_60min.sur"},
    "hours and minutes": {"1": "loc1_30min.sur, loc1_2h.sur"},
    "cycles as words first": {
        "A": "A_cycles0.sur, A_cycles10000.sur",
        "B": "B_cycles0.sur, B_cycles10000.sur",
    },
    "first and second epoch": {"1": "1_T1.sur, 1_T2.sur", "2": "2_T1.sur, 2_T2.sur"},
    "epochs in words": {
        "loc1": "epoch1_loc1.sur, epoch2_loc1.sur",
        "loc2": "epoch1_loc2.sur, epoch2_loc2.sur",
    },
    "zeros before numbers, in some": {
        "loc01": "loc01_T0.sur, loc1_T1.sur",
        "loc02": "loc02_T0.sur, loc2_T1.sur",
    },
    "two formats": {"loc1": "loc1_T0.plu, loc1_T1.sur", "loc2": "loc2_T0.plu, loc2_T1.sur"},
    "some scanned before only": {"loc1": "loc1_T0.sur, loc1_T1.sur", "loc2": "loc2_T0.sur, "},
    "all scanned before only": {"loc1": "loc1_before.sur, ", "loc2": "loc2_before.sur, "},
    "repeats with their epoch": {
        "loc1": "loc1_T0.sur, loc1_T1.sur, loc1_T0_rep.sur",
        "loc2": "loc2_T0.sur, loc2_T1.sur",
    },
    "numbered repeats": {"1": "loc1_T0_rep2.sur, loc1_T1_rep2.sur, loc1_T0_rep10.sur"},
    "a repeat in German": {"1": "p1_vorher.sur, p1_nachher.sur, p1_vorher_Wdh.sur"},
    "a control": {"C1": "C1_T0.sur, , C1_repeat.sur", "E1": "E1_T0.sur, E1_T1.sur"},
    "only what is unworn is named": {"E1": "E1_before.sur, E1.sur", "E2": "E2_before.sur, E2.sur"},
    "only what is worn is named": {
        "loc1": "loc1.sur, loc1_worn.sur",
        "loc2": "loc2.sur, loc2_worn.sur",
    },
    "two faces": {
        "dorsal": "dorsal_1_T0.sur, dorsal_1_T1.sur",
        "ventral": "ventral_1_T0.sur, ventral_1_T1.sur",
    },
    "grid of rows and columns": {
        "r1c1": "r1c1_T0.sur, r1c1_T1.sur",
        "r1c2": "r1c2_T0.sur, r1c2_T1.sur",
    },
    "umlauts in the places": {
        "Flache": "Fläche_T0.sur, Fläche_T1.sur",
        "Hohe": "Höhe_T0.sur, Höhe_T1.sur",
    },
    "two magnifications": {
        "10x": "1_T0_10x.plu, 1_T1_10x.plu",
        "50x": "1_T0_50x.plu, 1_T1_50x.plu",
    },
    "both on one day": {"1": "2026-05-01_loc1_before.sur, 2026-05-01_loc1_after.sur"},
}

# Files of which the names alone have two readings.
ASKED = {
    "folders in words": "01 before/1.plux, 01 before/2.plux, 02 after/1.plux, 02 after/2.plux",
    "dates of which day or month is first": "loc1_03.04.2023.sur, loc1_04.03.2023.sur",
    "dates with the day first": "loc1 24.05.2023.sur, loc1 03.06.2023.sur",
    "three dates": "loc1_20230501.sur, loc1_20230612.sur, loc1_20230701.sur",
    "dates against epochs": "20230501_loc1_T1.sur, 20230612_loc1_T0.sur",
    "three states": "l1_0strokes.sur, l1_500strokes.sur, l1_2000strokes.sur",
    "three epochs": "1_T0.sur, 1_T1.sur, 1_T2.sur, 2_T0.sur, 2_T1.sur, 2_T2.sur",
    "each file in two formats": "loc1_T0.plu, loc1_T0.sur, loc1_T1.plu, loc1_T1.sur",
    "some scanned after only": "loc1_T0.sur, loc1_T1.sur, loc2_T1.sur",
    "all scanned after only": "loc1_after.sur, loc2_after.sur",
    "a second scan that may be a repeat": "loc1_T0.sur, loc1_T0_2.sur, loc1_T1.sur",
    "letters behind the epoch": "loc1_T0a.sur, loc1_T0b.sur, loc1_T1.sur",
    "letters for epochs": "S1a.sur, S1b.sur, S2a.sur, S2b.sur",
    "numbers for both": "1-1.sur, 1-2.sur, 2-1.sur, 2-2.sur",
    "numbers of strokes, without the word": "loc1_0.sur, loc1_2000.sur",
    "serial numbers": "Topo_0001.plu, Topo_0002.plu, Topo_0003.plu, Topo_0004.plu",
    "tools that are named like epochs": "T1_loc1_before.sur, T1_loc1_after.sur, "
    "T2_loc1_before.sur, T2_loc1_after.sur",
    "before and after cleaning": "1_T0_before-cleaning.sur, 1_T0_after-cleaning.sur, "
    "1_T1_before-cleaning.sur, 1_T1_after-cleaning.sur",
    "two kinds of words, one of them on some": "loc1_T0_before.sur, loc1_T1_after.sur, "
    "loc2_T0.sur, loc2_T1.sur",
    "capitals alone tell two apart": "a1_T0.sur, A1_T0.sur, a1_T1.sur, A1_T1.sur",
}


def check_read(right, pattern=None):
    """Whether files are read right, listed in one order and in the other."""
    right = {patch: (*files.split(", "), "")[:3] for patch, files in right.items()}
    listed = [name for files in right.values() for name in files if name]
    for names in (listed, listed[::-1]):
        read = read_names(names, pattern)
        assert read.questions == []
        assert read.left == []
        assert {row.patch: (row.t0, row.t1, row.repeat) for row in read.rows} == right


@pytest.mark.parametrize("scheme", READ)
def test_names_are_read_right(scheme):
    check_read(READ[scheme])


@pytest.mark.parametrize("scheme", ASKED)
def test_names_with_two_readings_become_a_question(scheme):
    names = ASKED[scheme].split(", ")
    for given in (names, names[::-1]):
        read = read_names(given)
        assert read.questions
        used = [name for row in read.rows for name in row[1:] if name]
        assert len(used) == len(set(used))


def test_a_pattern_explains_other_names():
    check_read({"S1": "S1a.sur, S1b.sur", "S2": "S2a.sur, S2b.sur"}, "{patch}{epoch}")
    check_read({"1": "1-2.sur, 1-10.sur", "2": "2-2.sur, 2-10.sur"}, "{patch}-{epoch}")
    check_read({"A": "vor A.sur, nach A.sur", "B": "vor B.sur, nach B.sur"}, "{epoch} {patch}")
    assert read_names(["1-1", "1-2", "1-3"], "{patch}-{epoch}").questions
    for pattern in ("{patch}_{epoch}", "{patch}", "{patch}-{epoch}{epoch}"):
        with pytest.raises(InputError):
            read_names(["1-1.sur"], pattern)
