# %% [markdown]
"""A body that is free to tilt under a force off its middle: a round punch and a rough body."""

# %%
import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import contact_modulus, solve_contact
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface

n, side, radius, force = 255, 1.0, 0.48, 20.0  # elements, mm, mm, N
modulus = contact_modulus(19500, 0.24, 19500, 0.24)  # MPa
x = ((np.arange(n) + 0.5) / n - 0.5) * side
punch = np.hypot(x, x[:, None]) < radius

# %%
# up to a third of the radius off the middle, when the far edge is about to lift off
offsets = np.linspace(0, radius / 3, 5)  # mm
flat = make_surface(np.where(punch, 0.0, -np.inf), side / n)
options = {"contact_modulus": modulus, "mean_pressure": force / side**2}
states = [
    solve_contact(flat, load_point=(side / 2, side / 2 + offset), **options)
    for offset in offsets
]
tilts = np.array([state.tilt[1] for state in states])
exact = 0.75 * force * offsets / (modulus * radius**3)  # Johnson, eq. 5.36
print(f"tilt: {1e3 * tilts[-1]:.4f} mrad, closed form {1e3 * exact[-1]:.4f} mrad")

waves = {"hurst_exponent": 0.8, "roll_off": 0.2, "shortest": 0.03}  # lengths in mm
rough = self_affine_field(np.random.default_rng(1), n, side / n, **waves)
stone = flat + 0.002 * rough / rough.std()
rest = solve_contact(stone, load_point=(side / 2, side / 2 + offsets[-1]), **options)
centre = float((rest.pressure.sum("y") * x).sum() / rest.pressure.sum())
print(
    f"centre of the rough body's pressure: {centre:.4f} mm, of the force: {offsets[-1]:.4f} mm"
)

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
rest.pressure.where(rest.contact).plot.imshow(ax=left)
left.set_aspect("equal")
left.plot(side / 2 + offsets[-1], side / 2, "r+", markersize=12)
left.set_title("rough body and load point")
right.plot(offsets, 1e3 * tilts, "o", label="gstlib.bem")
right.plot(offsets, 1e3 * exact, label="closed form")
right.set(xlabel="force off the middle (mm)", ylabel="tilt of a flat punch (mrad)")
right.legend()
figure.savefig("tilting.png", dpi=120)
