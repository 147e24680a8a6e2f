"""Clean the scans of a patch and, where there is a T1, lay it over T0.

Inputs: the scan at T0 and, if any, at T1. Outputs: a surface for each; the height change.
Settings: patch side, the piece to cut, how scans are stored, preprocessing, farthest shift.
"""

from pathlib import Path

import xarray as xr

from gstlib.io.scans import check_size, cut_scan, read_scan
from gstlib.io.store import write_dataset
from gstlib.logs import job_log
from gstlib.preprocess.mould import unmould
from gstlib.preprocess.scan import prepare_scan
from gstlib.provenance import provenance
from gstlib.validation.change import height_change
from gstlib.validation.registration import apply_registration, register


def prepare(
    scan: Path,
    surface: Path,
    *,
    patch_mm: float,
    crop: list | None,
    scans: dict,
    preprocessing: dict,
) -> xr.DataArray:
    """Read, cut, clean and store one scan; return its heights."""
    spacing_um = scans["scatter_spacing_um"]
    raw = read_scan(
        scan,
        unit=scans["unit"],
        scatter_spacing_mm=None if spacing_um is None else spacing_um * 1e-3,
        scatter_extent_mm=scans["scatter_extent_mm"],
    )
    if crop is None:
        check_size(raw, patch_mm)
    else:
        raw = cut_scan(raw, crop, patch_mm)
    mould = scans["mould"]
    prepared = prepare_scan(
        raw, mould_invert=mould["invert"], mould_flip=mould["flip"], **preprocessing
    )
    prepared["measured"] = unmould(raw, invert=mould["invert"], flip_axis=mould["flip"])
    settings = {"patch_mm": patch_mm, "crop": crop, "scans": scans, "preprocessing": preprocessing}
    write_dataset(surface, prepared, provenance([scan], settings))
    return prepared.height


def lay_over(
    t0: xr.DataArray,
    t1: xr.DataArray,
    registered: Path,
    *,
    inputs: list[Path],
    maximum_shift_mm: float,
) -> None:
    """Register T1 to T0 and store the height change."""
    registration = register(t0, t1, maximum_shift_mm=maximum_shift_mm)
    change = height_change(t0, apply_registration(t1, registration, like=t0))
    settings = {"maximum_shift_mm": maximum_shift_mm}
    write_dataset(registered, change, registration.as_attrs() | provenance(inputs, settings))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        heights = {
            epoch: prepare(
                Path(scan),
                Path(snakemake.output[epoch]),
                patch_mm=snakemake.params.patch_mm,
                crop=snakemake.params.crop,
                scans=snakemake.params.scans,
                preprocessing=snakemake.params.preprocessing,
            )
            for epoch, scan in snakemake.input.items()
        }
        if "t1" in heights:
            lay_over(
                heights["t0"],
                heights["t1"],
                Path(snakemake.output.registered),
                inputs=[Path(snakemake.output.t0), Path(snakemake.output.t1)],
                maximum_shift_mm=snakemake.params.maximum_shift_mm,
            )
