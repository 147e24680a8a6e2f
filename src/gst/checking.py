"""Checks a study without running it, and says what a run would do: `gst check`."""

import logging
from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from gst.config import check_files, counterface_mesh, read_config, read_study
from gst.inputs import Asked, Inputs, check_inputs
from gst.patches import scan_files
from gst.poses import reach_of
from gstlib.contact import contact_moduli
from gstlib.errors import GstError, InputsError
from gstlib.io.files import check_writable

__all__ = ["check_study"]


def _summary(config: dict, patches: pd.DataFrame, found: Inputs | None) -> str:
    """What a run would do, and the sizes, which show whether units were read as intended."""
    macroscale, material = config["macroscale"], config["material"]
    elements, (modulus, standard) = macroscale["grid"], contact_moduli(material)
    lines = {
        "stone": config["inputs"]["mesh"] if config["inputs"] else "to be generated",
        "macroscale": f"{config['square']['size_mm']:g} mm square, {elements} × {elements} "
        f"elements, {macroscale['steps']} steps to {macroscale['target_pressure_MPa']:g} MPa",
        "stiffness": f"E* = {modulus:.5g} MPa"
        + (f", as given; {standard:.5g} MPa from the elastic constants" if standard else ""),
        "patches": f"{len(patches)} of {config['scans']['size_mm']:g} mm, "
        f"{config['microscale']['steps']} steps each; {(patches.t1 != '').sum()} with a scan after "
        "use",
        "results in": config["results"],
    }
    if found is not None and found.stone is not None:
        size = " × ".join(f"{extent:.4g}" for extent in found.stone.extents)
        edge = found.stone.edges_unique_length.mean()
        lines["mesh"] = f"{size} mm along its x, y, z; mean edge length {edge:.3g} mm"
    if found is not None and len(found.scans):
        scans = found.scans
        lines["scans"] = (
            f"up to {scans.points_x.max()} × {scans.points_y.max()} points; Sq "
            f"{_range(scans.Sq_um)} µm; height range {_range(scans.range_um)} µm; "
            f"{_range(100 * scans.unmeasured)} % unmeasured"
        )
    return f"{config['title']}\n" + "\n".join(
        f"  {name:<11} {text}" for name, text in lines.items()
    )


def _range(values: Iterable[float]) -> str:
    low, high = (f"{value:.4g}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def check_study(path: Path) -> None:
    """Read config, patch table and every measured file of a study, and print what a run would do.

    If mesh and square can be read, ``check.png`` in the results folder shows them.

    Raises
    ------
    GstError
        Its message lists everything that is wrong.
    """
    logging.basicConfig(format="%(levelname)s: %(message)s")
    config = read_config(path)
    patches = read_study(config, str(path))
    problems: list[GstError] = []
    found, writable = None, False
    try:
        check_writable(config["results"])
        writable = True
    except GstError as error:
        problems.append(error)
    reach = None
    try:
        reach = reach_of(config)
    except GstError as error:  # of the table of poses
        problems.append(error)
    if config["inputs"] is not None:
        try:
            check_files(config, patches, f"{path}, {config['patches']}")
        except GstError as error:
            problems.append(error)
        second = counterface_mesh(config, "")
        if second is not None:
            is_whole = reach is not None and Path(second["mesh"]).is_file()
            second = second | {"reach_mm": reach} if is_whole else None
        mesh = Path(config["inputs"]["mesh"])
        folder, face = (
            config["inputs"]["scan_folder"],
            (config["counterface"] or {}).get("scan"),
        )
        scans = [scan for scan in scan_files(patches, folder, face) if scan.path.is_file()]
        placed = config["coupling"] == "placed"
        asked = Asked(
            mesh_unit=config["inputs"]["mesh_unit"],
            square=config["square"],
            macroscale=config["macroscale"],
            scan_settings=config["scans"],
            maximum_unmeasured=config["preprocessing"]["maximum_unmeasured"],
            placed=placed,
            reference=placed and config["reference_draws"] is not None,
            mat=config["mat"],
            second_stone=second,
        )
        found = check_inputs(mesh if mesh.is_file() else None, scans, asked)
        problems += found.problems
    print(f"{path}: {_summary(config, patches, found)}")
    if writable and found is not None and found.stone is not None and found.frame is not None:
        from gst.figures.style import save_figure
        from gst.figures.tool import check_figure

        picture = Path(config["results"]) / "check.png"
        figure = check_figure(
            found.stone,
            found.frame,
            found.square,
            patches,
            size_mm=config["square"]["size_mm"],
            patch_size_mm=config["scans"]["size_mm"],
        )
        save_figure(figure, picture)
        print(f"  {'picture':<11} {picture}: the square on the stone, and the patches in it")
    if problems:
        print(flush=True)
        raise InputsError(problems)
    print("\nNo problems found.")
