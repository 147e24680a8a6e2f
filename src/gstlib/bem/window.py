"""Some elements of a grid: the half-space restricted to them, and its approximate inverse.

It uses NumPy's loops, not BLAS. BLAS starts unwanted threads, which spin when the machine is busy,
and the last bits of its sums depend on their number.
"""

import math

import numpy as np

from .convolution import EvenConvolution
from .halfspace import HalfSpace, inverse_padding

__all__ = ["Window", "dot"]

# If the elements fill less than this share of their bounding box, the short-range inverse is kept
# at the nearest offsets only (in elements, from the inverse on a separate grid). It takes an eighth
# of the time for as many iterations. Compact elements would need half as many again.
_SPARSE, _REACH, _INVERSE_GRID = 0.3, 2, 64
# Elements along the side of a cell of the coarse grid, a power of two (measured: 16 does as well).
_BLOCK = 8
# T assumes this share of the density that the contact sees around it (measured: 0.3 to 0.6 work).
_DENSITY = 0.5
# α starts here, and grows until a uniform displacement keeps this share of the pressure from M.
# (Measured: 0.33 to 0.4. With less, definiteness and the gain are lost.)
_LOCAL, _LOCAL_GROWTH, _KEPT = 2.0, 1.25, 0.4
# Prepared again when this share of the free elements has changed.
_STALE = 0.05


def dot(one, two):
    """Σ one·two over all elements."""
    return float(np.einsum("i,i->", one.reshape(-1), two.reshape(-1)))


class Window:
    """Operators between vectors of values on chosen elements. The others have no pressure.

    They work on the elements' bounding box, which costs less if contact is confined.

    The preconditioner takes a displacement to a pressure on the free elements that nearly has it
    there. At short range it is the half-space's approximate inverse M, restricted to these elements
    (Vollebregt, J. Optim. Theory Appl. 162 (2014) 936). M accounts for each island of contact, but
    not for all of them sinking together: the pressure φ r, with φ = M·1, should displace its
    surroundings by a smooth r. It displaces them by about α r, and also by Kφ̄r from afar, with φ̄
    the mean density of φ. φ r must therefore be divided by α + φ̄K. The excess is φ T φ r with T =
    (α K⁻¹ + φ̄)⁻¹. Except for φ it is smooth, and is computed on a coarse grid. We have not found a
    source for it.

    It was measured on rough surfaces (contact of 3 %, residual 1e-8 and 3e-10). It saves a quarter
    to two fifths of the iterations with M alone at 512² and 1024², and none to a quarter at 256².

    Parameters
    ----------
    half_space : HalfSpace
        The half-space of the whole grid.
    elements : ndarray of int, shape (n,)
        Flat indices in ascending order, at least one.

    Attributes
    ----------
    uniform : ndarray, shape (n,)
        Pressure for the displacement 1 on the free elements of the last `fit`.
    """

    def __init__(self, half_space, elements):
        self.half_space, self.elements = half_space, elements
        rows, columns = np.divmod(elements, half_space.shape[1])
        self._rows, self._columns = rows - rows.min(), columns - columns.min()
        self._extent = int(self._rows.max()) + 1, int(self._columns.max()) + 1
        # The half-space on the box, a field there that is zero elsewhere, and the elements'
        # indices.
        self._box = half_space.box(self._extent)
        self._field = np.zeros(self._box.shape)
        self._places = self._rows * self._box.shape[1] + self._columns
        self._free = None

    def exact_displacement(self, pressure):
        """Displacement (mm) of a pressure (MPa), in double precision."""
        return self._respond(HalfSpace.exact_displacement, pressure)

    def displacement(self, pressure):
        """The same within `APPROXIMATION_ERROR`."""
        return self._respond(HalfSpace.approximate_displacement, pressure)

    def _respond(self, operator, values):
        self._field.reshape(-1)[self._places] = values
        return operator(self._box, self._field).reshape(-1)[self._places].astype(float)

    def fit(self, free):
        """Prepare for a set of free elements (bool, shape (n,)), unless the last was similar."""
        if self._free is None:
            self._prepare()
        elif np.count_nonzero(free != self._free) <= _STALE * np.count_nonzero(free):
            return
        self._free = free
        profile = self._profile = self.short_range(free.astype(float)) * free
        density = self._mean(profile)
        density = _DENSITY * dot(density, density) * _BLOCK**2 / profile.sum()
        while True:
            spectrum = self._spectrum / (self._local + density * self._spectrum)
            self._far = EvenConvolution(self._coarse, spectrum, np.float64)
            self.uniform = profile - self._from_afar(free)
            # NaN ends the search, too, and the solver's residual then shows it.
            if not self.uniform.sum() < _KEPT * profile.sum():
                return
            self._local *= _LOCAL_GROWTH

    def precondition(self, displacement):
        """Pressure (MPa), shape (n,), from a displacement (mm) that is zero on fixed elements."""
        return self.short_range(displacement) - self._from_afar(displacement)

    def short_range(self, displacement):
        """M alone: slower, but positive definite for certain."""
        if self._stencil is None:
            return self._respond(HalfSpace.approximate_inverse, displacement)
        self._padded[self._inner + self._centre] = displacement
        pressure = np.zeros(displacement.size)
        for start, weight in self._stencil:
            pressure += weight * self._padded[start:].take(self._inner)
        return pressure

    def _prepare(self):
        """What does not depend on the free elements."""
        ny, nx = self._extent
        self._stencil = None
        if self.elements.size < _SPARSE * ny * nx:
            self._stencil = self._prepare_stencil(ny, nx)
        # T, on cells of several elements: Love's kernel grows in proportion to its elements.
        self._coarse = -(-ny // _BLOCK), -(-nx // _BLOCK)
        first_cell = self._rows // _BLOCK * self._coarse[1]
        self._cells = first_cell + self._columns // _BLOCK
        coarse = self.half_space.on(self._coarse, coarsening=_BLOCK)
        self._spectrum = coarse.spectrum(inverse_padding(self._coarse))
        self._local = _LOCAL

    def _prepare_stencil(self, ny, nx):
        """Indices and weights of the inverse's nearest offsets, in a field with a margin."""
        inverse = 1 / self.half_space.spectrum((_INVERSE_GRID, _INVERSE_GRID))
        inverse = np.fft.irfft2(np.concatenate((inverse, inverse[-2:0:-1])))
        # The margin provides each neighbour of an element.
        width = nx + 2 * _REACH
        self._padded = np.zeros((ny + 2 * _REACH) * width)
        self._inner = self._rows * width + self._columns
        self._centre = _REACH * width + _REACH
        offsets = range(-_REACH, _REACH + 1)
        return [
            (self._centre + i * width + j, float(inverse[i, j]))
            for i in offsets
            for j in offsets
            if i * i + j * j <= _REACH**2 + 1
        ]

    def _from_afar(self, displacement):
        """φ T φ r."""
        far = self._far(self._mean(self._profile * displacement))
        return self._profile * far.reshape(-1)[self._cells]

    def _mean(self, values):
        """Mean over the elements of each cell, with zero outside the window."""
        sums = np.bincount(self._cells, values, minlength=math.prod(self._coarse))
        return sums.reshape(self._coarse) / _BLOCK**2
