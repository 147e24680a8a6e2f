"""Press the whole square at the scans' resolution, once for each draw of what was not scanned.

On a generated specimen it is the true surface, of which there is one.
"""

from pathlib import Path

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.coupling import places_of
from gstlib.io.store import read_dataset, write_dataset
from gstlib.preprocess.filtering import s_filtered
from gstlib.reference import composite_heights, patches_of_reference
from gstlib.study import solve_reference


def main(
    surface: Path,
    composite: Path,
    t0: list[Path],
    true_surface: Path,
    truth: Path,
    contact: Path,
    patches: Path,
    *,
    draws: int,
    s_filter_um: float | None,
    seed: int,
    **settings: float,
) -> None:
    scan = read_dataset(t0[0], only=["height"]).height
    counterface = read_dataset(surface).get("counterface")
    if truth:
        places = read_dataset(truth, only=["x_mm", "y_mm", "rotation_deg"]).sel(epoch="T0")
        inputs, draws = [true_surface, truth], 1
    else:
        composed = read_dataset(composite)
        places = composed[["x_mm", "y_mm", "rotation_deg"]]
        inputs = [surface, composite, *t0]

    def pressures():
        for draw in range(draws):
            if truth:
                heights = read_dataset(true_surface).height.astype(float)
            else:
                scans = (
                    s_filtered(read_dataset(file, only=["height"]).height, s_filter_um)
                    for file in t0
                )
                mesh = read_dataset(surface, only=["height"])
                heights = composite_heights(mesh, composed, scans, seed=seed, draw=draw)
            solved = solve_reference(heights, counterface, source=inputs[0], **settings)
            if draw == 0:
                write_dataset(contact, solved, provenance(inputs, settings))
            yield solved.pressure

    table = places.to_dataframe().reset_index()
    found = patches_of_reference(pressures(), places_of(table), scan)
    write_dataset(patches, found, provenance(inputs, settings | {"draws": draws}))


if "snakemake" in globals():
    run_script(snakemake, main)
