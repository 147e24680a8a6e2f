"""What every runner does: read a task, solve and measure, write the fields and a record.

A runner is a script that the interpreter of its own code runs, in a fresh process for each
measurement: ``python codes/run_slippy.py folder``. It needs numpy and its code only, and no newer
Python than 3.10.

The folder has problem.npz: heights (mm), spacing (mm), contact_modulus (MPa), periodic: whether the
surface repeats itself; displacements then count from the mean. Its task.json has `variant`,
`control` ("load": levels are mean pressures in MPa; "displacement": far-field displacements from
first touch in mm), `levels` (ascending; one of them is a single solve), `target_pressure` (the
last mean pressure), `tolerance` in the code's own sense, and `threads`. The runner adds fields.npz
and record.json.
"""

import json
import sys
import time
from types import SimpleNamespace

import numpy as np


def _memory_mb(key):
    """Resident memory of this process (MB): "VmHWM", its peak, or "VmRSS", that of now.

    Not getrusage: its peak is inherited from the process that started this one.
    """
    with open("/proc/self/status", encoding="ascii") as file:
        line = next(line for line in file if line.startswith(key))
    return int(line.split()[1]) / 1e3


def main(solve):
    """Run ``solve(problem, task)`` once, as the command line says.

    `solve` returns a dict: `pressure` (MPa), a list with one (ny, nx) array per level; and
    `iterations` and `convolutions`, summed over the levels and counted on the finest grid.

    CPU (user + system, all threads) and wall time are of set-up and solve together. Interpreter,
    imports, reading and writing are left out, as they would be in a longer program.
    """
    folder = sys.argv[1]
    with open(f"{folder}/task.json", encoding="utf-8") as file:
        task = SimpleNamespace(**json.load(file))
    with np.load(f"{folder}/problem.npz") as stored:
        problem = SimpleNamespace(
            heights=stored["heights"],
            spacing=float(stored["spacing"]),
            modulus=float(stored["contact_modulus"]),
            periodic=bool(stored["periodic"]),
        )
    before = _memory_mb("VmRSS")
    wall, cpu = time.perf_counter(), time.process_time()
    result = solve(problem, task)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = _memory_mb("VmHWM")
    np.savez(f"{folder}/fields.npz", pressure=np.stack(result.pop("pressure")))
    record = {
        "cpu": cpu,
        "wall": wall,
        "peak_mb": peak,
        "added_mb": peak - before,
        **result,
    }
    with open(f"{folder}/record.json", "w", encoding="utf-8") as file:
        json.dump(record, file)


class Counted:
    """A function that counts its calls."""

    def __init__(self, function):
        self.function = function
        self.calls = 0

    def __call__(self, *arguments, **options):
        self.calls += 1
        return self.function(*arguments, **options)
