# %% [markdown]
"""A sphere pushed sideways on a flat, compared with the solution of Cattaneo and Mindlin."""

# %%
import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem.closed_forms import Sphere
from gstlib.contact import Interface, Load, contact_at_pressure
from gstlib.microscale.slip_and_cap import solve_slip
from gstlib.surfaces.grid import make_surface

radius, modulus, mean_pressure = 10.0, 10345.0, 50.0  # mm, MPa, MPa
side, n = 0.6, 256  # mm, elements along a side
friction, ratio = (
    0.5,
    0.6,
)  # the sideways force is 60 % of the force that makes it slide

# %%
x = ((np.arange(n) + 0.5) / n - 0.5) * side
distance = np.hypot(x, x[:, None])
sphere = make_surface(-(distance**2) / (2 * radius), side / n)
on_flat, load = Interface.on_flat(sphere), Load(mean_pressure)
contact = contact_at_pressure(on_flat, load, modulus=modulus, tolerance=1e-9)
slip = solve_slip(contact, friction=friction, tangential_ratio=ratio, poisson=0.24)

# The contact sticks within the radius c (Johnson, Contact Mechanics, eq. 7.44).
c = Sphere(mean_pressure * side**2, radius, modulus).stick_radius(ratio)
stick = np.sqrt(int(slip.stick.sum()) * (side / n) ** 2 / np.pi)
force = float(slip.traction.sum()) / (friction * float(contact.pressure.sum()))
print(f"radius of the stick zone: {stick:.4f} mm, Cattaneo and Mindlin {c:.4f} mm")
print(f"tangential force over sliding force: {force:.3f}, prescribed {ratio:.3f}")

# %%
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
axes.plot(x, friction * contact.pressure[n // 2], "--", label="friction × pressure")
axes.plot(x, slip.traction[n // 2], label="traction")
axes.axvspan(-c, c, alpha=0.15, label="stick zone (Cattaneo, Mindlin)")
axes.set(xlabel="x (mm)", ylabel="MPa", title="Partial slip")
axes.legend()
figure.savefig("partial_slip.png", dpi=120)
