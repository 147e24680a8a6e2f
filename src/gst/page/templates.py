"""Texts and pages from the Jinja templates beside this module, and how they write numbers."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

LEVEL = 0.05  # of a test, the usual one


def render(template: str, **content: Any) -> str:
    """A template, filled in. A page (``.html``) escapes what it takes in."""
    is_page = template.endswith(".html")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        autoescape=is_page,
        trim_blocks=is_page,
        lstrip_blocks=is_page,
        keep_trailing_newline=True,
    )
    filters = number, score, fixed, two, times, least, extent, p, sign, listed
    environment.filters |= {each.__name__: each for each in filters}
    environment.policies["json.dumps_kwargs"] = {"ensure_ascii": False}  # unsorted
    environment.tests["known"] = pd.notna
    return environment.get_template(template).render(content)


def one_line(text: str) -> str:
    """Text without line breaks, and without spaces beside a mark that takes none."""
    return re.sub(r" (?=[,;:.)])|(?<=\() ", "", " ".join(text.split()))


def paragraphs(text: str) -> list[str]:
    """The paragraphs of a text, each on one line; a ¶ begins one."""
    return list(filter(None, map(one_line, text.split("¶"))))


def number(value: Any, digits: int = 3) -> str:
    """A number for a reader; a dash if there is none."""
    if pd.isna(value):
        return "–"
    rounded = float(f"{value:.{digits}g}")
    return fixed(rounded, "z,.12g").replace(",", "\u202f")


def score(value: Any) -> str:
    """A score, or the difference of two; a dash if there is none."""
    return "–" if pd.isna(value) else fixed(value, "z.2f")


def fixed(value: float, form: str) -> str:
    """A number in a form of Python's, with a true minus."""
    return format(value, form).replace("-", "−")


def two(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def times(ratio: float) -> str:
    """A ratio with two digits, or with a third if it were 1."""
    return f"{ratio:.3g}" if two(ratio) == "1" else two(ratio)


def least(value: float, limit: float, unit: str) -> str:
    return f"{two(value)} {unit}" if value >= limit else f"less than {limit:g} {unit}"


def extent(values: pd.Series, limit: float, unit: str) -> str:
    """The least and the largest of some values, or the one that they share."""
    ends = least(values.min(), limit, unit), least(values.max(), limit, unit)
    return " to ".join(dict.fromkeys(ends))


def p(value: float) -> str:
    """A p-value."""
    if not math.isfinite(value):
        return "not tested"
    if not 0.001 <= value <= 0.99:
        return "p < 0.001" if value < 0.5 else "p > 0.99"
    return f"p = {value:.2g}"


def sign(row: Mapping[str, float], no_difference: float = 0.0) -> int:
    """Whether a value is shown to be above (1) or below (-1) no difference; otherwise 0.

    The difference must show in both the interval and the test.
    """
    shows = int(row["low"] > no_difference) - int(row["high"] < no_difference)
    return shows * int(row["p_value"] <= LEVEL)


def listed(names: Sequence[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last
