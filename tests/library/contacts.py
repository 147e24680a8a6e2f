"""Contacts for tests: solved in one line, or with a state that the test says; and tables."""

import io

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import Contact, Interface, Load, contact_at_pressure
from gstlib.surfaces.grid import axis_coordinates, make_surface, spacing_of
from gstlib.surfaces.leveling import Plane, remove_plane


def around(heights, spacing, shift):
    """A face in the coordinates of its square, whose corner lies `shift` mm from the face's."""
    face = make_surface(heights, spacing)
    return face.assign_coords(
        {axis: face[axis].copy(data=face[axis] - shift) for axis in "yx"}
    )


def rough(seed, shape=(24, 32), spacing=0.01, rms_mm=0.002):
    """A surface whose heights are independent of each other."""
    heights = np.random.default_rng(seed).standard_normal(shape)
    return make_surface(rms_mm * heights, spacing)


def tiles(side):
    """Four patches that tile a square."""
    near, far = side / 4, 3 * side / 4
    places = {"x_mm": [near, far, near, far], "y_mm": [near, near, far, far]}
    return pd.DataFrame({"patch": list("abcd")} | places | {"rotation_deg": 0.0})


def mesh_face(height, error, vertices, seed):
    """A face as the mesh gives it, whose left-out vertices err by `error` (mm, r.m.s.)."""
    rng, size = (
        np.random.default_rng(seed),
        float(height.sizes["x"] * spacing_of(height)[1]),
    )
    height.attrs["mesh_edge_mm"] = 1.5 * spacing_of(height)[1]
    y, x = rng.uniform(0, size, (2, vertices))
    errors = error * rng.standard_normal(vertices)
    numbers = {"vertex_y": y, "vertex_x": x, "left_out_error": errors}
    fields = {name: ("vertex", values) for name, values in numbers.items()}
    return xr.Dataset(
        {"height": height, "counterface": 0 * height, "size_mm": size} | fields
    )


def laid(function, place, size, points):
    """A field of y and x on a patch, at its points, without its plane; and that plane."""
    along = axis_coordinates(points, size / points) - size / 2
    heights = function(*place.points(along[:, None], along))
    return remove_plane(make_surface(heights, size / points))


def interface(height, counterface=None, slopes=(0.0, 0.0), surroundings=None):
    """Two faces (mm), the upper one a flat if there is none."""
    over = xr.zeros_like(height) if counterface is None else counterface
    return Interface(height, over, Plane(0.0, *slopes), surroundings)


def pressed(
    height,
    counterface=None,
    *,
    mean_pressure,
    load_point=None,
    modulus=1e4,
    tolerance=1e-8,
):
    """The contact of two faces (mm) at a mean pressure (MPa)."""
    settings = {"modulus": modulus, "tolerance": tolerance, "source": "test"}
    load = Load(mean_pressure, load_point)
    return contact_at_pressure(interface(height, counterface), load, **settings)


def contact_of(height, pressure, displacement=0.0):
    """A contact of a surface (mm) that was not solved, but has this pressure (MPa).

    The faces touch where there is pressure and are 1 µm apart elsewhere.
    """
    touching, mean = pressure > 0, float(pressure.mean())
    return Contact(
        interface=interface(height),
        load=Load(mean),
        modulus=1e4,
        tolerance=1e-9,
        pressure=height.copy(data=pressure),
        gap=height.copy(data=1e-3 * ~touching),
        displacement=displacement,
        mean_pressure=mean,
        contact_fraction=float(touching.mean()),
    )


def written(text):
    """A table as it is written in CSV; an empty cell is not known."""
    return pd.read_csv(io.StringIO(text), dtype={"patch": str}, skipinitialspace=True)
