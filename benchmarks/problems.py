"""The surfaces on which codes are compared, and how runners of any interpreter get them."""

from typing import NamedTuple

import numpy as np

from gstlib.specimen.randomness import self_affine_field, stream

# Side of the patch (mm) and contact modulus (MPa) of the study.
LENGTH = 0.85
MODULUS = 12820.0
# r.m.s. height (mm), Hurst exponent, roll-off wavelength (mm), cut-off wavelength (elements).
RMS, HURST, ROLL_OFF, CUT_OFF = 0.005, 0.8, 0.2, 4
# Radius of the sphere (mm): at 76 MPa about an eighth of the patch is in contact.
RADIUS = 1.5


class Surface(NamedTuple):
    """A surface on n × n elements of one patch, alone or `periodic`: repeated without end.

    `kind` "rough": self-affine, the same statistics at every n but for the cut-off, which stays at
    four *elements*: a finer grid shows finer roughness, so that the contact breaks up further and
    the problem grows harder as well as larger. With another `cut_off`, in elements, that can be
    told apart. "sphere": a paraboloid.
    """

    kind: str
    size: int
    seed: int = 0
    cut_off: int = CUT_OFF
    periodic: bool = False

    @property
    def spacing(self):
        return LENGTH / self.size

    def heights(self):
        """Heights (mm), float64, shape (size, size)."""
        if self.kind == "sphere":
            at = (np.arange(self.size) - (self.size - 1) / 2) * self.spacing
            return -(at[:, None] ** 2 + at**2) / (2 * RADIUS)
        field = self_affine_field(
            stream(self.seed, "benchmark"),
            self.size,
            self.spacing,
            hurst_exponent=HURST,
            roll_off=ROLL_OFF,
            shortest=self.cut_off * self.spacing,
        ).astype(float)
        return (field - field.mean()) * (RMS / field.std())

    def store(self, path):
        """Write the problem to an npz, which runners read."""
        np.savez(
            path,
            heights=self.heights(),
            spacing=self.spacing,
            contact_modulus=MODULUS,
            periodic=self.periodic,
        )
