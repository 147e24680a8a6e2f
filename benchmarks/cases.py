"""What is measured: codes, and the cases they are put to."""

from typing import NamedTuple

from problems import CUT_OFF, Surface

# Accuracy asked of every code: gap error over r.m.s. height, by our evaluator.
GOAL = 1e-9
STEPS = 20


class Code(NamedTuple):
    """One method of one code: `environment` has its interpreter, codes/run_*.py calls it."""

    label: str
    environment: str
    control: str = "load"
    variant: str = ""


CODES = {
    code.label: code
    for code in (
        Code("gstlib, load", "gstlib"),
        Code("gstlib, displacement", "gstlib", "displacement"),
        Code("aspher, FFT", "aspher", variant="fft"),
        Code("aspher, FFT mixed precision", "aspher", variant="mixed"),
        Code("aspher, H2", "aspher", variant="h2"),
        Code("aspher, FFT warm", "aspher", variant="warm"),
        Code("slippy, BCCG", "slippy", "displacement"),
        Code("slippy, Polonsky–Keer", "slippy"),
        Code("ContactMechanics, CCG", "contactmechanics", "displacement"),
        Code("ContactMechanics, Polonsky–Keer", "contactmechanics"),
        Code("Tamaas, Polonsky–Keer–Rey", "tamaas"),
    )
}


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
    sizes: tuple[int, ...]
    seeds: tuple[int, ...] = (0,)
    cut_off: int = CUT_OFF


class Growth(NamedTuple):
    """One problem on finer and finer grids."""

    name: str
    title: str
    pressure: float
    runs: tuple[Grids, ...]


_COLD = [label for label in CODES if label != "aspher, FFT warm"]
_PERIODIC = [label for label in _COLD if label != "aspher, H2"]
_PATH = ["gstlib, load", "aspher, FFT", "aspher, FFT mixed precision"]
_PATH += ["aspher, FFT warm", "slippy, BCCG"]
_ROUGH = Surface("rough", 512)
_WITHOUT_END = Surface("rough", 512, periodic=True)
_SIZES, _SEEDS = (256, 512, 1024, 2048, 4096), (0, 1, 2, 3, 4)


def _cases():
    ends = "cold, one thread"
    for load in (76.0, 22.0):
        title = f"Rough 512² at {load:g} MPa, {ends}"
        yield Case(f"rough-{load:g}", title, _ROUGH, load, _COLD)
    for size in (256, 512):
        title = f"Smooth sphere {size}², {ends}"
        yield Case(f"hertz-{size}", title, Surface("sphere", size), 76.0, _COLD)
    for load in (76.0, 22.0):
        title = f"{STEPS} equal steps of displacement to {load:g} MPa, rough 512², one thread"
        yield Case(f"path-{load:g}", title, _ROUGH, load, _PATH, STEPS)
    for load in (76.0, 2000.0):
        title = f"Rough 512² at {load:g} MPa, periodic, {ends}"
        yield Case(f"periodic-{load:g}", title, _WITHOUT_END, load, _PERIODIC)
    runs = (
        Grids("gstlib, load", _SIZES, _SEEDS),
        # with the waves of 2048²: is it the size, or the finer roughness?
        Grids("gstlib, load", _SIZES[-1:], _SEEDS, 2 * CUT_OFF),
        Grids("aspher, FFT", _SIZES),
        Grids("slippy, BCCG", _SIZES[:3]),
    )
    yield Growth("growth", f"Rough at 76 MPa, {ends}: finer grids", 76.0, runs)


CASES = {case.name: case for case in _cases()}
