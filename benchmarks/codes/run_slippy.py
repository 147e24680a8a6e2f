"""slippy: bound-constrained CG under displacement, Polonsky–Keer under load.

Called one level below its ContactModel, whose default kernel (made in the frequency domain) is
2.75 % off in force where nothing is periodic: the kernel is the spatial one there, as with
`use_frequency_domain=False`. On a periodic surface it is that of the frequency domain, with nothing
for a uniform pressure, as its manual asks.
"""

import numpy as np
import slippy
from common import Counted, main
from slippy.core import (
    bccg,
    elastic_influence_matrix_frequency,
    elastic_influence_matrix_spatial,
    get_angular_velocity,
    plan_convolve,
    polonsky_and_keer,
)

MAX_ITERATIONS = 3000


def solve(problem, task):
    slippy.CORES = task.threads
    relief = problem.heights.max() - problem.heights
    run = {"load": by_load, "displacement": by_displacement}[task.control]
    return run(task, relief, *influence(problem))


def influence(problem):
    """Its kernel, and how it is to be convolved with."""
    shape, spacing = problem.heights.shape, (problem.spacing, problem.spacing)
    if problem.periodic:
        x, y = get_angular_velocity(shape, spacing)
        norm = np.hypot(x, y)
        kernel = elastic_influence_matrix_frequency(
            y, x, norm, norm**2, "zz", problem.modulus, 0.0
        )
        return kernel, {"circular": True, "fft_im": True}
    # (1 − ν)/(2πG) is 1/(πE*) for ν = 0 and G = E*/2.
    kernel = elastic_influence_matrix_spatial(
        "zz", tuple(2 * n for n in shape), spacing, problem.modulus / 2, 0.0
    )
    return kernel, {"circular": False, "fft_im": False}


def by_displacement(task, relief, kernel, options):
    # As slippy does: only elements within the rigid interpenetration (of the last level) can touch;
    # if periodic, a surface that sinks in raises that around it, and all can.
    domain = relief < (np.inf if options["circular"] else task.levels[-1])
    convolve = Counted(plan_convolve(relief, kernel, domain, **options))
    pressures = []
    pressure = np.zeros(np.count_nonzero(domain))
    # Downwards, each from the state above: a tenth less than upwards.
    for level in task.levels[::-1]:
        wanted = level - relief[domain]
        if not pressure.any():
            # Its ContactModel starts from the overlap, scaled by the sum of the kernel. A uniform
            # pressure has none if periodic: then by the softest wave.
            softness = kernel.max() if options["circular"] else kernel.sum()
            pressure = np.maximum(wanted, 0.0) / softness
        pressure, _ = bccg(convolve, wanted, task.tolerance, MAX_ITERATIONS, pressure)
        field = np.zeros_like(relief)
        field[domain] = pressure
        pressures.append(field)
    return {
        "pressure": pressures[::-1],
        "iterations": None,
        "convolutions": convolve.calls,
    }


def by_load(task, relief, kernel, options):
    convolve = Counted(plan_convolve(relief, kernel, None, **options))
    (level,) = task.levels
    # It scales the *mean* of the start to what it is given as the load, and the sum times the
    # element's area ever after: the two agree, and a good start is kept, on a unit area.
    _, pressure, _ = polonsky_and_keer(
        lambda p: convolve(p, False),
        np.ones_like(relief),
        relief,
        level,
        2 * (relief.size**-0.5,),
        eps_0=task.tolerance,
        max_it=MAX_ITERATIONS,
    )
    return {"pressure": [pressure], "iterations": None, "convolutions": convolve.calls}


main(solve)
