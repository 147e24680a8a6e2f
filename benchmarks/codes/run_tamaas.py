"""Tamaas: Polonsky–Keer–Rey under load, periodic or with the non-periodic (dcfft) operator.

The order matters: elastic constants before the operator, and the operator given to the solver too;
otherwise it corrupts the kernel or solves the periodic problem, without a word.
"""

import numpy as np
import tamaas
from common import main

MAX_ITERATIONS = 3000


def solve(problem, task):
    tamaas.set_log_level(tamaas.LogLevel.error)
    tamaas.initialize(task.threads)
    heights = problem.heights
    sizes = [n * problem.spacing for n in heights.shape]
    model = tamaas.ModelFactory.createModel(
        tamaas.model_type.basic_2d, sizes, list(heights.shape)
    )
    model.E, model.nu = problem.modulus, 0.0
    if not problem.periodic:
        tamaas.ModelFactory.registerNonPeriodic(model, "dcfft")
    # Two convolutions an iteration, as the method has it; its interface offers no counter.
    solver = tamaas.PolonskyKeerRey(model, heights, task.tolerance)
    if not problem.periodic:
        solver.setIntegralOperator("dcfft")
    solver.max_iter = MAX_ITERATIONS
    solver.solve(*task.levels)
    pressure = np.array(model.traction)
    return {"pressure": [pressure], "iterations": None, "convolutions": None}


main(solve)
