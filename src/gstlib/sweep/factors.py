"""The settings of a sweep: for each factor some values, each a piece of config that differs.

One factor is changed at a time, the others stay as the study has them.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

__all__ = ["STUDY", "SWEPT", "Setting", "merged", "sweep_problems", "sweep_settings"]

STUDY = "study"  # name of the setting that changes nothing

# What the outcomes of a sweep answer to; None for every key of the section.
SWEPT: dict[str, tuple[str, ...] | None] = {
    "material": None,
    "macroscale": ("grid", "margin_mm", "target_pressure_MPa", "tolerance"),
    "preprocessing": None,
    "registration": None,
    "traces": None,
    "texture": None,
    "placement": ("shift_x_um", "shift_y_um"),
    "selection": None,
    "microscale": ("tolerance",),
    "validation": ("neighbourhood_um", "curvature_length_um"),
}


class Setting(NamedTuple):
    """One value of one factor.

    Attributes
    ----------
    name : str
        For file names; `STUDY` where nothing is changed.
    factor, value : str
        In words, for tables and figures; empty where nothing is changed.
    changes : mapping
        What differs from the study's config.
    """

    name: str
    factor: str
    value: str
    changes: Mapping


def sweep_settings(sweep: Mapping[str, Sequence[Mapping]]) -> list[Setting]:
    """Every setting of a sweep, the study's own first.

    Parameters
    ----------
    sweep : mapping
        The config's section: for each factor a list of pieces of config.

    Examples
    --------
    >>> [setting.name for setting in sweep_settings({"the grid": [{"macroscale": {"grid": 50}}]})]
    ['study', 'the_grid-1']
    """
    return [Setting(STUDY, "", "", {})] + [
        Setting(f"{factor.replace(' ', '_')}-{number}", factor, _in_words(changes), changes)
        for factor, values in sweep.items()
        for number, changes in enumerate(values, start=1)
    ]


def merged(config: Mapping, changes: Mapping) -> dict:
    """The config with some of its values replaced; neither of the two is altered."""
    return dict(config) | {
        key: merged(config[key], value)
        if isinstance(value, Mapping) and isinstance(config.get(key), Mapping)
        else value
        for key, value in changes.items()
    }


def sweep_problems(config: Mapping, explained: Callable[[Mapping], Iterable[str]]) -> list[str]:
    """All that is wrong with the sweep of a config, in sentences.

    Parameters
    ----------
    config : mapping
        The whole configuration, with the section ``sweep``.
    explained : callable
        What is wrong with a whole configuration.
    """
    problems = []
    for factor, values in config["sweep"].items():
        for number, changes in enumerate(values, start=1):
            found = list(_out_of_reach(changes))
            if not found:
                changed = merged(config, changes)
                found = [*explained(changed), *_without_effect(changes, changed)]
            problems += [f"'sweep.{factor}', value {number}: {text}" for text in found]
    return problems


def _out_of_reach(changes: Mapping) -> Iterator[str]:
    """Keys on which no outcome of a sweep depends."""
    for section, keys in changes.items():
        if section not in SWEPT or not isinstance(keys, Mapping):
            yield f"'{section}' is no section that can be swept (those are {', '.join(SWEPT)})"
            continue
        known = SWEPT[section]
        for key in keys:
            if known is not None and key not in known:
                yield f"nothing in a sweep depends on {section}.{key}, only on {', '.join(known)}"


def _without_effect(changes: Mapping, changed: Mapping) -> Iterator[str]:
    """Elastic constants that nothing is computed from."""
    constants = sorted(changes.get("material", {}).keys() - {"contact_modulus_MPa"})
    if constants and changed["material"]["contact_modulus_MPa"] is not None:
        yield (
            f"{', '.join(constants)} without effect while material.contact_modulus_MPa is given: "
            "set that to null"
        )


def _in_words(changes: Mapping) -> str:
    """The values that are set, each once."""
    values = [value for section in changes.values() for value in section.values()]
    return ", ".join(dict.fromkeys(map(_word, values)))


def _word(value: object) -> str:
    if value is None:
        return "unset"  # a table would read "null" as nothing at all
    return f"{value:g}" if isinstance(value, float) else f"{value}"
