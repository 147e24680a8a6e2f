# %% [markdown]
"""A scanned patch, pressed against a flat. If `rough_patch.plu` is missing, it is generated.

To use your own scan, replace this file or change its name below. Any format that states its unit
and spacing will do.
"""

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from gstlib.bem import contact_modulus, load_path
from gstlib.bem.closed_forms import BUSH_SLOPE, PERSSON_SLOPE
from gstlib.io.plu import write_plu
from gstlib.io.scans import read_scan
from gstlib.preprocess.scans import prepare_scan
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import spacing_of

file = Path("rough_patch.plu")
if not file.exists():  # self-affine, 0.85 mm wide, with an r.m.s. height of 2 µm
    waves = {"hurst_exponent": 0.8, "roll_off": 0.2, "shortest": 0.02}  # lengths in mm
    rough = self_affine_field(np.random.default_rng(1), 512, 0.00166, **waves)
    write_plu(file, 0.002 * rough / rough.std(), 0.00166)

# %%
# This levels the scan and fills holes and outliers. For a mould: mould_invert=True, mould_flip="x".
height = prepare_scan(read_scan(file)).height
modulus = contact_modulus(19500, 0.24, 19500, 0.24)  # MPa
path = load_path(height, contact_modulus=modulus, target_pressure=22.0, steps=12)

# Theories of rough contact predict the area A under small loads: A/A₀ = κ p/(E* h′), with the
# r.m.s. slope h′, and κ = √(8/π) (Persson) or √(2π) (Bush, Gibson and Thomas).
steps = [np.diff(height.values, axis=axis) for axis in (0, 1)]
slope = np.sqrt(sum((step**2).mean() for step in steps)) / spacing_of(height)[0]
load = path.mean_pressure / (modulus * slope)
print(f"contact: {100 * path.contact_fraction[-1]:.2f} % of the patch")
print(f"highest pressure: {float(path.final.pressure.max()):.0f} MPa")
theories = f"{PERSSON_SLOPE:.2f} and {BUSH_SLOPE:.2f}"
print(f"kappa: {path.contact_fraction[-1] / load[-1]:.2f} (theories: {theories})")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
left.imshow(height.values * 1e3, cmap="gray", origin="lower")
left.contour(path.final.contact, [0.5], colors="tab:red", linewidths=0.8)
left.set(title="height and edges of contact", xticks=[], yticks=[])
right.plot(100 * load, 100 * path.contact_fraction, ".-", label="gstlib.bem")
right.plot(100 * load, 100 * PERSSON_SLOPE * load, "--", label="Persson")
right.plot(100 * load, 100 * BUSH_SLOPE * load, ":", label="Bush, Gibson and Thomas")
right.set(xlabel="p/(E* h′)  (%)", ylabel="contact  (%)")
right.legend()
figure.savefig("rough_patch.png", dpi=120)
