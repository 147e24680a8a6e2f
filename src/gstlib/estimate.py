"""How long a study will take here, and how much memory: by one small contact solved on the spot."""

import math
import statistics
import time
import warnings
from dataclasses import dataclass

import numpy as np

__all__ = ["Estimate", "estimate_study", "machine_speed"]

# Seconds of CPU on a machine of speed 1, from the default study (`python benchmarks/study.py`):
# one state of the contact of a scan of 512 x 512 points, ...
_STATE = 0.09
# ... all else that is done to such a scan and to a patch (cleaning, registration, drawing), ...
_SCAN, _PATCH = 1.0, 3.5
# ... and what does not depend on their number.
_FIXED = 45.0
_POINTS = 512 * 512
# The contact's cost grows a little faster than the number of points: more iterations.
_GROWTH = 1.12
# A contact of 256 x 256 elements takes this long (s) at speed 1.
_REFERENCE = 0.05
# Bytes of an element at the peak of a solution, and of an interpreter with its libraries.
_ELEMENT, _INTERPRETER = 250, 250e6


@dataclass(frozen=True)
class Estimate:
    """Attributes: CPU time (s) of the whole study, peak memory (MB) of its largest job."""

    cpu_s: float
    memory_mb: float


def machine_speed(repeats: int = 3) -> float:
    """Speed of one core of this machine at this work; 1 is the one that the figures are of."""
    from gstlib.bem import solve_contact

    # Waves of three lengths and directions: rough enough to be like a stone, and no random numbers.
    y, x = np.mgrid[:256, :256] / 256.0
    heights = sum(
        math.exp(-0.4 * k) * np.sin(2 * math.pi * k * (x * math.cos(k) + y * math.sin(k)) + k)
        for k in range(3, 40, 4)
    )
    durations = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for _ in range(repeats):
            start = time.process_time()
            solve_contact(5e-3 * heights, 1 / 256, 1e4, mean_pressure=50.0, tolerance=1e-9)
            durations.append(time.process_time() - start)
    return _REFERENCE / statistics.median(durations)


def estimate_study(
    *,
    scan_points: int,
    scans: int,
    patches: int,
    patch_steps: int,
    square_points: int,
    square_steps: int,
    speed: float,
) -> Estimate:
    """Estimate a study; within a factor of two or so, for patches that are all studied.

    Parameters
    ----------
    scan_points : int
        Points of a patch's scan.
    scans, patches : int
        Their numbers.
    patch_steps, square_steps : int
        Load steps of the micro- and of the macroscale.
    square_points : int
        Elements of the macroscale.
    speed : float
        See `machine_speed`.
    """
    size = scan_points / _POINTS
    states = patches * patch_steps * size**_GROWTH
    states += square_steps * (square_points / _POINTS) ** _GROWTH
    cpu = _FIXED + _STATE * states + (_SCAN * scans + _PATCH * patches) * size
    largest = max(scan_points, square_points)
    return Estimate(cpu / speed, (_INTERPRETER + _ELEMENT * largest) / 1e6)
