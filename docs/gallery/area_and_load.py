# %% [markdown]
"""Contact of a rough surface, from a hundredth of its area to nearly all of it."""

# %%
import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import contact_modulus, solve_contact
from gstlib.bem.closed_forms import BUSH_SLOPE, PERSSON_SLOPE, persson_contact_fraction
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface

n, side = 256, 0.85  # elements, mm
waves = {"hurst_exponent": 0.8, "roll_off": 0.2, "shortest": 0.03}  # lengths in mm
rough = self_affine_field(np.random.default_rng(3), n, side / n, **waves)
surface = make_surface(0.002 * rough / rough.std(), side / n)

modulus = contact_modulus(19500, 0.24, 19500, 0.24)  # MPa
steps = [np.diff(surface.values, axis=axis) for axis in (0, 1)]
slope = np.sqrt(sum((step**2).mean() for step in steps)) * n / side  # r.m.s.
scale = modulus * slope  # MPa
loads = scale * np.geomspace(0.005, 0.8, 16)

# %%
options = {"contact_modulus": modulus, "periodic": True}
states = [solve_contact(surface, mean_pressure=load, **options) for load in loads]

area = np.array([state.corrected_fraction for state in states])
erf = [persson_contact_fraction(load, slope, modulus) for load in loads]
print(f"slope {slope:.3f}")
theories = f"theories: {PERSSON_SLOPE:.2f} and {BUSH_SLOPE:.2f}"
print(f"area over load at the lightest load: {area[0] / 0.005:.2f} ({theories})")
print(f"area at the highest load: {area[-1]:.4f}, Persson {erf[-1]:.4f}")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
left.loglog(loads / scale, area, ".-", label="gstlib.bem")
left.loglog(loads / scale, erf, "--", label="Persson")
left.loglog(
    loads / scale, np.minimum(BUSH_SLOPE * loads / scale, 1), ":", label="Bush et al."
)
left.set(xlabel="p̄/(E* h′)", ylabel="area in contact")
left.legend()
state = states[8]
state.pressure.where(state.contact).plot.imshow(ax=right)
right.set(title=f"at {state.mean_pressure:.0f} MPa", aspect="equal")
figure.savefig("area_and_load.png", dpi=120)
