"""The page on which the square is picked: one file, which works offline.

The page is `pick.html`, beside this file, with the stone and the scripts of `gst.viewer` in it.
It finds the frame of three points as `gstlib.surfaces.frames.frame_from_points` does.
"""

import html
import re
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import scipy

from gst.viewer import coarsen, shipped, stone_data, three_js, to_script

if TYPE_CHECKING:
    import trimesh

__all__ = ["pick_page"]


def pick_page(
    mesh: "trimesh.Trimesh",
    *,
    name: str,
    unit: str,
    size_mm: float,
    patches: pd.DataFrame | None = None,
    patch_size_mm: float = 0.85,
) -> str:
    """A page (HTML) to pick the square on a stone (mm).

    `name` and `unit` are of the mesh's file, for the config. The square has a side of `size_mm`, to
    begin with; `patches` (``patch, x_mm, y_mm, rotation_deg``) are drawn on it.
    """
    shown = coarsen(mesh)
    columns = {"patch": "name", "x_mm": "x", "y_mm": "y", "rotation_deg": "turn"}
    drawn = pd.DataFrame(patches, columns=[*columns]).rename(columns=columns)
    data = {
        "stone": stone_data(shown),
        "name": name,
        "unit": unit,
        "size": size_mm,
        "patches": drawn.to_dict("records"),
        "patch_size": patch_size_mm,
    }
    note = f"All {len(mesh.faces):,} triangles of the mesh are shown."
    if shown is not mesh:
        most, largest = _deviation(shown, mesh)
        note = (
            f"{len(shown.faces):,} of {len(mesh.faces):,} triangles are shown: what you click lies "
            f"within {most:.2g} mm of the mesh (95 %), {largest:.2g} mm at most."
        )
    page = shipped("pick.html")
    parts = {
        "NAME": html.escape(name),
        "SIZE": f"{size_mm:g}",
        "NOTE": note,
        "DATA": to_script(data),
        "VIEWER_JS": shipped("viewer.js"),
        "SQUARE_JS": shipped("square.js"),
        "THREE_JS": three_js(),
    }
    # all at once: what is put in may contain such marks itself
    return re.sub(r"@([A-Z_]+)@", lambda mark: parts[mark[1]], page)


def _deviation(shown: "trimesh.Trimesh", mesh: "trimesh.Trimesh") -> tuple[float, float]:
    """How far (mm) faces lie off a mesh: the 95th percentile, and the maximum."""
    middles = np.asarray(shown.triangles_center)
    _, nearest = scipy.spatial.KDTree(mesh.vertices).query(middles)
    off = ((middles - mesh.vertices[nearest]) * mesh.vertex_normals[nearest]).sum(axis=1)
    return float(np.percentile(np.abs(off), 95)), float(np.abs(off).max())
