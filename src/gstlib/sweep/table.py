"""The outcomes of all settings in one table, beside those of the study."""

from collections.abc import Mapping, Sequence

import pandas as pd

from gstlib.sweep.factors import STUDY, Setting
from gstlib.sweep.outcomes import PRESSURE, RELATIVE_CHANGE

__all__ = ["sweep_table"]


def sweep_table(settings: Sequence[Setting], outcomes: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """One row for each outcome of each setting.

    Parameters
    ----------
    settings : sequence of Setting
        The study's own among them.
    outcomes : mapping of str to DataFrame
        From `gstlib.sweep.outcomes.outcomes`, by the setting's name.

    Returns
    -------
    pandas.DataFrame
        ``factor, value, output, patch, result, change, low, high``; ``factor`` and ``value`` are
        empty for the study itself, ``change`` is the result less the study's. Each setting has a
        row more, the summed change of the patches' pressures, whatever its sign, over their sum.
    """
    keys = ["output", "patch"]
    study = outcomes[STUDY].set_index(keys).result
    tables = []
    for setting in settings:
        table = outcomes[setting.name].copy()
        table["change"] = table.result - study.reindex(table.set_index(keys).index).to_numpy()
        moved = table.change[table.output == PRESSURE].abs().sum()
        share = moved / study[PRESSURE].sum()
        summed = {"output": RELATIVE_CHANGE, "patch": "", "result": share, "change": share}
        table = pd.concat([table, pd.DataFrame([summed])], ignore_index=True)
        tables.append(table.assign(factor=setting.factor, value=setting.value))
    columns = ["factor", "value", *keys, "result", "change", "low", "high"]
    return pd.concat(tables, ignore_index=True)[columns]
