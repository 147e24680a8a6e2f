"""From the scan of a mould to the surface that it was taken of.

A mould is a negative: heights change sign, and looking at it from its own side mirrors the map.
"""

import xarray as xr

__all__ = ["unmould"]

# ASSUME: once a mould is undone, rows of a scan run along the square's +y and columns along its +x,
# up to the patch's rotation; the paper says which axis is flipped, not how the instrument lies.


def unmould(
    surface: xr.DataArray, *, invert: bool = True, flip_axis: str | None = "x"
) -> xr.DataArray:
    """The stone's surface from its mould's: the same operation also moulds a surface.

    Parameters
    ----------
    surface : (ny, nx) xarray.DataArray
        Heights of the mould, mm.
    invert : bool
        Change the sign of the heights.
    flip_axis : {"x", "y", None}
        Axis along which the map is mirrored; the paper's is x.

    Returns
    -------
    (ny, nx) xarray.DataArray
        On the same grid, with the coordinates of `surface`.
    """
    if flip_axis not in ("x", "y", None):
        raise ValueError(f"flip_axis is 'x', 'y' or None, not {flip_axis!r}")
    heights = surface.values
    if flip_axis is not None:
        heights = heights[:, ::-1] if flip_axis == "x" else heights[::-1]
    return surface.copy(data=-heights if invert else heights.copy())
