"""Stick and slip on a patch that is ground: `gstlib.bem.slip` for this study.

A tangential force is added to the contact that the study has solved, as a share of the force that
would make the whole contact slide. The contact that sticks and the contact that slips are told
apart; the normal contact stays as it is.
"""

from pathlib import Path

import xarray as xr

from gstlib.bem.slip import solve_slip
from gstlib.contact import explained, final_state, pressed_height
from gstlib.surface import spacing_of

__all__ = ["slip_dataset", "slip_summary"]

# ASSUME: the grinding force grows at constant normal force and along one direction, from rest, so
# that stick and slip are those before the stones slide as a whole; the paper has no friction.


def slip_dataset(
    contact: xr.Dataset,
    *,
    source: str | Path,
    friction: float,
    tangential_ratio: float,
    poisson: float,
    workers: int = 1,
) -> xr.Dataset:
    """Stick and slip of a solved contact under a tangential load.

    Parameters
    ----------
    contact : xarray.Dataset
        From `gstlib.contact.contact_dataset`, the final state only, with the settings it was
        solved with as attributes; they hold here too.
    source : path
        The file that it comes from, for error messages.
    friction, tangential_ratio, poisson
        See `gstlib.bem.slip.solve_slip`, and `gstlib.config.study_poisson`.
    workers : int
        Threads of the solver.

    Returns
    -------
    xarray.Dataset
        ``traction`` (y, x) MPa, along the load; ``stick``, ``slip`` (y, x) bool, which together
        are the contact; ``mean_pressure``, ``mean_traction`` MPa; ``tangential_displacement`` mm.

    Raises
    ------
    InputError
        The solver gives up.
    """
    height = pressed_height(contact)
    normal = final_state(contact, source=source, workers=workers)
    with explained(source, contact.attrs["target_pressure_MPa"]):
        found = solve_slip(
            height.values,
            spacing_of(height),
            contact.attrs["contact_modulus_MPa"],
            normal=normal,
            friction=friction,
            tangential_ratio=tangential_ratio,
            poisson=poisson,
            tolerance=contact.attrs["tolerance"],
            workers=workers,
        )
    on_grid = ("y", "x")
    return xr.Dataset(
        {
            "traction": (
                on_grid,
                found.traction,
                {"units": "MPa", "long_name": "tangential traction along the load"},
            ),
            "stick": (on_grid, found.stick, {"units": "1", "long_name": "in contact, sticking"}),
            "slip": (on_grid, found.slip, {"units": "1", "long_name": "in contact, slipping"}),
            "mean_pressure": (
                (),
                normal.mean_pressure,
                {"units": "MPa", "long_name": "normal force over nominal area"},
            ),
            "mean_traction": (
                (),
                found.mean_traction,
                {"units": "MPa", "long_name": "tangential force over nominal area"},
            ),
            "tangential_displacement": (
                (),
                found.tangential_displacement,
                {"units": "mm", "long_name": "relative tangential displacement of the far fields"},
            ),
        },
        coords={"y": height.y, "x": height.x},
        attrs={"friction": friction, "tangential_ratio": tangential_ratio, "poisson": poisson},
    )


def slip_summary(slip: xr.Dataset) -> dict[str, float]:
    """One patch's row of `slip.csv`, from `slip_dataset`."""
    sticking, slipping = int(slip.stick.sum()), int(slip.slip.sum())
    return {
        "pressure_MPa": float(slip.mean_pressure),
        "friction": float(slip.attrs["friction"]),
        "tangential_ratio": float(slip.attrs["tangential_ratio"]),
        "mean_traction_MPa": float(slip.mean_traction),
        "stick_share": sticking / (sticking + slipping),
        "slip_share": slipping / (sticking + slipping),
        "slip_area_fraction": slipping / slip.slip.size,
        "tangential_displacement_um": float(slip.tangential_displacement) * 1e3,
    }
