# %% [markdown]
"""Periodic waves and a finite piece of them, compared with Westergaard's solution."""

# %%
import warnings

import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import ContactWarning, contact_modulus, solve_contact
from gstlib.surfaces.grid import make_surface

n, side, waves = 256, 1.0, 4  # elements, mm
modulus = contact_modulus(19500, 0.24, 19500, 0.24)  # MPa
amplitude, wavelength = 1e-3, side / waves  # mm
full_contact = np.pi * modulus * amplitude / wavelength  # MPa, mean pressure

x = (np.arange(n) + 0.5) * side / n
profile = amplitude * np.cos(2 * np.pi * x / wavelength)
surface = make_surface(np.tile(profile, (n, 1)), side / n)

# %%
shares = np.linspace(0.02, 0.98, 13)
loads = full_contact * shares
# The free piece is pressed at its border, as it should be here.
warnings.simplefilter("ignore", ContactWarning)
periodic, free = (
    [
        solve_contact(
            surface, contact_modulus=modulus, mean_pressure=load, periodic=is_periodic
        )
        for load in loads
    ]
    for is_periodic in (True, False)
)
areas, free_areas = (
    np.array([state.contact_fraction for state in states])
    for states in (periodic, free)
)
# Westergaard (Johnson, Contact Mechanics, sect. 13.2): area and pressure
exact = 2 / np.pi * np.arcsin(np.sqrt(shares))
difference = np.abs(areas - exact).max()
half = len(loads) // 2
print(f"largest difference of periodic and Westergaard: {difference:.3f}")
print(f"contact at half of full pressure: Westergaard {exact[half]:.3f},")
print(f"periodic {areas[half]:.3f}, free {free_areas[half]:.3f}")
print(f"the rim of the free piece carries {100 * free[half].rim_fraction:.0f} %")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
left.plot(loads, areas, ".-", label="periodic")
left.plot(loads, free_areas, ".-", label="free")
left.plot(loads, exact, "k--", label="Westergaard")
left.set(xlabel="mean pressure (MPa)", ylabel="contact fraction")
left.legend()
right.plot(x, periodic[half].pressure[n // 2], label="periodic")
right.plot(x, free[half].pressure[n // 2], label="free")
inside = np.maximum(shares[half] - np.sin(np.pi * x / wavelength) ** 2, 0)
pressure = 2 * full_contact * np.abs(np.cos(np.pi * x / wavelength)) * np.sqrt(inside)
right.plot(x, pressure, "k--", label="Westergaard")
right.set(xlabel="x (mm)", ylabel="pressure (MPa)", ylim=(0, 6 * loads[half]))
right.legend()
figure.savefig("waves.png", dpi=120)
