"""What is measured: codes, and the cases they are put to."""

from dataclasses import dataclass
from typing import NamedTuple

from problems import CUT_OFF, Surface

# Accuracy asked of every code: gap error over r.m.s. height, by our evaluator.
GOAL = 1e-9
STEPS = 20


@dataclass(frozen=True)
class Code:
    """One method of one code.

    `start` is the first tolerance tried in the calibration, in the code's own sense.
    """

    label: str
    environment: str
    script: str
    variant: str
    control: str
    start: float


_GSTLIB = ("gstlib", "gstlib_bem", "")
_ASPHER = ("aspher", "aspher_nested")
_CONTACT_MECHANICS = ("contactmechanics", "contactmechanics_solvers", "")

CODES = {
    code.label: code
    for code in (
        Code("gstlib, load", *_GSTLIB, "load", 1e-9),
        Code("gstlib, displacement", *_GSTLIB, "displacement", 1e-9),
        Code("aspher, FFT", *_ASPHER, "fft", "load", 3.16e-10),
        Code("aspher, FFT mixed precision", *_ASPHER, "mixed", "load", 3.16e-10),
        Code("aspher, H2", *_ASPHER, "h2", "load", 1e-9),
        Code("aspher, FFT warm", *_ASPHER, "warm", "load", 3.16e-10),
        Code(
            "aspher native, FFT",
            "aspher-native",
            "aspher_nested",
            "fft",
            "load",
            3.16e-10,
        ),
        Code(
            "aspher native, FFT mixed precision",
            "aspher-native",
            "aspher_nested",
            "mixed",
            "load",
            3.16e-10,
        ),
        Code(
            "aspher native, FFT warm",
            "aspher-native",
            "aspher_nested",
            "warm",
            "load",
            3.16e-10,
        ),
        Code("slippy, BCCG", "slippy", "slippy_solvers", "", "displacement", 1e-9),
        Code("slippy, Polonsky–Keer", "slippy", "slippy_solvers", "", "load", 1e-9),
        Code("ContactMechanics, CCG", *_CONTACT_MECHANICS, "displacement", 1e-9),
        Code("ContactMechanics, Polonsky–Keer", *_CONTACT_MECHANICS, "load", 1e-9),
        Code("Tamaas, Polonsky–Keer–Rey", "tamaas", "tamaas_solver", "", "load", 1e-9),
    )
}


@dataclass(frozen=True)
class Case:
    """One problem for several codes. `more` are codes that only --all adds, for their time."""

    name: str
    title: str
    surface: Surface
    pressure: float
    codes: tuple[str, ...]
    more: tuple[str, ...] = ()
    steps: int = 1


class Grids(NamedTuple):
    """Grids of several sizes for one code, one surface a seed; shortest wave in elements."""

    code: str
    sizes: tuple[int, ...]
    seeds: tuple[int, ...] = (0,)
    cut_off: int = CUT_OFF


@dataclass(frozen=True)
class Growth:
    """One problem on finer and finer grids, and what --all adds."""

    name: str
    title: str
    pressure: float
    runs: tuple[Grids, ...]
    more: tuple[Grids, ...]


_NATIVE = ("aspher native, FFT", "aspher native, FFT mixed precision")
_SINGLE = tuple(
    label
    for label in CODES
    if not label.startswith("aspher native") and "warm" not in label
)
_PERIODIC = tuple(label for label in _SINGLE if label != "aspher, H2")
_PATH = (
    "gstlib, load",
    "aspher, FFT",
    "aspher, FFT mixed precision",
    "aspher, FFT warm",
    "slippy, BCCG",
)
_PATH_MORE = (
    "aspher native, FFT warm",
    "ContactMechanics, CCG",
    "Tamaas, Polonsky–Keer–Rey",
)
_P2 = Surface("rough", 512)
_P2_PERIODIC = Surface("rough", 512, periodic=True)
_SEEDS = (0, 1, 2, 3, 4)

CASES = {
    case.name: case
    for case in (
        Case(
            "rough-76",
            "Rough 512² at 76 MPa, cold, one thread",
            _P2,
            76.0,
            _SINGLE,
            _NATIVE,
        ),
        Case(
            "rough-22",
            "Rough 512² at 22 MPa, cold, one thread",
            _P2,
            22.0,
            _SINGLE,
            _NATIVE,
        ),
        Case(
            "hertz-256",
            "Smooth sphere 256², cold, one thread",
            Surface("sphere", 256),
            76.0,
            _SINGLE,
            _NATIVE,
        ),
        Case(
            "hertz-512",
            "Smooth sphere 512², cold, one thread",
            Surface("sphere", 512),
            76.0,
            _SINGLE,
            _NATIVE,
        ),
        Case(
            "path-76",
            f"{STEPS} equal steps of displacement to 76 MPa, rough 512², one thread",
            _P2,
            76.0,
            _PATH,
            _PATH_MORE,
            steps=STEPS,
        ),
        Case(
            "path-22",
            f"{STEPS} equal steps of displacement to 22 MPa, rough 512², one thread",
            _P2,
            22.0,
            _PATH,
            _PATH_MORE,
            steps=STEPS,
        ),
        Case(
            "periodic-76",
            "Rough 512² at 76 MPa, periodic, cold, one thread",
            _P2_PERIODIC,
            76.0,
            _PERIODIC,
        ),
        Case(
            "periodic-2000",
            "Rough 512² at 2000 MPa, periodic, cold, one thread",
            _P2_PERIODIC,
            2000.0,
            _PERIODIC,
        ),
        Growth(
            "growth",
            "Rough at 76 MPa, cold, one thread: finer grids",
            76.0,
            (
                Grids("gstlib, load", (256, 512, 1024, 2048, 4096), _SEEDS),
                # with the waves of 2048²: is it the size, or the finer roughness?
                Grids("gstlib, load", (4096,), _SEEDS, 2 * CUT_OFF),
                Grids("aspher, FFT", (256, 512, 1024, 2048, 4096)),
                Grids("slippy, BCCG", (256, 512, 1024)),
            ),
            (
                Grids("aspher, FFT mixed precision", (256, 512, 1024, 2048)),
                Grids("slippy, BCCG", (2048,)),
                Grids("Tamaas, Polonsky–Keer–Rey", (256, 512, 1024)),
            ),
        ),
    )
}
