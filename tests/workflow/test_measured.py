"""A study of measured files: what the generated one does not have."""

import numpy as np
import pandas as pd
from gstlib.io.store import read_dataset


def test_patches_are_cut_from_larger_scans_that_need_no_unmoulding(measured):
    """Two patches are pieces of one scan; heights stay up, and rows and columns as they are."""
    table = measured.folder / "config/patches_tiny.tsv"
    rows = pd.read_csv(table, sep="\t", comment="#", dtype=str)[:2]
    rows["t0"] = "5_T0.plu"
    rows = rows.drop(columns="t1").assign(crop_x_mm=["0.1", "-0.1"], crop_y_mm=["-0.05", "0.15"])
    rows.to_csv(table, sep="\t", index=False)
    measured.change(
        scans={"size_mm": 0.4, "mould": {"invert": False, "flip": None}},
        preprocessing={"outlier_median_threshold": 1000.0},
    )
    files = [f"results-measured/surfaces/{patch}_T0.h5" for patch in rows.patch]
    measured.succeed(*files)
    content = (measured.folder / "data/scans/5_T0.plu").read_bytes()
    raw = np.frombuffer(content, "<f4", 64 * 64, 508).reshape(64, 64)
    for row, file in zip(rows.itertuples(), files, strict=True):
        surface = read_dataset(measured.folder / file)
        count = len(surface.y)
        assert count == round(0.4 / 13.28e-3)
        first_y, first_x = (
            round((0.42496 + float(centre) - 0.2) / 13.28e-3)
            for centre in (row.crop_y_mm, row.crop_x_mm)
        )
        pieces = []
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                y, x = first_y + dy, first_x + dx
                piece = raw[y : y + count, x : x + count].astype(float)
                good = np.abs(piece) < 1e4
                pieces.append(np.corrcoef(piece[good], surface.measured.values[good] * 1e3)[0, 1])
        # within a point of where it should be cut
        assert np.nanmax(pieces) > 0.9999
