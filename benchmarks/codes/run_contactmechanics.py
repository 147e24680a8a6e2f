"""ContactMechanics: constrained CG without restart under displacement, Polonsky–Keer under load.

Its tolerances are absolute: the task's one is taken in units of the r.m.s. height.
"""

import numpy as np
from common import Counted, main
from ContactMechanics import FreeFFTElasticHalfSpace, PeriodicFFTElasticHalfSpace
from ContactMechanics.Systems import NonSmoothContactSystem
from SurfaceTopography import Topography

MAX_ITERATIONS = 3000


def solve(problem, task):
    heights, spacing = problem.heights, problem.spacing
    sizes = tuple(n * spacing for n in heights.shape)
    surface = heights.shape, problem.modulus, sizes
    if problem.periodic:
        # Displacement counted from its mean: a uniform pressure gives none.
        substrate = PeriodicFFTElasticHalfSpace(*surface, stiffness_q0=0.0)
    else:
        substrate = FreeFFTElasticHalfSpace(*surface)
    substrate.evaluate_disp = Counted(substrate.evaluate_disp)
    topography = Topography(heights, physical_sizes=sizes)
    system = NonSmoothContactSystem(substrate, topography)
    gap = task.tolerance * heights.std()
    (level,) = task.levels
    if task.control == "displacement":
        # Hertz-like magnitude where the rigid bodies overlap; a start at zero can stall.
        relief = heights - heights.max()
        start = np.maximum(level + relief, 0.0) * problem.modulus * spacing
        result = system.dual_minimize_proxy(
            level - heights.max(), init_force=start, gtol=gap, maxiter=MAX_ITERATIONS
        )
        force = result.x.reshape(heights.shape)
    else:
        total = level * heights.size * spacing**2
        # Its forces are negative in compression and live on the padded grid, if there is one.
        ny, nx = heights.shape
        start = np.zeros(substrate.nb_subdomain_grid_pts)
        start[:ny, :nx] = -total / heights.size
        result = system.minimize_proxy(
            external_force=total,
            initial_forces=start,
            pentol=gap,
            forcetol=1e-9 * total / heights.size,
            maxiter=MAX_ITERATIONS,
        )
        force = np.array(result.jac)
    return {
        "pressure": [force / spacing**2],
        "iterations": result.nit,
        "convolutions": substrate.evaluate_disp.calls,
    }


main(solve)
