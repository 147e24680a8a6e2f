# %% [markdown]
"""A soft layer between two stones: contact extends to the valleys, and peak pressures fall."""

# %%
import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import Layer, contact_modulus, solve_contact
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface

n, side = 128, 0.85  # elements, mm
waves = {"hurst_exponent": 0.8, "roll_off": 0.2, "shortest": 0.03}  # lengths in mm
rough = self_affine_field(np.random.default_rng(1), n, side / n, **waves)
surface = make_surface(0.002 * rough / rough.std(), side / n)
stone, young, poisson = 19500.0, 300.0, 0.3  # MPa: stones; soft layer
modulus = contact_modulus(stone, 0.24, stone, 0.24)

# %%
options = {"contact_modulus": modulus, "mean_pressure": 5.0, "periodic": True}
thicknesses = np.geomspace(0.003, 3.0, 7)  # mm
layers = [Layer(young, poisson, thickness) for thickness in thicknesses]
states = [solve_contact(surface, layer=layer, **options) for layer in layers]
bare = solve_contact(surface, **options)

# A layer thicker than all wavelengths behaves like a half-space: the compliances add.
both = 1 / (1 / modulus + (1 - poisson**2) / young)
soft = solve_contact(surface, **options | {"contact_modulus": both})
contact = np.array([state.contact_fraction for state in states])
print(
    f"contact: {100 * bare.contact_fraction:.2f} % bare, {100 * contact[-1]:.1f} % with thick layer"
)
print(f"contact of an equally soft half-space: {100 * soft.contact_fraction:.1f} %")
print(
    f"highest pressures: {bare.pressure.max():.0f} and {states[-1].pressure.max():.0f} MPa"
)

# %%
figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
panels = {"bare": bare, f"a layer of {1e3 * thicknesses[3]:.0f} µm": states[3]}
for axis, (title, state) in zip(axes, panels.items(), strict=False):
    state.pressure.where(state.contact).plot.imshow(ax=axis)
    axis.set(title=title, aspect="equal")
axes[2].semilogx(1e3 * thicknesses, contact, ".-")
axes[2].axhline(soft.contact_fraction, linestyle="--", color="black")
axes[2].set(
    xlabel="thickness (µm)", ylabel="contact fraction", title="approach to a half-space"
)
figure.savefig("layer.png", dpi=120)
