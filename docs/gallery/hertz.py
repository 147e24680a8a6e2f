# %% [markdown]
"""A sphere on a flat, compared with Hertz's solution (Johnson, Contact Mechanics, §4.2)."""

# %%
import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import contact_modulus, solve_contact
from gstlib.bem.closed_forms import Sphere

radius, force = 10.0, 20.0  # mm, N
modulus = contact_modulus(19500, 0.24, 19500, 0.24)  # MPa: sandstone on sandstone

hertz = Sphere(force, radius, modulus)

# %%
# The sphere is a paraboloid, as in Hertz's theory, on a grid of 255 × 255 elements.
side, n = 2.5 * hertz.contact_radius, 255
x = ((np.arange(n) + 0.5) / n - 0.5) * side
distance = np.hypot(x, x[:, None])
state = solve_contact(
    -(distance**2) / (2 * radius), side / n, modulus, mean_pressure=force / side**2
)

found_radius = np.sqrt(state.contact_fraction * side**2 / np.pi)
print(
    f"radius of the contact: {found_radius:.4f} mm, Hertz {hertz.contact_radius:.4f} mm"
)
print(
    f"highest pressure: {state.pressure.max():.1f} MPa, Hertz {hertz.peak_pressure:.1f} MPa"
)

# %%
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
axes.plot(x, state.pressure[n // 2], ".", label="gstlib.bem")
axes.plot(x, hertz.pressure(x, 0), label="Hertz")
axes.set(xlabel="x (mm)", ylabel="pressure (MPa)", title="A sphere on a flat")
axes.legend()
figure.savefig("hertz.png", dpi=120)
