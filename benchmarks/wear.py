"""How exact wear is: ten implicit steps on the benchmarks' rough patch, 512².

`.venv/bin/python benchmarks/wear.py` compares them with 300 explicit steps, for a mean loss of 1 µm
at 76 MPa: the difference of the depth (r.m.s. over r.m.s.), and the convolutions. It takes half a
minute.
"""

import numpy as np
from problems import MODULUS, Surface

from gstlib.bem import solve_contact, wear_path

PRESSURE, LOSS, EXPLICIT = 76.0, 1e-3, 300


def main():
    surface = Surface("rough", 512)
    heights = surface.heights()
    elastic = surface.spacing, MODULUS

    path = wear_path(
        heights,
        *elastic,
        mean_pressure=PRESSURE,
        mean_loss=LOSS,
        steps=10,
        keep_states=True,
    )
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
