"""A picture of one pressed scan: where it touches, and how contact grows with the load."""

import xarray as xr
from matplotlib.figure import Figure

from gst.figures.maps import HEIGHTS, draw_map
from gst.figures.style import BLUE, VERMILION, panels, styled
from gstlib.bem import LoadPath

__all__ = ["pressed_figure"]


@styled
def pressed_figure(height: xr.DataArray, contact: LoadPath, name: str) -> Figure:
    """The heights with the contact over them, and area and displacement along the path."""
    figure, (left, area, depth) = panels(3, 2, 1.0, (0.55, 0.25, 0.3, 0.85))
    final, table = contact.final, contact.table()
    draw_map(left, height, marks={VERMILION: final.contact.values}, ticks=True, **HEIGHTS)
    left.set_title(
        f"{name}: contact {final.contact_fraction:.2%} at {final.mean_pressure:.4g} MPa"
    )
    area.plot(table.mean_pressure_MPa, 100 * table.contact_fraction, ".-", color=BLUE)
    area.set(ylabel="real contact area A / Aₙ (%)", title="Area in contact")
    depth.plot(table.mean_pressure_MPa, table.displacement_um, ".-", color=BLUE)
    depth.set(ylabel="far-field displacement (µm)", title="Displacement")
    for axes in (area, depth):
        axes.set(xlabel="mean pressure (MPa)", xlim=(0, None), ylim=(0, None))
    return figure
