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
    of_patches = pressures.set_index("patch").pressure_MPa
    figures = {
        ("displacement", ""): final.displacement_um,
        ("mean pressure", ""): final.mean_pressure_MPa,
        ("contact fraction", ""): final.contact_fraction,
        **{("patch pressure", str(name)): value for name, value in of_patches.items()},
    }
    return {name: float(value) for name, value in figures.items()}
