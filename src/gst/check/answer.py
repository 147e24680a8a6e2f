"""What a run would do, and the sizes, which show whether units were read as intended."""

from pathlib import Path

import numpy as np
import pandas as pd

from gst.check.inputs import Inputs
from gst.config.contradictions import counterface_mesh
from gst.run.chain import break_in
from gstlib.conditions import load_force, load_point, study_modulus
from gstlib.io.meshes import steps_of
from gstlib.macroscale.sampling_sites import CONTROL, COUNTS, EXPOSED
from gstlib.surfaces.footprints import square_of

__all__ = ["draw", "summary"]


def summary(
    config: dict, patches: pd.DataFrame, inputs: Inputs | None, poses: pd.DataFrame | None
) -> dict[str, str]:
    """The lines of the answer by their names."""
    material, size_mm = config["material"], config["square"]["size_mm"]
    is_stated = material["contact_modulus_MPa"] is not None
    force_N, steps = load_force(config["load"], size_mm), config["macroscale"]["steps"]
    lines = {
        "stone": config["inputs"]["mesh"] if config["inputs"] else "to be generated",
        "macroscale": _pressed(config),
        "load": f"{force_N:.4g} N, {force_N / size_mm**2:.4g} MPa on the square, in {steps} steps",
        "stiffness": f"E* = {study_modulus(material):.5g} MPa, "
        + ("as given" if is_stated else "from the elastic constants"),
        "patches": _patches(config, patches),
        "results in": f"{config['results']}: {_state(config)}",
    }
    if poses is not None:
        sliding_mm = poses.sliding_mm.sum()
        lines["gesture"] = f"{len(poses)} poses, which slide by {sliding_mm:.4g} mm in all"
    if layer := config["interlayer"]:
        thickness_um, young_MPa = layer["thickness_um"], layer["young_MPa"]
        lines["interlayer"] = (
            f"{thickness_um:g} µm of {young_MPa:g} MPa, in turns with the bare stone"
        )
    if inputs is not None and (stone := inputs.stone) is not None:
        size = " × ".join(f"{extent:.4g}" for extent in stone.extents)
        lines["mesh"] = (
            f"{size} mm along its x, y, z; mean edge length "
            f"{stone.edges_unique_length.mean():.3g} mm; coordinates in {steps_of(stone)}"
        )
    if inputs is not None and len(scans := inputs.scans):
        lines["scans"] = (
            f"up to {scans.points_x.max()} × {scans.points_y.max()} points; Sq "
            f"{_range(scans.Sq_um)} µm; height range {_range(scans.range_um)} µm; "
            f"{_range(100 * scans.unmeasured)} % unmeasured"
        )
    return lines


def _state(config: dict) -> str:
    """Whether the results are those of this config and of the measured files as they are."""
    results = Path(config["results"])
    if not results.is_dir():
        return "not there yet"
    return break_in(results, config) or "finished, with this config and these files"


def _patches(config: dict, patches: pd.DataFrame) -> str:
    """How many patches are solved; or, without any, what the study proposes."""
    size_mm, graded = config["scans"]["size_mm"], patches.wear_grade.dropna()
    if len(graded) and not (patches.t0 != "").any():
        return (
            f"{len(graded)} places of {size_mm:g} mm with grades of wear from {graded.min():g} to "
            f"{graded.max():g}, and no scans"
        )
    if config["patches"] is None:
        return (
            "none yet: the face alone is pressed in the poses of the gesture, and "
            f"{COUNTS[EXPOSED]} places of {size_mm:g} mm are proposed for scanning, with "
            f"{COUNTS[CONTROL]} controls that no pose touches"
        )
    worn, repeats = ((patches[column] != "").sum() for column in ("t1", "repeat"))
    twice = f", {repeats} scanned twice without use" if repeats else ""
    steps = config["microscale"]["steps"]
    return (
        f"{len(patches)} of {size_mm:g} mm, {steps} steps each; "
        f"{worn} with a scan after use{twice}"
    )


def _pressed(config: dict) -> str:
    """The square, the face around it, and the body that is pressed on them."""
    size_mm, macroscale = config["square"]["size_mm"], config["macroscale"]
    element_um = 1e3 * size_mm / macroscale["grid"]
    square = f"{size_mm:g} mm square, elements of {element_um:g} µm"
    if config["coupling"] == "levelled":
        return f"{square}, alone on its mean plane, under a flat"
    y, x = load_point(config["load"], size_mm)
    radii_mm = np.ravel((config["counterface"] or {}).get("radius_mm") or ())
    other = "a flat"
    if counterface_mesh(config, "") is not None:
        other = "an active tool"
    elif radii_mm.size:
        other = f"a stone of {' and '.join(f'{radius:g}' for radius in radii_mm)} mm radius"
    return (
        f"{square}, in a face of {macroscale['face_mm']:g} mm at rest under {other}; force "
        f"through x {x:g}, y {y:g} mm"
    )


def _range(values: pd.Series) -> str:
    low, high = (f"{value:.4g}" for value in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def draw(
    picture: Path,
    config: dict,
    patches: pd.DataFrame,
    inputs: Inputs,
    poses: pd.DataFrame | None,
) -> None:
    """Draw the square on the stone, the patches in it, and the two tools over the face."""
    from gst.page.figures.style import save_figure
    from gst.page.figures.tool import PressedFace, check_figure

    size_mm, face, pressed = config["square"]["size_mm"], inputs.face, None
    if face is not None and config["coupling"] != "levelled":
        through = np.array(load_point(config["load"], size_mm))
        moved = np.zeros((1, 2)) if poses is None else poses[["y_mm", "x_mm"]].to_numpy()
        interlayer_um = (config["interlayer"] or {}).get("thickness_um")
        pressed = PressedFace(face, through + moved, interlayer_um)
    figure = check_figure(
        inputs.stone,
        inputs.frame,
        face and square_of(face.height, size_mm),
        patches,
        size_mm=size_mm,
        patch_size_mm=config["scans"]["size_mm"],
        pressed=pressed,
    )
    save_figure(figure, picture)
