# %% [markdown]
"""Load on the rim of a scan that is pressed alone, and as a part of its surface."""

# %%
import warnings

import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import ContactWarning, HalfSpace, contact_modulus, solve_contact
from gstlib.specimen.randomness import self_affine_field

spacing, n = 0.00332, 256  # mm, elements along a side of the scan
modulus, pressure = contact_modulus(19500, 0.24, 19500, 0.24), 50.0  # MPa

# A periodic surface with waves of all lengths. The scan is a quarter of it.
waves = {
    "hurst_exponent": 0.8,
    "roll_off": 2 * n * spacing,
    "shortest": 0.03,
}  # lengths in mm
rough = self_affine_field(np.random.default_rng(1), 2 * n, spacing, **waves)
whole = 0.006 * rough / rough.std()  # mm
scan = whole[:n, :n]

# %%
surface = solve_contact(whole, spacing, modulus, mean_pressure=pressure, periodic=True)
inside = surface.pressure[:n, :n]
rim = np.ones((n, n), bool)
rim[3:-3, 3:-3] = False
borne = inside.mean()  # MPa, pressure on the scan as a part of its surface

with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always", ContactWarning)
    alone = solve_contact(scan, spacing, modulus, mean_pressure=borne)

# The pressures around the scan displace it by the whole displacement minus its own.
period = HalfSpace(whole.shape, spacing, modulus, periodic=True)
around = period.displacement(surface.pressure)[:n, :n]
around -= HalfSpace(scan.shape, spacing, modulus).displacement(inside)
embedded = solve_contact(scan - around, spacing, modulus, mean_pressure=borne)

shares = [inside[rim].sum() / inside.sum(), alone.rim_fraction, embedded.rim_fraction]
print(f"the rim is {100 * rim.mean():.1f} % of the scan")
print(f"in its surface, it carries {100 * shares[0]:.1f} % of the force")
print(
    f"alone: {100 * shares[1]:.1f} %, lowered by the pressures around: {100 * shares[2]:.1f} %"
)
print(f"warning for the scan alone: {caught[0].message}")

# %%
figure, axes = plt.subplots(1, 3, figsize=(10, 3.6), layout="constrained")
panels = {
    "in its surface": inside,
    "alone": alone.pressure,
    "lowered": embedded.pressure,
}
for axis, (title, field) in zip(axes, panels.items(), strict=True):
    axis.imshow(field > 0, cmap="gray_r", origin="lower")
    axis.set(title=f"contact {title}", xticks=[], yticks=[])
figure.savefig("rim.png", dpi=120)
