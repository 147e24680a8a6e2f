# %% [markdown]
"""A rough patch worn by a sliding flat, by Archard's law in ten steps."""

# %%
import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import contact_modulus, solve_contact, wear_path
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface

side, n = 0.85, 256  # mm, elements along a side
waves = {"hurst_exponent": 0.8, "roll_off": 0.2, "shortest": 0.02}  # lengths in mm
rough = self_affine_field(np.random.default_rng(1), n, side / n, **waves)
height = make_surface(0.002 * rough / rough.std(), side / n)  # mm

modulus = contact_modulus(19500, 0.24, 19500, 0.24)  # MPa
pressure = 22.0  # MPa
wear_rate, sliding = 2e-5, 1.0  # mm³/(N m), m

# %%
new = solve_contact(height, contact_modulus=modulus, mean_pressure=pressure)
load = {"contact_modulus": modulus, "mean_pressure": pressure}
worn = wear_path(height, mean_loss=wear_rate * sliding * pressure, **load)

volume = float(worn.depth.sum()) * (side / n) ** 2
expected = wear_rate * (pressure * side**2) * sliding
touching, peak = 100 * worn.final.contact_fraction, worn.final.pressure.max()
print(f"volume lost: {1e9 * volume:.0f} µm³, Archard's k F s {1e9 * expected:.0f} µm³")
print(f"contact: {100 * new.contact_fraction:.1f} % new, {touching:.1f} % worn")
print(f"highest pressure: {new.pressure.max():.0f} MPa new, {peak:.0f} MPa worn")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
worn.depth.plot.imshow(ax=left)
left.set_aspect("equal")
row, x = int(worn.depth.max("x").argmax("y")), height.x
right.plot(x, 1e3 * height[row], label="new")
right.plot(x, 1e3 * (height - worn.depth)[row], label="worn")
right.set(
    xlabel="x (mm)", ylabel="height (µm)", title="profile through the deepest wear"
)
right.legend()
figure.savefig("patch_wear.png", dpi=120)
