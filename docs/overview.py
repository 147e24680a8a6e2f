"""Draw the picture of README, docs/overview.png, from the results of the default study.

    make study && .venv/bin/python docs/overview.py [results]

Its patch is a typical one: of those in the statistics, the one next to the median MCC.
"""

import json
import sys
from pathlib import Path

from gst.figures.microscale import PatchResult, overview_figure
from gst.figures.study import Study
from gst.figures.style import save_figure
from gstlib.io.tables import read_table

results = Path(sys.argv[1] if len(sys.argv) > 1 else "results")
scores = read_table(results / "tables/validation_patches.csv")
counted = scores[scores.in_statistics].sort_values("mcc")
patch = counted.patch.iloc[(len(counted) - 1) // 2]
config = json.loads((results / "provenance.json").read_text(encoding="utf-8"))["config"]

study = Study(
    files={
        "contacts": sorted(results.glob("microscale/[0-9]*")),
        "registered": sorted(results.glob("change/[0-9]*")),
        "depths": sorted(results.glob("wear/[0-9]*")),
        "contact": results / "macroscale/contact.h5",
        "surface": results / "macroscale/surface.h5",
        "pressures": results / "tables/patch_pressures.csv",
        "mesh": results / "specimen/mesh.stl",
    },
    patches=list(scores.patch),
    worn=list(scores.patch),
    size_mm=config["square"]["size_mm"],
)
contact = study.by_patch("contacts", [patch], "height", "pressure", "mean_pressure")[patch]
figure = overview_figure(
    study.square("contact"),
    study.pressures,
    study.tool,
    PatchResult(patch, contact, study.change(patch), study.predicted(patch)),
    patch_size_mm=config["scans"]["size_mm"],
    force_N=config["load"]["force_N"],
)
save_figure(figure, Path(__file__).with_suffix(".png"), source_note="synthetic specimen")
print(f"patch {patch}; the median MCC is {counted.mcc.median():.2f}")
