"""The page on which the square is picked: one file, which works offline.

The page is `pick.html`, beside this file, with the stone and the scripts of `gst.viewer` in it.
It finds the frame of three points as `gstlib.surfaces.frames.frame_from_points` does.
"""

import html
import importlib.resources
import re
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import scipy

from gst.viewer import coarsen, stone_data, three_js, to_script, viewer_js

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
    """A page (HTML) to pick the square on a stone.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone, mm.
    name, unit : str
        The mesh's file and its unit, for the config.
    size_mm : float
        Side of the square, to begin with.
    patches : pandas.DataFrame, optional
        ``patch, x_mm, y_mm, rotation_deg``: drawn on the square.
    patch_size_mm : float
        Side of a patch.

    Raises
    ------
    InputError
        three.js is not found.
    """
    shown = coarsen(mesh)
    rows = (
        [] if patches is None else patches[["patch", "x_mm", "y_mm", "rotation_deg"]].to_numpy()
    )
    data = {
        "stone": stone_data(shown),
        "name": name,
        "unit": unit,
        "size": size_mm,
        "patches": [dict(zip(("name", "x", "y", "turn"), row, strict=True)) for row in rows],
        "patch_size": patch_size_mm,
    }
    note = f"All {len(mesh.faces):,} triangles of the mesh are shown."
    if shown is not mesh:
        most, largest = _deviation(shown, mesh)
        note = (
            f"{len(shown.faces):,} of {len(mesh.faces):,} triangles are shown: what you click lies "
            f"within {most:.2g} mm of the mesh (95 %), {largest:.2g} mm at most."
        )
    page = (importlib.resources.files("gst") / "pick.html").read_text(encoding="utf-8")
    parts = {
        "NAME": html.escape(name),
        "SIZE": f"{size_mm:g}",
        "NOTE": note,
        "DATA": to_script(data),
        "VIEWER_JS": viewer_js(),
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
