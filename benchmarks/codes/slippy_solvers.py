"""slippy: bound-constrained CG under displacement, Polonsky–Keer under load.

Called one level below its ContactModel, whose default kernel (made in the frequency domain) is
2.75 % off in force: the kernel is the spatial one, as with `use_frequency_domain=False`.
"""

import numpy as np
import slippy
from common import Counted, main
from slippy.core import bccg, elastic_influence_matrix_spatial, plan_convolve, polonsky_and_keer

MAX_ITERATIONS = 3000


def solve(problem, task):
    slippy.CORES = task.threads
    heights, spacing = problem.heights, problem.spacing
    # (1 − ν)/(2πG) is 1/(πE*) for ν = 0 and G = E*/2.
    kernel = elastic_influence_matrix_spatial(
        "zz", tuple(2 * n for n in heights.shape), (spacing, spacing), problem.modulus / 2, 0.0
    )
    relief = heights.max() - heights
    run = {"load": by_load, "displacement": by_displacement}[task.control]
    return run(problem, task, kernel, relief)


def by_displacement(problem, task, kernel, relief):
    # As slippy does: only elements within the rigid interpenetration (of the last level) can touch.
    domain = relief < task.levels[-1]
    convolve = Counted(plan_convolve(relief, kernel, domain, circular=False, fft_im=False))
    pressures, verdicts = [], set()
    pressure = np.zeros(np.count_nonzero(domain))
    # Downwards, each from the state above: a tenth less than upwards.
    for level in task.levels[::-1]:
        wanted = level - relief[domain]
        if not pressure.any():
            # Its ContactModel starts from the overlap, scaled by the sum of the kernel.
            pressure = np.maximum(wanted, 0.0) / kernel.sum()
        pressure, failed = bccg(convolve, wanted, task.tolerance, MAX_ITERATIONS, pressure)
        field = np.zeros_like(relief)
        field[domain] = pressure
        pressures.append(field)
        verdicts.add("failed" if failed else "converged")
    return {
        "pressure": pressures[::-1],
        "iterations": None,
        "convolutions": convolve.calls,
        "verdict": ", ".join(sorted(verdicts)),
    }


def by_load(problem, task, kernel, relief):
    convolve = Counted(plan_convolve(relief, kernel, None, circular=False, fft_im=False))
    pressures, verdicts = [], set()
    pressure = np.ones_like(relief)
    for level in task.levels:
        # It scales the *mean* of the start to what it is given as the load, and the sum times the
        # element's area ever after: the two agree, and a good start is kept, on a unit area.
        failed, pressure, _ = polonsky_and_keer(
            lambda p: convolve(p, False),
            pressure,
            relief,
            level,
            (relief.size**-0.5, relief.size**-0.5),
            eps_0=task.tolerance,
            max_it=MAX_ITERATIONS,
        )
        pressures.append(pressure)
        verdicts.add("failed" if failed else "converged")
    return {
        "pressure": pressures,
        "iterations": None,
        "convolutions": convolve.calls,
        "verdict": ", ".join(sorted(verdicts)),
    }


if __name__ == "__main__":
    main(solve)
