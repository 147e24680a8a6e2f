# %% [markdown]
"""A rough patch with a cap on the pressure, from elastic to fully plastic contact."""

# %%
import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import contact_modulus, solve_contact
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface

n, side = 256, 0.85  # elements, mm
waves = {"hurst_exponent": 0.8, "roll_off": 0.2, "shortest": 0.02}  # lengths in mm
rough = self_affine_field(np.random.default_rng(1), n, side / n, **waves)
surface = make_surface(0.002 * rough / rough.std(), side / n)
modulus, pressure = contact_modulus(19500, 0.24, 19500, 0.24), 22.0  # MPa

# %%
caps = np.geomspace(4000, 100, 9)  # MPa
elastic = solve_contact(surface, contact_modulus=modulus, mean_pressure=pressure)
states = [
    solve_contact(
        surface, contact_modulus=modulus, mean_pressure=pressure, pressure_cap=cap
    )
    for cap in caps
]
contact = np.array([state.contact_fraction for state in states])
print(
    f"elastic: {100 * elastic.contact_fraction:.2f} %, {elastic.pressure.max():.0f} MPa"
)
last = states[-1]
print(f"cap of {caps[-1]:.0f} MPa: {100 * contact[-1]:.2f} % in contact")
plastic = 100 * pressure / caps[-1]
print(
    f"{100 * last.capped_fraction:.0f} % of it yields; fully plastic: {plastic:.2f} %"
)

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
states[5].pressure.where(states[5].contact).plot.imshow(ax=left)
left.set(title=f"cap of {caps[5]:.0f} MPa", aspect="equal")
right.loglog(caps, contact, ".-", label="gstlib.bem")
right.axhline(elastic.contact_fraction, linestyle="--", label="elastic")
right.loglog(caps, pressure / caps, ":", label="mean pressure over cap")
right.set(xlabel="cap on the pressure (MPa)", ylabel="contact fraction")
right.legend()
figure.savefig("pressure_cap.png", dpi=120)
