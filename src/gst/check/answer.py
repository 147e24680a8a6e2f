"""The answer of `gst check`: a summary of the run, with sizes, and a picture of the square.

The sizes show whether units were read as intended. The sentences stand in `answer.txt`.
"""

from pathlib import Path

import jinja2
import numpy as np
import pandas as pd

from gst.check.inputs import Inputs
from gst.config.contradictions import counterface_mesh, files_read
from gst.run.chain import break_in, other_files
from gstlib.conditions import load_force, resolved_load_point, study_modulus
from gstlib.io.meshes import steps_of
from gstlib.macroscale.sampling_sites import CONTROL, COUNTS, EXPOSED
from gstlib.surfaces.footprints import square_of


def summary(
    config: dict,
    patches: pd.DataFrame,
    inputs: Inputs | None,
    poses: pd.DataFrame | None,
) -> str:
    """The lines on a study and its files."""
    results, state = Path(config["results"]), "not there yet"
    if results.is_dir():
        state = (
            break_in(results, config)
            or other_files(results, files_read(config, patches))
            or "finished, with this config and these files"
        )
    size_mm, stone = config["square"]["size_mm"], inputs and inputs.stone
    template = Path(__file__).with_suffix(".txt").read_text("utf-8")
    environment = jinja2.Environment(
        trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    return environment.from_string(template).render(
        config=config,
        patches=patches,
        poses=poses,
        stone=stone,
        scans=inputs and inputs.scans,
        size_mm=size_mm,
        tool=counterface_mesh(config, ""),
        radii_mm=np.ravel((config["counterface"] or {}).get("radius_mm") or ()),
        at_mm=resolved_load_point(config["load"], size_mm),
        force_N=load_force(config["load"], size_mm),
        modulus_MPa=study_modulus(config["material"]),
        exposed=COUNTS[EXPOSED],
        control=COUNTS[CONTROL],
        state=state,
        steps=stone and steps_of(stone),
    )


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
    if face is not None and config["coupling"] != "paper":
        load_point = np.array(resolved_load_point(config["load"], size_mm))
        moved = np.zeros((1, 2))
        if poses is not None:
            moved = poses[["y_mm", "x_mm"]].to_numpy()
        interlayer_um = (config["interlayer"] or {}).get("thickness_um")
        pressed = PressedFace(face, load_point + moved, interlayer_um)
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
