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
    if problem.periodic:
        # Displacement counted from its mean: a uniform pressure gives none.
        substrate = PeriodicFFTElasticHalfSpace(
            heights.shape, problem.modulus, sizes, stiffness_q0=0.0
        )
    else:
        substrate = FreeFFTElasticHalfSpace(heights.shape, problem.modulus, sizes)
    substrate.evaluate_disp = Counted(substrate.evaluate_disp)
    system = NonSmoothContactSystem(
        substrate, Topography(heights, physical_sizes=sizes)
    )
    gap = task.tolerance * heights.std()
    run = {"load": by_load, "displacement": by_displacement}[task.control]
    forces, iterations = run(problem, task, system, gap)
    return {
        "pressure": [force / spacing**2 for force in forces],
        "iterations": iterations,
        "convolutions": substrate.evaluate_disp.calls,
    }


def by_displacement(problem, task, system, gap):
    heights = problem.heights
    relief = heights - heights.max()
    forces, iterations = [], 0
    force = None
    for level in task.levels:
        if force is None:
            # Hertz-like magnitude where the rigid bodies overlap; a start at zero can stall.
            force = np.maximum(level + relief, 0.0) * problem.modulus * problem.spacing
        result = system.dual_minimize_proxy(
            level - heights.max(), init_force=force, gtol=gap, maxiter=MAX_ITERATIONS
        )
        force = result.x.reshape(heights.shape)
        forces.append(force)
        iterations += result.nit
    return forces, iterations


def by_load(problem, task, system, gap):
    heights = problem.heights
    padded = system.substrate.nb_subdomain_grid_pts
    ny, nx = heights.shape
    # Its forces are negative in compression and live on the padded grid, if there is one.
    force = np.zeros(padded)
    force[:ny, :nx] = -1.0
    forces, iterations = [], 0
    for level in task.levels:
        total = level * heights.size * problem.spacing**2
        result = system.minimize_proxy(
            external_force=total,
            initial_forces=force * (total / -force.sum()),
            pentol=gap,
            forcetol=1e-9 * total / heights.size,
            maxiter=MAX_ITERATIONS,
        )
        forces.append(np.array(result.jac))
        force[:ny, :nx] = -forces[-1]
        iterations += result.nit
    return forces, iterations


if __name__ == "__main__":
    main(solve)
