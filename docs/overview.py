"""Draw the picture of README, docs/overview.png, from the results of the default study.

    make study && .venv/bin/python docs/overview.py [results]

Its patch is a typical one: of those in the statistics, the one next to the median MCC. The picture
says inside which table of scores it shows, so that a test sees when that is of an earlier program.
"""

import json
import sys
from pathlib import Path

from PIL import Image, PngImagePlugin

from gst.page.figures.microscale import overview_figure
from gst.page.figures.style import save_figure
from gst.page.results import Results
from gstlib.io.files import sha256
from gstlib.io.tables import read_table


def main(results: Path, picture: Path) -> None:
    table = results / "tables/validation_patches.csv"
    scores = read_table(table)
    counted = scores[scores.in_statistics].sort_values("mcc")
    patch = counted.patch.iloc[(len(counted) - 1) // 2]
    config = json.loads((results / "provenance.json").read_text(encoding="utf-8"))[
        "config"
    ]
    study = Results(
        files={
            "contacts": sorted(results.glob("microscale/[0-9]*")),
            "t1": sorted(results.glob("surfaces/T1/[0-9]*")),
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
        patch_mm=config["scans"]["size_mm"],
        force_N=config["load"]["force_N"],
    )
    save_figure(
        overview_figure(study, patch), picture, source_note="synthetic specimen"
    )
    shows = PngImagePlugin.PngInfo()
    shows.add_text("scores", sha256(table))
    with Image.open(picture) as drawn:
        drawn.load()
        drawn.save(picture, pnginfo=shows)
    print(f"patch {patch}; the median MCC is {counted.mcc.median():.2f}")


if __name__ == "__main__":
    results = Path(sys.argv[1] if len(sys.argv) > 1 else "results")
    main(results, Path(__file__).with_suffix(".png"))
