"""From a scan as measured to a surface ready for contact, the same way for both epochs."""

import numpy as np
import xarray as xr

from gstlib.preprocess.filling import fill_unmeasured
from gstlib.preprocess.leveling import remove_plane
from gstlib.preprocess.mould import unmould
from gstlib.preprocess.outliers import replace_outliers

__all__ = ["prepare_scan"]

_MM_TO_UM = 1e3


def prepare_scan(
    raw: xr.DataArray,
    *,
    mould_invert: bool,
    mould_flip: str | None,
    maximum_unmeasured: float,
    outlier_half_width: int,
    outlier_share: float,
) -> xr.Dataset:
    """Un-mould, fill, replace outliers and level a scan, in this order.

    Parameters
    ----------
    raw : (ny, nx) xarray.DataArray
        Heights as measured, mm, NaN where unmeasured.
    mould_invert, mould_flip
        As `invert` and `flip_axis` of `unmould`.
    maximum_unmeasured : float
        Largest share (0 to 1) of unmeasured points accepted.
    outlier_half_width, outlier_share
        As in `replace_outliers`.

    Returns
    -------
    xarray.Dataset
        ``height`` (y, x) mm, level, without NaN; ``filled`` and ``outlier`` (y, x) bool.
        Attributes: ``unmeasured``, ``filled``, ``outliers`` (counts), ``outlier_k``,
        ``outlier_share`` (of points replaced), ``tilt_x_mrad``, ``tilt_y_mrad`` (of the plane
        removed), ``Sq_before_um`` (r.m.s. of the measured heights about their mean) and
        ``Sq_after_um`` (of the prepared ones), and the raw scan's own texts.

    Raises
    ------
    InputError
        Too many points are unmeasured.
    """
    unmeasured = int(np.count_nonzero(~np.isfinite(raw.values)))
    stone = unmould(raw, invert=mould_invert, flip_axis=mould_flip)
    whole, filled = fill_unmeasured(stone, maximum_share=maximum_unmeasured)
    clean, outlier, k = replace_outliers(whole, half_width=outlier_half_width, share=outlier_share)
    level, plane = remove_plane(clean)
    level.attrs = {"units": "mm", "long_name": "height of the stone, level"}
    filled.attrs = {"units": "1", "long_name": "unmeasured, filled from around it"}
    outlier.attrs = {"units": "1", "long_name": "outlier, replaced from around it"}
    texts = {name: value for name, value in raw.attrs.items() if name not in ("units", "long_name")}
    return xr.Dataset(
        {"height": level, "filled": filled, "outlier": outlier},
        attrs={
            **texts,
            "unmeasured": unmeasured,
            "filled": int(filled.sum()),
            "outliers": int(outlier.sum()),
            "outlier_k": k,
            "outlier_share": float(outlier.mean()),
            "tilt_x_mrad": plane.tilt_x_mrad,
            "tilt_y_mrad": plane.tilt_y_mrad,
            "Sq_before_um": _MM_TO_UM * float(np.nanstd(raw.values)),
            "Sq_after_um": _MM_TO_UM * float(np.std(level.values)),
        },
    )
