"""Place the T0 scans on the surface of the mesh, with similar detail between them."""

from pathlib import Path
from typing import Any

import pandas as pd

from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of, scans_of, write_result
from gstlib.macroscale.composite import compose_surface


def main(
    face: Path,
    t0: list[Path],
    composite: Path,
    *,
    patches: dict[str, list],
    **settings: Any,
) -> None:
    """`settings` are arguments of `compose_surface`."""
    around, scans = dataset_of(face), scans_of(t0, patches["patch"])
    composed = compose_surface(around, pd.DataFrame(patches), scans, **settings)
    write_result(composite, composed, "compose_surface")


run_in_snakemake(main)
