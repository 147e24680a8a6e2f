"""Figures of a study for comparison with published figures."""

import pandas as pd

__all__ = ["figures_to_compare"]


def figures_to_compare(
    macroscale: pd.DataFrame, pressures: pd.DataFrame
) -> dict[tuple[str, str], float]:
    """Figures of a study that a paper publishes, by quantity and patch.

    `macroscale` and `pressures` are from `gstlib.macroscale.equilibrium.macroscale_table` and
    `gstlib.coupling.pressures.couple_scales`. The patch is empty except for patch pressures.
    """
    final = macroscale.iloc[-1]
    figures = {
        ("displacement", ""): float(final.displacement_um),
        ("mean pressure", ""): float(final.mean_pressure_MPa),
        ("contact fraction", ""): float(final.contact_fraction),
    }
    for row in pressures.itertuples():
        figures["patch pressure", str(row.patch)] = float(row.pressure_MPa)
    return figures
