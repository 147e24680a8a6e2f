"""What is measured, from cases.yaml: codes, and the cases they are put to."""

from pathlib import Path
from typing import NamedTuple

import yaml
from problems import CUT_OFF, Surface

# Accuracy asked of every code: gap error over r.m.s. height, by our evaluator.
GOAL = 1e-9
_LISTED = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text("utf-8"))


class Code(NamedTuple):
    """One method of one code: `environment` has its interpreter, codes/run_*.py calls it."""

    label: str
    environment: str
    control: str = "load"
    variant: str = ""


class Case(NamedTuple):
    """One problem for several codes, by their labels."""

    name: str
    title: str
    surface: Surface
    pressure: float
    codes: list[str]
    steps: int = 1


class Grids(NamedTuple):
    """Grids of several sizes for one code, one surface a seed; shortest wave in elements."""

    code: str
    sizes: list[int]
    seeds: list[int]
    cut_off: int = CUT_OFF


class Growth(NamedTuple):
    """One problem on finer and finer grids."""

    name: str
    title: str
    pressure: float
    runs: list[Grids]


CODES = {label: Code(label, **code) for label, code in _LISTED["codes"].items()}
CASES = {
    name: Case(name, **case | {"surface": Surface(**case["surface"])})
    for name, case in _LISTED["cases"].items()
}
_RUNS = [Grids(**grids) for grids in _LISTED["growth"]["runs"]]
CASES["growth"] = Growth("growth", **_LISTED["growth"] | {"runs": _RUNS})
