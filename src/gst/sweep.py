"""One-at-a-time sensitivity: how do the results of a study change with one value of its config?

A sweep names factors. Each factor has values: pieces of config that replace the study's own. For
each value the study runs in memory (`gstlib.study.Study`).
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import pandas as pd

from gstlib.io.results import columns_of

if TYPE_CHECKING:
    from gstlib.study import Study

__all__ = ["STUDY", "merged", "outcomes", "sweep_problems", "sweep_settings", "sweep_table"]

STUDY = "study"  # name of the setting that changes nothing

_PRESSURE, _CHANGE = "pressure_MPa", "relative_change(pressure_MPa)"
# Rows of ``validation_summary.csv``.
_OF_PREDICTION = ["mean(mcc)", "gain(mcc)", "relative(map_error)"]
_OF_PREDICTION += ["spearman(pressure_MPa, loss_fraction)"]


class Setting(NamedTuple):
    """One value of one factor.

    Attributes
    ----------
    name : str
        For file names; `STUDY` if nothing is changed.
    factor, value : str
        In words, for tables and figures; empty if nothing is changed.
    changes : mapping
        What differs from the study's config.
    """

    name: str
    factor: str
    value: str
    changes: Mapping


def sweep_settings(sweep: Mapping[str, Sequence[Mapping]]) -> list[Setting]:
    """Every setting of a sweep, the study's own first.

    `sweep` is the config's section: for each factor a list of pieces of config.
    """
    settings = [Setting(STUDY, "", "", {})]
    for factor, values in sweep.items():
        for number, changes in enumerate(values, start=1):
            name = f"{factor.replace(' ', '_')}-{number}"
            settings.append(Setting(name, factor, _in_words(changes), changes))
    return settings


def _in_words(changes: Mapping) -> str:
    """The new values, each once."""
    words = []
    for part in changes.values():
        for value in part.values() if isinstance(part, Mapping) else [part]:
            if value is None:
                words.append("unset")  # a table would read "null" as a missing value
            else:
                words.append(f"{value:g}" if isinstance(value, float) else f"{value}")
    return ", ".join(dict.fromkeys(words))


def merged(config: Mapping, changes: Mapping) -> dict:
    """The config with some of its values replaced; neither of the two is altered."""
    result = dict(config)
    for key, value in changes.items():
        is_section = isinstance(value, Mapping) and isinstance(config.get(key), Mapping)
        result[key] = merged(config[key], value) if is_section else value
    return result


def sweep_problems(
    config: Mapping, problems_of: Callable[[Mapping], Iterable[str]]
) -> list[str]:
    """All problems with the sweep of a complete config, in sentences.

    `problems_of` gives the problems of a complete config, regardless of its sweep.
    """
    problems = []
    for factor, values in (config["sweep"] or {}).items():
        for number, changes in enumerate(values, start=1):
            for problem in problems_of(merged(config, changes)):
                problems.append(f"'sweep.{factor}', value {number}: {problem}")
    return problems


def outcomes(study: "Study") -> pd.DataFrame:
    """The outcomes of a study: patch pressures, how right its prediction is, change of texture.

    Returns
    -------
    pandas.DataFrame
        ``output, patch, result, low, high``: the pressure of every patch; ``studied``, the number
        of patches in the study; of the predicted loss the mean MCC, its gain over the best rival
        and the error of its maps over that of no loss; the rank correlation of pressure with loss;
        the mean change of Sq from T0 to T1, µm. 95 % intervals where there are any.
    """
    from gstlib.validation.scoring import own_model
    from gstlib.validation.texture import measure_texture

    selected = study.selected()
    none = math.nan, math.nan
    rows = [(_PRESSURE, row.patch, row.pressure_MPa, *none) for row in selected.itertuples()]
    rows.append(("studied", "", int(selected.in_study.sum()), *none))
    if study.worn:
        resamples = study.config["validation"]["resamples"]
        summary = study.judged(seed=study.config["seed"], resamples=resamples)["summary"]
        own = summary[summary.model.isin(["", own_model(list(summary.model))])]
        for row in own[own.statistic.isin(_OF_PREDICTION)].itertuples():
            rows.append((row.statistic, "", row.value, row.low, row.high))
    texture = measure_texture(
        {patch: study.prepared(patch, "T0") for patch in study.worn},
        {patch: study.change(patch) for patch in study.worn},
        **study.config["texture"],
    )
    if len(texture):
        change = texture.Sq_um[texture.epoch == "change"].mean()
        rows.append(("mean_change(Sq_um)", "", change, *none))
    columns = ["output", "patch", "result", "low", "high"]
    return pd.DataFrame(rows, columns=columns).dropna(subset="result", ignore_index=True)


def sweep_table(settings: Sequence[Setting], found: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """One row for each outcome of each setting.

    `found` has the `outcomes` of each setting by name, including the study's own. The result has
    ``factor, value, output, patch, result, change, low, high``; ``factor`` and ``value`` are empty
    for the study itself, ``change`` is the result less the study's. Each setting has one more row:
    the sum of the absolute changes of the patches' pressures over their sum.
    """
    keys = ["output", "patch"]
    study = found[STUDY].set_index(keys).result
    tables = []
    for setting in settings:
        table = found[setting.name].copy()
        table["change"] = table.result - study.reindex(table.set_index(keys).index).to_numpy()
        share = table.change[table.output == _PRESSURE].abs().sum() / study[_PRESSURE].sum()
        summed = {"output": [_CHANGE], "patch": "", "result": share, "change": share}
        table = pd.concat([table, pd.DataFrame(summed)])
        tables.append(table.assign(factor=setting.factor, value=setting.value))
    return pd.concat(tables, ignore_index=True)[columns_of("sweep")]
