# %% [markdown]
"""Contact of a rough surface, from a hundredth of its area to nearly all of it."""

# %%
import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import contact_modulus, load_path, measure_roughness
from gstlib.bem.closed_forms import (
    BUSH_SLOPE,
    PERSSON_SLOPE,
    GreenwoodWilliamson,
    persson_contact_fraction,
    persson_pressure_density,
)
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface

n, side = 256, 0.85  # elements, mm
waves = {"hurst_exponent": 0.8, "roll_off": 0.2, "shortest": 0.03}  # lengths in mm
rough = self_affine_field(np.random.default_rng(3), n, side / n, **waves)
surface = make_surface(0.002 * rough / rough.std(), side / n)

modulus = contact_modulus(19500, 0.24, 19500, 0.24)  # MPa
numbers = measure_roughness(surface, periodic=True)
scale = modulus * numbers.slope  # MPa
loads = scale * np.geomspace(0.005, 0.8, 16)

# %%
options = {"contact_modulus": modulus, "periodic": True, "keep_states": True}
path = load_path(surface, target_pressure=loads, **options)

area = np.array([state.corrected_fraction for state in path.states])
erf = [persson_contact_fraction(load, numbers.slope, modulus) for load in loads]
print(f"slope {numbers.slope:.3f}, Nayak's parameter {numbers.nayak:.1f}")
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
summits = GreenwoodWilliamson.from_roughness(numbers, modulus)
above = summits.height * np.linspace(1.5, 0)  # the mean of the summits, mm
spheres = summits.mean_pressure(above) / scale, summits.contact_fraction(above)
left.loglog(*spheres, "-.", label="Greenwood and Williamson")
left.set(xlabel="p̄/(E* h′)", ylabel="area in contact")
left.legend()
state = path.states[8]
pressure, density = state.distribution("pressure")
theory = persson_pressure_density(pressure, state.mean_pressure, numbers.slope, modulus)
right.plot(pressure, density, ".", label=f"at {state.mean_pressure:.0f} MPa")
right.plot(pressure, theory, "--", label="Persson")
right.set(xlabel="pressure (MPa)", ylabel="density (1/MPa)")
right.legend()
figure.savefig("area_and_load.png", dpi=120)
