"""gstlib.bem: solve_contact at one level, load_path (with its exact stiffness) over several.

Named after neither package nor module, which it would hide from its own import.
"""

import scipy.fft  # noqa: F401, which gstlib imports when it first transforms
from common import main

from gstlib.bem import load_path, solve_contact


def solve(problem, task):
    surface = (problem.heights, problem.spacing, problem.modulus)
    options = {"tolerance": task.tolerance, "periodic": problem.periodic}
    if len(task.levels) > 1:
        path = load_path(
            *surface,
            target_pressure=task.target_pressure,
            steps=len(task.levels),
            keep_states=True,
            **options,
        )
        return {
            "pressure": [state.pressure for state in path.states],
            "displacement": list(path.displacement),
            "iterations": int(path.iterations.sum()),
            "convolutions": int(path.convolutions.sum()),
        }
    level = {"load": "mean_pressure", "displacement": "displacement"}[task.control]
    state = solve_contact(*surface, **{level: task.levels[0]}, **options)
    return {
        "pressure": [state.pressure],
        "displacement": [state.displacement],
        "iterations": state.iterations,
        "convolutions": state.convolutions,
    }


main(solve)
