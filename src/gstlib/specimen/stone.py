"""The stone before and after use: the surface of mesh and scans, and its wear.

All coordinates are in the frame of the square: origin in the reference corner, x and y along its
edges, mm. The surface has two parts. The *macroscale surface* contains the wavelengths above the
cut-off and the smooth shape of the use-face, all over the pebble. The *detail* contains the
wavelengths below the cut-off, on the square and a margin, at the spacing of the scans.

Use has three effects. It flattens summits, more so at high places of the macroscale surface, but
partly at random. Chips break out, more of them in the same regions. Grit between the stones removes
material anywhere, in valleys and on summits. If these overlap, the deepest counts.
"""

import functools

import numpy as np
import scipy
import xarray as xr

from gstlib.specimen.pebble import (
    OUTER_SIZE_MM,
    even_triangulation,
    rim_distance_squared,
    use_face,
)
from gstlib.specimen.randomness import (
    ROLL_OFF_MM,
    SpecimenParameters,
    self_affine_field,
    smooth_field,
    stream,
)
from gstlib.surfaces.grid import axis_coordinates, make_surface
from gstlib.surfaces.leveling import remove_plane

__all__ = ["MARGIN_MM", "Stone", "block_means", "surface_at"]

# Width of the margin of detail around the square, for misplaced scans at its edge.
MARGIN_MM = 0.25
# Points per shortest wavelength on the grid of the macroscale part. A cubic spline through them has
# an error of about 1e-3 of the height of the shortest waves.
_POINTS_PER_WAVE = 6
# Points of the macroscale grid beyond the crop for the interpolation. The end conditions of the
# spline decay before the crop.
_SPLINE_PAD = 16
# Grid (points per side) for the r.m.s. of the macroscale part over the square.
_CALIBRATION_POINTS = 200
# Points a side for the mean of the true macroscale surface in an element.
_SUBSAMPLES = 5
# The waves of the mesh fade out between these distances from the centre (1 is the rim). At the rim
# the surface turns over, and a height above the plane of the use-face has no meaning.
_FADE_FROM, _FADE_TO = 0.8, 0.97

# ASSUME: Wear by rules. The three rules of wear and their sizes are choices of this project, and
# they do not use contact. Reason: The paper shows traces but does not measure them, and the score
# of a predicted contact against these rules is not circular.

# R.m.s. of the noise added to the macroscale height for the severity of wear (a good third of the
# r.m.s. height), and the length over which the noise varies.
_CHANCE_UM, _CHANCE_LENGTH_UM = 5.0, 250.0
# Points of the coarse grid per length over which the severity varies.
_POINTS_PER_LENGTH = 8
# Severity falls from 3/4 to 1/4 over about twice this fraction of the spread of this sum.
_SOFTNESS = 0.25
# Summits are heights above the stone smoothed by a Gaussian with this standard deviation. They are
# cut at this many r.m.s. heights above it, at full severity and at none (then hardly ever).
_REFERENCE_LENGTH_UM = 250.0
_FULL_SIGMA, _UNWORN_SIGMA = 1.0, 3.5
# Chips: number per area at full severity, median radius, depth over radius, spread of the radii
# (standard deviation of their logarithm), and largest radius over the median radius.
_CHIPS_PER_MM2, _CHIP_RADIUS_UM, _CHIP_DEPTH_FRACTION = 40.0, 15.0, 0.15
_CHIP_SPREAD, _CHIP_LARGEST = 0.4, 3.0
# Loss at any height: fraction of the area, greatest depth, length over which it varies.
_VALLEY_FRACTION, _VALLEY_DEPTH_MM, _VALLEY_SIZE_MM = 0.02, 2e-3, 40e-3


class Stone:
    """The stone described by `parameters` and their seed, drawn when it is made.

    Attributes
    ----------
    parameters : SpecimenParameters
    square_mm : float
        Side of the analysed square, in the centre of the pebble.
    waviness : (m, m) ndarray
        Waves above the cut-off, mm, periodic; element m // 2 is at the centre of the square.
    waviness_spacing : float
        Spacing of their grid, mm.
    detail : (n, n) ndarray of float32
        Waves below the cut-off, mm, at the positions `grid` along y and x.
    grid : (n,) ndarray
        Positions, mm, `spacing` apart.
    """

    def __init__(self, parameters: SpecimenParameters, square_mm: float):
        # ASSUME: Surface of the stone. The stone has an isotropic Gaussian self-affine surface.
        # Reason: Its spectrum has few parameters. Alternative: Grains and pits, as on a real stone,
        # could be added.
        p = self.parameters = parameters
        self.square_mm = square_mm
        self.spacing = p.scan_spacing_mm
        self._spectrum = {"hurst_exponent": p.hurst_exponent, "roll_off": ROLL_OFF_MM}

        self.waviness_spacing = p.cut_off_wavelength_mm / _POINTS_PER_WAVE
        longest_side = max(*OUTER_SIZE_MM[:2], 2 * (square_mm + MARGIN_MM))
        count = int(np.ceil(longest_side / self.waviness_spacing))
        waves = self_affine_field(
            stream(p.seed, "stone", "macroscale"),
            scipy.fft.next_fast_len(count, real=True),
            self.waviness_spacing,
            shortest=p.cut_off_wavelength_mm,
            **self._spectrum,
        ).astype(float)

        count = int(np.ceil((square_mm + 2 * MARGIN_MM) / self.spacing)) + 1
        points = scipy.fft.next_fast_len(count, real=True)
        first = square_mm / 2 - (points - 1) / 2 * self.spacing
        self.grid = first + np.arange(points) * self.spacing
        self.detail = self_affine_field(
            stream(p.seed, "stone", "detail"),
            points,
            self.spacing,
            longest=p.cut_off_wavelength_mm,
            shortest=p.shortest_wavelength_mm,
            **self._spectrum,
        )

        # One factor scales waves and detail alike. The waves get the required r.m.s. on the square,
        # and the spectrum has no step at the cut-off.
        self._spline = scipy.ndimage.spline_filter(waves, order=3, mode="grid-wrap")
        step = square_mm / _CALIBRATION_POINTS
        places = axis_coordinates(_CALIBRATION_POINTS, step)
        level, _ = remove_plane(make_surface(self.waves(places[:, None], places), step))
        factor = p.macroscale_rms_um * 1e-3 / level.values.std()
        self.waviness = waves * factor
        self._spline *= factor
        self.detail *= np.float32(factor)
        self._factor = factor

    @functools.cached_property
    def heights(self) -> np.ndarray:
        """The whole true surface before use (n, n), mm, float32, on the grid of `detail`."""
        return (self.macroscale(self.grid) + self.detail).astype(np.float32)

    def waves(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Waves above the cut-off (mm) at positions (y, x) in mm, without the pebble's shape."""
        off_middle = np.array(np.broadcast_arrays(y, x)) - self.square_mm / 2
        places = off_middle / self.waviness_spacing + len(self._spline) // 2
        return scipy.ndimage.map_coordinates(
            self._spline, places, order=3, mode="grid-wrap", prefilter=False
        )

    def macroscale(self, along: np.ndarray) -> np.ndarray:
        """The macroscale surface (n, n), mm, at increasing positions along both axes, mm."""
        middle = self.square_mm / 2
        first, last = (along[[0, -1]] - middle) / self.waviness_spacing
        nodes = np.arange(
            np.floor(first) - _SPLINE_PAD, np.ceil(last) + _SPLINE_PAD + 1
        )
        count = len(self.waviness)
        elements = (nodes.astype(int) + count // 2) % count
        nodes = nodes * self.waviness_spacing + middle
        heights = self.waviness[np.ix_(elements, elements)]
        heights += self.shape(nodes[:, None], nodes)
        spline = scipy.interpolate.RectBivariateSpline(nodes, nodes, heights)
        return spline(along, along)

    def shape(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Smooth shape of the use-face (mm) at (y, x) in mm."""
        # This frame is the frame of the mesh turned by half a turn about the centre of the square.
        return use_face(self.square_mm / 2 - x, self.square_mm / 2 - y)

    def macroscale_means(self, count: int, around: int = 0) -> np.ndarray:
        """The macroscale surface (mm) averaged over the elements of the face, as `face_means`."""
        element = self.square_mm / count
        fine = (count + 2 * around) * _SUBSAMPLES
        places = axis_coordinates(fine, element / _SUBSAMPLES) - around * element
        return block_means(self.macroscale(places), _SUBSAMPLES)

    def face_means(self, count: int, around: int) -> np.ndarray:
        """The true surface (mm), all waves, averaged over the elements of the face.

        The square has (count, count) elements, and the face `around` more on each side. Beyond the
        margin of the square, the detail is a field of its own, with the waves that two points
        resolve.
        """
        # ASSUME: Short waves outside the square. The face outside the square does not contain waves
        # shorter than two fifths of an element. Reason: The macroscale contact uses means over
        # elements.
        step = self.square_mm / count / _SUBSAMPLES
        fine = (count + 2 * around) * _SUBSAMPLES
        points = scipy.fft.next_fast_len(fine, real=True)
        detail = self._factor * self_affine_field(
            stream(self.parameters.seed, "stone", "face"),
            points,
            step,
            longest=self.parameters.cut_off_wavelength_mm,
            shortest=2 * step,
            **self._spectrum,
        )
        means = block_means(detail[:fine, :fine], _SUBSAMPLES)
        limits = np.arange(count + 1) * self.square_mm / count
        edges = np.searchsorted(self.grid, limits)
        square, points = slice(edges[0], edges[-1]), np.diff(edges)
        sums = self.detail[square, square].astype(float)
        for axis in (0, 1):
            sums = np.add.reduceat(sums, edges[:-1] - edges[0], axis=axis)
        inside = slice(around, around + count)
        means[inside, inside] = sums / np.outer(points, points)
        return self.macroscale_means(count, around) + means

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Closed mesh of the stone, as if made by photogrammetry.

        Vertices (n, 3), mm, and faces (m, 3), anticlockwise as seen from outside. The use-face
        points along +z, and the square is centred on x = y = 0.
        """
        p = self.parameters
        vertices, faces, upper = even_triangulation(p.mesh_edge_mm)
        x, y, _ = vertices.T
        rim_distance = np.sqrt(rim_distance_squared(x, y))
        along = np.clip((_FADE_TO - rim_distance) / (_FADE_TO - _FADE_FROM), 0, 1)
        fade = along**2 * (3 - 2 * along)
        # The underside has the waves half a period away, and its heights point down.
        offset = np.where(upper, 0.0, len(self.waviness) * self.waviness_spacing / 2)
        middle = self.square_mm / 2
        waves = self.waves(middle - y + offset, middle - x + offset)
        # ASSUME: Photogrammetry. Photogrammetry is a sharp low-pass at the cut-off, plus white
        # noise in height. Reason: A mesh does not resolve shorter waves, and the paper does not
        # state the errors of its mesh.
        noise = stream(p.seed, "mesh").normal(
            0.0, p.mesh_noise_um * 1e-3, len(vertices)
        )
        vertices[:, 2] += fade * np.where(upper, waves, -waves)
        vertices[:, 2] += fade * noise
        return vertices, faces

    def worn_by_rules(self) -> np.ndarray:
        """Depth of the material lost between T0 and T1, mm, float32, on the grid of `detail`."""
        p = self.parameters
        points = len(self.grid)
        step = max(1, int(_CHANCE_LENGTH_UM / _POINTS_PER_LENGTH / p.scan_spacing_um))
        spacing = step * self.spacing
        steps = np.arange(-(-(points - 1) // step) + 1)
        coarse = self.grid[0] + steps * step * self.spacing
        level, _ = remove_plane(make_surface(self.macroscale(coarse), spacing))
        height = level.values

        # High places are only more likely to be worn.
        generator = stream(p.seed, "wear", "severity")
        chance = smooth_field(generator, len(height), spacing, _CHANCE_LENGTH_UM * 1e-3)
        decides = height + chance * _CHANCE_UM * 1e-3
        threshold = np.quantile(decides, 1 - p.wear_fraction)
        excess = (decides - threshold) / (_SOFTNESS * decides.std())
        severity = 1 / (1 + np.exp(-excess))

        # A summit is higher than the smoothed stone; the more severe the wear, the deeper the cut.
        smoothing = _REFERENCE_LENGTH_UM * 1e-3 / spacing
        waves = height - scipy.ndimage.gaussian_filter(
            height, smoothing, mode="nearest"
        )
        sigma = float(np.hypot(waves.std(), self.detail.std()))
        cut = sigma * (_UNWORN_SIGMA - (_UNWORN_SIGMA - _FULL_SIGMA) * severity)
        left = (cut - waves).astype(np.float32)
        depth = self.detail - _bilinear(left, np.arange(points) / step)
        np.maximum(depth, 0, out=depth)

        generator = stream(p.seed, "wear", "valleys")
        field = smooth_field(generator, points, self.spacing, _VALLEY_SIZE_MM)
        level = np.quantile(field[::4, ::4], 1 - _VALLEY_FRACTION)
        peak = max(float(field.max()) - level, np.finfo(np.float32).tiny)
        loss = np.sqrt(np.clip((field - level) / peak, 0, 1)) * _VALLEY_DEPTH_MM
        np.maximum(depth, loss, out=depth)

        self._break_chips(depth, severity, step)
        return depth

    def _break_chips(self, depth: np.ndarray, severity: np.ndarray, step: int) -> None:
        """Deepen `depth` by paraboloid pits; their number follows the severity, every `step`."""
        count = len(depth)
        generator = stream(self.parameters.seed, "wear", "chips")
        tried = generator.poisson(_CHIPS_PER_MM2 * (count * self.spacing) ** 2)
        places = generator.random((tried, 2)) * count
        spread = np.exp(_CHIP_SPREAD * generator.standard_normal(tried))
        radii_um = _CHIP_RADIUS_UM * np.minimum(spread, _CHIP_LARGEST)
        radii = radii_um / self.parameters.scan_spacing_um
        severity_there = severity[tuple((places / step).astype(int).T)]
        kept = generator.random(tried) < severity_there
        for centre, radius in zip(places[kept], radii[kept], strict=True):
            point, reach = centre.astype(int), int(radius) + 1
            low = np.maximum(point - reach, 0)
            high = np.minimum(point + reach + 2, count)
            window = tuple(map(slice, low, high))
            v, u = np.ogrid[window]
            bowl = 1 - ((v - centre[0]) / radius) ** 2 - ((u - centre[1]) / radius) ** 2
            deepest = _CHIP_DEPTH_FRACTION * radius * self.spacing
            pit = (deepest * bowl).astype(np.float32)
            depth[window] = np.maximum(depth[window], pit)


def surface_at(along: np.ndarray, heights: np.ndarray, **attrs: str) -> xr.DataArray:
    """A surface (y, x), mm, at the even positions `along` both axes, mm."""
    surface = make_surface(heights, along[1] - along[0], **attrs)
    return surface.assign_coords(
        {axis: surface[axis].copy(data=along) for axis in "yx"}
    )


def block_means(heights: np.ndarray, points: int) -> np.ndarray:
    """Means of a grid over its whole blocks of (points, points)."""
    rows, columns = (count // points for count in heights.shape)
    whole = heights[: rows * points, : columns * points]
    blocks = whole.reshape(rows, points, columns, points)
    return blocks.mean(axis=(1, 3), dtype=float)


def _bilinear(coarse: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A coarse grid at the fractional indices `places` of its rows and of its columns."""
    low = np.minimum(places.astype(int), len(coarse) - 2)
    weight = (places - low).astype(coarse.dtype)
    for _ in "yx":
        coarse = coarse[low].T * (1 - weight) + coarse[low + 1].T * weight
    return coarse
