"""The tool with numbers and colours at its vertices, for programs that show meshes.

A PLY keeps numbers and the unit of the mesh. A GLB is shown nearly everywhere, but has colours
only, so a picture of their scale goes with it.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import PowerNorm, to_rgba_array
from matplotlib.figure import Figure

from gst.page.figures.maps import FORCE_MAP, LOSS_MAP
from gst.page.figures.style import STONE, WIDTH, styled
from gst.page.figures.tool import cut_tool
from gstlib.io.meshes import UNITS, read_mesh
from gstlib.io.store import read_dataset
from gstlib.surfaces.frames import FRAME, on_mesh, stored_frame
from gstlib.surfaces.grid import spacing_of

if TYPE_CHECKING:
    import trimesh

# Of each number that is shown in colours: the colours, the power of their scale and its name.
_SCALES = {
    "pressure_MPa": (FORCE_MAP, 0.5, "pressure (MPa)"),
    "exposure_N_per_mm": (FORCE_MAP, 0.5, "exposure (N/mm)"),
    "loss_um": (LOSS_MAP.reversed(), 1.0, "measured loss (µm)"),
}


class Tool(NamedTuple):
    """A mesh (mm), with the unit of its file; numbers and sRGB colours at its vertices, by name."""

    mesh: "trimesh.Trimesh"
    unit: str
    numbers: dict[str, Any]  # (n,)
    colours: Mapping[str, np.ndarray]  # (n, 4), uint8

    def ply(self) -> bytes:
        """All numbers, and the colours of the first, in the unit of the mesh."""
        import trimesh

        whole: Any = trimesh.Trimesh(
            self.mesh.vertices / UNITS[self.unit],
            self.mesh.faces,
            process=False,
            vertex_attributes=self.numbers,
            vertex_colors=next(iter(self.colours.values())),
        )
        return whole.export(file_type="ply", vertex_normal=False)

    def glb(self, name: str) -> bytes:
        """The colours of one number, in m; colours of a GLB are linear, and not those of sRGB."""
        import trimesh
        from trimesh.visual.color import srgb_to_linear

        colours = self.colours[name] / 255
        colours[:, :3] = srgb_to_linear(colours[:, :3])
        # without a material, viewers take the stone for metal
        material = trimesh.visual.material.PBRMaterial(
            metallicFactor=0.0, roughnessFactor=1.0
        )
        visual = trimesh.visual.TextureVisuals(material=material)
        visual.vertex_attributes["color"] = np.round(255 * colours).astype(np.uint8)
        whole: Any = trimesh.Trimesh(
            self.mesh.vertices / 1e3, self.mesh.faces, visual=visual, process=False
        )
        return whole.export(file_type="glb", include_normals=True)


def tool_with(
    fields: Mapping[str, xr.DataArray], mesh: Path, mesh_unit: str, face: Path
) -> Tool:
    """A mesh cut as fine as the fields (y, x) of its use-face, in its own coordinates.

    `face` is the file with the frame of its square. Beyond the face, and where a field is NaN, its
    number is 0 and its colour that of stone.
    """
    stone = read_mesh(mesh, unit=mesh_unit)
    frame = stored_frame(read_dataset(face, only=FRAME))
    first = next(iter(fields.values()))
    edge_mm = 1.5 * max(spacing_of(first))
    cut = cut_tool(stone, frame, first, edge_mm=edge_mm, faces=len(stone.faces))
    numbers, colours = {}, {}
    for name, field in fields.items():
        values = on_mesh(field, cut, frame).astype(np.float32)
        numbers[f"scalar_{name}"] = values  # the prefix is CloudCompare's
        if name in _SCALES:
            colours[name] = _scale(name, field).to_rgba(values, bytes=True)
            is_known = on_mesh(field.notnull(), cut, frame) > 0
            colours[name][~is_known] = np.round(to_rgba_array(STONE) * 255)
    return Tool(cut, mesh_unit, numbers, colours)


def _scale(name: str, field: xr.DataArray) -> ScalarMappable:
    """From 0 to the largest number of a field."""
    cmap, power, _ = _SCALES[name]
    return ScalarMappable(PowerNorm(power, 0, float(field.max()) or 1.0), cmap)


@styled
def colour_bar(name: str, field: xr.DataArray, note: str) -> bytes:
    """The scale of a field's colours, as PNG, with a note behind its name."""
    figure = Figure((WIDTH, 0.6), layout="constrained")
    look = {"orientation": "horizontal", "label": _SCALES[name][2] + note}
    figure.colorbar(_scale(name, field), cax=figure.add_subplot(), **look)
    content = io.BytesIO()
    figure.savefig(content, format="png", metadata={"Software": None})
    return content.getvalue()
