"""Contacts for tests: solved in one line, or with a state that the test says."""

import numpy as np
from gstlib.contact import Loading, contact_at_pressure, faces_of


def pressed(height, counterface=None, **loading):
    """Two faces (mm) pressed on each other; `loading` is that of `Loading`."""
    faces = faces_of(height, counterface)
    return contact_at_pressure(faces, Loading(**loading), source="test")


def contact_of(height, pressure, gap=None, displacement=0.0, slopes=(0.0, 0.0)):
    """A contact of a surface (mm) that was not solved: its pressure (MPa) and gap (mm) are given.

    Without a gap, the faces touch where there is pressure and are 1 µm apart elsewhere.
    """
    pressure = np.broadcast_to(np.asarray(pressure, dtype=float), height.shape)
    touching = pressure > 0
    gap = 1e-3 * ~touching if gap is None else np.broadcast_to(gap, height.shape)
    mean = float(pressure.mean())
    return faces_of(height, slopes=slopes).assign(
        pressure=height.copy(data=pressure),
        gap=height.copy(data=gap),
        displacement=displacement,
        mean_pressure=mean,
        contact_fraction=float(touching.mean()),
        residual=0.0,
        contact_modulus=1e4,
        target_pressure=mean,
        tolerance=1e-9,
        through_y=np.nan,
        through_x=np.nan,
    )
