"""What wear costs and how exact it is: ten implicit steps on the benchmarks' rough patch, 512².

`.venv/bin/python benchmarks/wear.py` prints, for a mean loss of 1 µm at 76 MPa: the CPU time of ten
steps over that of one cold contact (median of three), and against 300 explicit steps the difference
of the depth (r.m.s. over r.m.s.) and the convolutions. It takes a few minutes.
"""

import time

import numpy as np
from problems import MODULUS, Surface

from gstlib.bem import solve_contact, wear_path

PRESSURE, LOSS, EXPLICIT = 76.0, 1e-3, 300


def cpu_time(compute):
    """Seconds, the median of three."""
    times = []
    for _ in range(3):
        start = time.process_time()
        compute()
        times.append(time.process_time() - start)
    return float(np.median(times))


def main():
    surface = Surface("rough", 512)
    heights = surface.heights()
    elastic = surface.spacing, MODULUS

    def worn():
        return wear_path(
            heights,
            *elastic,
            mean_pressure=PRESSURE,
            mean_loss=LOSS,
            steps=10,
            keep_states=True,
        )

    once = cpu_time(lambda: solve_contact(heights, *elastic, mean_pressure=PRESSURE))
    print(f"ten implicit steps take {cpu_time(worn) / once:.1f} times one cold contact")

    path = worn()
    sinking = heights.copy()
    pressure = None
    convolutions = 0
    for _ in range(EXPLICIT):
        state = solve_contact(
            sinking, *elastic, mean_pressure=PRESSURE, initial_pressure=pressure
        )
        pressure = state.pressure
        sinking -= LOSS / EXPLICIT / PRESSURE * pressure
        convolutions += state.convolutions
    explicit = heights - sinking
    error = np.linalg.norm(path.depth - explicit) / np.linalg.norm(explicit)
    print(f"{EXPLICIT} explicit steps: the depth differs by {error:.2%}")
    implicit = sum(state.convolutions for (state,) in path.states)
    print(f"convolutions: {implicit} implicit, {convolutions} explicit")


if __name__ == "__main__":
    main()
