"""The one underlying surface that mesh and scans see, each at its own resolution.

Everything is in the square's frame: origin in the reference corner, x and y along its edges, mm.
The surface has two parts. The *macroscale surface* holds the wavelengths above the cut-off and the
smooth shape of the use-face; it exists all over the pebble. The *detail* holds the wavelengths
below the cut-off; it exists on the square and a margin, at the spacing of the scans.
"""

from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.interpolate
import scipy.ndimage

from gstlib.specimen.parameters import SpecimenParameters
from gstlib.specimen.pebble import Pebble
from gstlib.specimen.randomness import self_affine_field, stream

__all__ = ["Stone", "fit_plane", "make_stone"]

# Points per shortest wavelength on the grid of the macroscale part: a cubic spline through so many
# is right to about 1e-3 of the shortest waves' height.
_POINTS_PER_WAVE = 6
# Points of the macroscale grid beyond the crop on which it is interpolated, so that the spline's
# end conditions have died out where it is used.
_SPLINE_PAD = 16
# Grid (points a side) on which the r.m.s. of the macroscale part over the square is taken.
_CALIBRATION_POINTS = 200
_SUBSAMPLES = 5


def fit_plane(heights: np.ndarray, y: np.ndarray, x: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Least-squares plane of a full grid of heights.

    Parameters
    ----------
    heights : (ny, nx) ndarray
    y, x : (ny,), (nx,) ndarray
        Positions of rows and columns.

    Returns
    -------
    slope_y, slope_x : float
        Slopes of the plane.
    plane : (ny, nx) ndarray
        The plane's heights.
    """
    v, u = y - y.mean(), x - x.mean()
    # positions are centred, so that mean and slopes are independent of each other
    slope_y = float(v @ heights.mean(axis=1) / (v @ v))
    slope_x = float(heights.mean(axis=0) @ u / (u @ u))
    return slope_y, slope_x, heights.mean() + slope_y * v[:, None] + slope_x * u[None, :]


@dataclass(frozen=True)
class Stone:
    """Heights of the unworn stone.

    Attributes
    ----------
    square_mm : float
        Side of the analysed square.
    pebble : Pebble
        Smooth shape; its centre is the square's.
    waviness : (m, m) ndarray
        Cubic spline coefficients (mm) of the waves above the cut-off, periodic; element m // 2 is
        at the square's centre.
    waviness_samples : (m, m) ndarray
        The same waves at the grid's own points, mm.
    waviness_spacing : float
        Spacing of that grid, mm.
    detail : (n, n) ndarray of float32
        Waves below the cut-off, mm, at `start` + k `spacing` along y and x.
    start, spacing : float
        First point and spacing of the grid of `detail`, mm.
    """

    square_mm: float
    pebble: Pebble
    waviness: np.ndarray
    waviness_samples: np.ndarray
    waviness_spacing: float
    detail: np.ndarray
    start: float
    spacing: float

    def grid(self) -> np.ndarray:
        """Positions (mm) of the rows, and of the columns, of the grid of `detail`."""
        return self.start + np.arange(len(self.detail)) * self.spacing

    def waves(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Waves above the cut-off (mm) at any places (y, x) in mm, without the pebble's shape."""
        centre = len(self.waviness) // 2
        places = [
            (np.asarray(position) - self.square_mm / 2) / self.waviness_spacing + centre
            for position in (y, x)
        ]
        return scipy.ndimage.map_coordinates(
            self.waviness, places, order=3, mode="grid-wrap", prefilter=False
        )

    def macroscale(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """The macroscale surface (mm) on the grid of rows `y` and columns `x`, near the square.

        Parameters
        ----------
        y, x : (ny,), (nx,) ndarray
            Positions in mm, increasing.

        Returns
        -------
        (ny, nx) ndarray
        """
        centre = len(self.waviness) // 2
        crops = []
        for positions in (y, x):
            ends = (np.array([positions[0], positions[-1]]) - self.square_mm / 2) / (
                self.waviness_spacing
            )
            low, high = np.floor(ends[0]) - _SPLINE_PAD, np.ceil(ends[1]) + _SPLINE_PAD
            crops.append(np.arange(int(low), int(high) + 1))
        rows, columns = crops
        nodes_y, nodes_x = (c * self.waviness_spacing + self.square_mm / 2 for c in crops)
        heights = self.waviness_samples.take(rows + centre, axis=0, mode="wrap").take(
            columns + centre, axis=1, mode="wrap"
        ) + self.shape(nodes_y[:, None], nodes_x[None, :])
        return scipy.interpolate.RectBivariateSpline(nodes_y, nodes_x, heights)(y, x)

    def shape(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Smooth shape of the use-face (mm) at (y, x) in mm."""
        # the frame is the mesh's turned by half a turn about the square's centre
        return self.pebble.use_face(self.square_mm / 2 - x, self.square_mm / 2 - y)

    def macroscale_means(self, count: int) -> np.ndarray:
        """The macroscale surface (mm) averaged over each of `count`² elements of the square.

        Returns
        -------
        (count, count) ndarray
        """
        fine = count * _SUBSAMPLES
        places = (np.arange(fine) + 0.5) * (self.square_mm / fine)
        heights = self.macroscale(places, places)
        return heights.reshape(count, _SUBSAMPLES, count, _SUBSAMPLES).mean(axis=(1, 3))


def make_stone(parameters: SpecimenParameters, square_mm: float) -> Stone:
    """Draw the stone that `parameters` and their seed describe.

    One factor scales macroscale waves and detail alike, so that the macroscale part has the asked
    r.m.s. on the square and the spectrum goes on without a step.
    """
    # ASSUME: an isotropic Gaussian self-affine surface; a real stone has grains and pits besides.
    p = parameters
    pebble = Pebble(tuple(p.outer_size_mm), p.concavity_mm)
    spectrum = {"hurst_exponent": p.hurst_exponent, "roll_off": p.roll_off_wavelength_mm}

    waviness_spacing = p.cut_off_wavelength_mm / _POINTS_PER_WAVE
    longest_side = max(*p.outer_size_mm[:2], 2 * (square_mm + p.margin_mm))
    count = scipy.fft.next_fast_len(int(np.ceil(longest_side / waviness_spacing)), real=True)
    waves = self_affine_field(
        stream(p.seed, "stone", "macroscale"),
        count,
        waviness_spacing,
        shortest=p.cut_off_wavelength_mm,
        **spectrum,
    ).astype(float)

    extent = square_mm + 2 * p.margin_mm
    points = scipy.fft.next_fast_len(int(np.ceil(extent / p.scan_spacing_mm)) + 1, real=True)
    detail = self_affine_field(
        stream(p.seed, "stone", "detail"),
        points,
        p.scan_spacing_mm,
        longest=p.cut_off_wavelength_mm,
        shortest=p.shortest_wavelength_mm,
        **spectrum,
    )
    coefficients = scipy.ndimage.spline_filter(waves, order=3, mode="grid-wrap")
    start = square_mm / 2 - (points - 1) / 2 * p.scan_spacing_mm
    unscaled = Stone(
        square_mm, pebble, coefficients, waves, waviness_spacing, detail, start, p.scan_spacing_mm
    )
    factor = p.macroscale_rms_um * 1e-3 / _waves_rms(unscaled)
    detail *= np.float32(factor)
    return Stone(
        square_mm,
        pebble,
        coefficients * factor,
        waves * factor,
        waviness_spacing,
        detail,
        start,
        p.scan_spacing_mm,
    )


def _waves_rms(stone: Stone) -> float:
    """R.m.s. of the waves above the cut-off on the square, their plane removed."""
    places = (np.arange(_CALIBRATION_POINTS) + 0.5) * (stone.square_mm / _CALIBRATION_POINTS)
    y, x = np.meshgrid(places, places, indexing="ij")
    heights = stone.waves(y, x)
    return float(np.std(heights - fit_plane(heights, places, places)[2]))
