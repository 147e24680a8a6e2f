# %% [markdown]
"""Two rough stones on each other: only the gap between them matters, not which is below."""

# %%
import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import contact_modulus
from gstlib.contact import Interface, Load, contact_at_pressure, turned_over
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface

spacing, points = 0.85 / 256, 256  # mm
modulus = contact_modulus(19500, 0.24, 60000, 0.17)  # MPa: sandstone and a harder stone
load = Load(22.0)  # MPa


def rough(seed, rms):
    """A stone's face, seen from above it, with its r.m.s. height (mm)."""
    waves = {"hurst_exponent": 0.8, "roll_off": 0.2, "shortest": 0.02}  # lengths in mm
    field = self_affine_field(np.random.default_rng(seed), points, spacing, **waves)
    return make_surface(rms * field / field.std(), spacing)


def pressed(lower, upper):
    """Pressures (MPa) on the lower stone; the upper one is turned over onto it."""
    over = turned_over(upper, lower, source="upper", patch_source="lower")
    both = Interface(lower, over)
    return contact_at_pressure(
        both, load, modulus=modulus, tolerance=1e-9
    ).pressure.values


# %%
slab, handstone, flat = rough(1, 0.002), rough(2, 0.003), rough(2, 0.0)
by_flat, on_slab = pressed(slab, flat), pressed(slab, handstone)
swapped = pressed(handstone, slab)[:, ::-1]  # turned over, into the frame of the slab
difference = np.abs(on_slab - swapped).max() / on_slab.max()
print(f"difference after a swap: {difference:.0e} of the highest pressure")
print(f"contact of the slab: {100 * np.mean(by_flat > 0):.2f} % with a flat")
print(f"contact of the slab: {100 * np.mean(on_slab > 0):.2f} % with the handstone")

# %%
panels = {"by a flat": by_flat, "by the handstone": on_slab, "swapped": swapped}
figure, axes = plt.subplots(1, 3, figsize=(10, 3.6), layout="constrained")
for axis, (title, pressure) in zip(axes, panels.items(), strict=True):
    axis.imshow(pressure > 0, cmap="gray_r", origin="lower")
    axis.set(title=f"contact of the slab, {title}", xticks=[], yticks=[])
figure.savefig("two_tools.png", dpi=120)
