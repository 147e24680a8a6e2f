"""Some elements of a grid, and the half-space as they alone feel it."""

import numpy as np

from .elements import Elements

__all__ = ["APPROXIMATION_ERROR", "Window"]

# Relative error of an approximate displacement, of the largest (measured: below it on grids of
# 33 x 70 to 1024 x 1024, for noise, for sparse contact and for uniform pressure; it only says when
# to look again, exactly).
APPROXIMATION_ERROR = 3e-6


class Window:
    """Operators between vectors of values on chosen elements; the others have no pressure.

    They work on the elements' bounding box, which costs less where contact is confined.

    Parameters
    ----------
    half_space : HalfSpace
        That of the whole grid.
    elements : ndarray of int, shape (n,)
        Flat indices in ascending order, at least one.
    """

    def __init__(self, half_space, elements):
        rows, columns = np.divmod(elements, half_space.shape[1])
        rows, columns = rows - rows.min(), columns - columns.min()
        self._half_space = half_space.window((rows.max() + 1, columns.max() + 1))
        self._elements = Elements(rows, columns)
        self.shape = self._half_space.shape
        self.kernel = half_space.kernel
        self.self_influence = half_space.self_influence

    def exact_displacement(self, pressure):
        """Displacement (mm) of a pressure (MPa), in double precision."""
        return self._half_space.exact_displacement(pressure, self._elements)

    def displacement(self, pressure):
        """The same within `APPROXIMATION_ERROR`."""
        return self._half_space.approximate_displacement(pressure, self._elements)

    def pressure(self, displacement):
        """Approximate pressure (MPa) that has the displacement (mm)."""
        return self._half_space.approximate_inverse(displacement, self._elements)

    def cells(self, block):
        """Cell of each element, flat, on a grid of `block` times `block` elements; its shape."""
        shape = tuple(-(-n // block) for n in self.shape)
        return self._elements.rows // block * shape[1] + self._elements.columns // block, shape
