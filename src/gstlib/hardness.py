"""A patch whose pressure has a ceiling, beside the elastic one: a sensitivity case.

An elastic solution puts pressures on the summits of a stone that far exceed what any stone bears.
The same contact with p ≤ H, at the same mean pressure, says how much of the prediction rests on
them.
"""

from pathlib import Path

import numpy as np
import xarray as xr

from gstlib.contact import pressed_height, solve_at_pressure

__all__ = ["hardness_dataset", "hardness_summary"]

# ASSUME: one hardness for every element. The default study's 2 GPa is an order of magnitude: quartz
# indents at 11 to 12 GPa, quartzite as a whole is crushed at a few hundred MPa, and the strength of
# an element the size of a scan's point lies between. The paper has none.


def hardness_dataset(
    contact: xr.Dataset, *, source: str | Path, hardness_MPa: float, workers: int = 1
) -> xr.Dataset:
    """A solved contact solved again with a ceiling on its pressure, at the same mean pressure.

    Parameters
    ----------
    contact : xarray.Dataset
        From `gstlib.contact.contact_dataset`, the final state only, with the settings it was
        solved with as attributes; they hold here too.
    source : path
        The file that it comes from, for error messages.
    hardness_MPa : float
        Largest pressure that an element bears.
    workers : int
        Threads of the solver.

    Returns
    -------
    xarray.Dataset
        ``pressure`` (y, x) MPa; ``gap`` (y, x) mm, where the pressure is at the ceiling minus the
        depth of the yield; ``displacement`` mm, ``mean_pressure`` MPa, ``contact_fraction``,
        ``ceiling_share`` (of the contact) and ``residual``.

    Raises
    ------
    InputError
        The solver gives up.
    """
    height = pressed_height(contact)
    state, pressure = solve_at_pressure(
        height,
        source=source,
        contact_modulus_MPa=contact.attrs["contact_modulus_MPa"],
        target_pressure_MPa=contact.attrs["target_pressure_MPa"],
        tolerance=contact.attrs["tolerance"],
        pressure_limit_MPa=hardness_MPa,
        workers=workers,
    )

    def number(value, units, long_name):
        return (), value, {"units": units, "long_name": long_name}

    return xr.Dataset(
        {
            "pressure": pressure.assign_attrs(
                units="MPa", long_name="contact pressure under the ceiling"
            ),
            "gap": (
                ("y", "x"),
                state.gap,
                {"units": "mm", "long_name": "gap between the bodies; minus the depth of yield"},
            ),
            "displacement": number(
                state.displacement, "mm", "far-field displacement from first touch"
            ),
            "mean_pressure": number(state.mean_pressure, "MPa", "mean pressure"),
            "contact_fraction": number(
                state.contact_fraction, "1", "real over nominal contact area"
            ),
            "ceiling_share": number(
                state.ceiling_share, "1", "share of the contact at the ceiling"
            ),
            "residual": number(state.residual, "1", "largest violation of contact conditions"),
        },
        attrs={"hardness_MPa": hardness_MPa},
    )


def hardness_summary(contact: xr.Dataset, limited: xr.Dataset) -> dict[str, float]:
    """One patch's row of `hardness.csv`, from its elastic contact and `hardness_dataset`."""
    hardness = float(limited.attrs["hardness_MPa"])
    elastic, plastic = contact.pressure.values > 0, limited.pressure.values > 0
    both = np.count_nonzero(elastic & plastic)
    at_ceiling = limited.pressure.values >= hardness
    return {
        "pressure_MPa": float(limited.mean_pressure),
        "hardness_MPa": hardness,
        "elastic_peak_pressure_MPa": float(contact.pressure.max()),
        "elastic_contact_fraction": float(elastic.mean()),
        "contact_fraction": float(plastic.mean()),
        "ceiling_share": float(limited.ceiling_share),
        "elastic_displacement_um": float(contact.displacement[-1]) * 1e3,
        "displacement_um": float(limited.displacement) * 1e3,
        "dice": 2 * both / (np.count_nonzero(elastic) + np.count_nonzero(plastic)),
        "iou": both / np.count_nonzero(elastic | plastic),
        "deepest_yield_um": float(np.max(-limited.gap.values[at_ceiling], initial=0.0)) * 1e3,
    }
