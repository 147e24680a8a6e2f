"""The parameters of the specimen, independent random streams, and random fields.

Fields are computed in double precision and rounded once to single precision. The rounding removes
the last bits, in which powers and transforms differ between processors. So a seed gives the same
specimen everywhere.
"""

import zlib
from dataclasses import dataclass

import numpy as np
import scipy

from gstlib.errors import ConfigError
from gstlib.surfaces.filtering import radial_frequency

__all__ = [
    "SpecimenParameters",
    "rounded",
    "self_affine_field",
    "smooth_field",
    "stream",
]

# ASSUME: Roll-off of the spectrum. The spectrum is flat above a wavelength of 2.5 mm. Reason: Half
# the square holds only a few longer waves.
ROLL_OFF_MM = 2.5
# Step of rounded heights, about 1 nm: at most a tenth of any error they are compared with.
_HEIGHT_STEP_MM = 2.0**-20
# Shortest wavelength, in scan points. A scan resolves it with one spare point per half wave.
_SHORTEST_POINTS = 4.0


@dataclass(frozen=True)
class SpecimenParameters:
    """Parameters of a synthetic specimen.

    Attributes
    ----------
    seed : int
        Seed of all random parts.
    counterface_seed : int, optional
        Seed of an active tool of the same kind; None for a flat.
    mesh_edge_mm : float
        Mean edge length of the mesh.
    cut_off_wavelength_mm : float
        Longest wavelength that the mesh does not resolve.
    scan_points : int
        Number of points along each side of a scan.
    scan_spacing_um : float
        Spacing of the points.
    unmeasured_size_um : float
        Size of the spots of unmeasured points.
    wear_placement : str
        Origin of the wear, as in ``gstlib.specimen.law.wear_depth``.
    worn_off_middle_mm : (float, float)
        Load point of wear by a law, relative to the middle of the square along y and x.
    worn_radius_mm, worn_angle_deg
        Active tool of wear by a law, as in `gstlib.macroscale.active_tool.RoundedTool`.
    mesh_noise_um : float
        R.m.s. error of the mesh in height.
    hurst_exponent : float
        Hurst exponent of the self-affine surface.
    macroscale_rms_um : float
        R.m.s. height of the macroscale part on the square, without its plane.
    placement_error_um : float
        R.m.s. error of the T0 scan's position along each axis.
    relocation_error_um : float
        R.m.s. error of the T1 scan's position relative to T0, along each axis.
    noise_um : float
        R.m.s. noise of the instrument at single points.
    noise_length_along_um, noise_length_across_um : float
        Distance along and across scan lines at which the noise of two points correlates by 1/e. 0
        for independent noise.
    spike_fraction : float
        Fraction of points that are spikes.
    wear_fraction : float
        Fraction of the square with summits worn to half of the full severity or more.

    Raises
    ------
    ConfigError
        The scans cannot resolve waves as short as the cut-off.

    Examples
    --------
    >>> import gstlib
    >>> parameters = gstlib.SpecimenParameters(
    ...     seed=7,
    ...     counterface_seed=None,
    ...     mesh_edge_mm=3.0,
    ...     cut_off_wavelength_mm=1.2,
    ...     scan_points=32,
    ...     scan_spacing_um=25.0,
    ...     unmeasured_size_um=60.0,
    ...     wear_placement="summits",
    ... )
    >>> parameters.scan_size_mm, parameters.shortest_wavelength_mm
    (0.8, 0.1)
    """

    seed: int
    counterface_seed: int | None
    mesh_edge_mm: float
    cut_off_wavelength_mm: float
    scan_points: int
    scan_spacing_um: float
    unmeasured_size_um: float
    wear_placement: str
    worn_off_middle_mm: tuple[float, float] = (0.5, -0.4)
    worn_radius_mm: float | tuple[float, float] = 170.0
    worn_angle_deg: float = 0.0
    # ASSUME: Similarity to M12. The relief is 12 µm (r.m.s.), with which the square moves down by
    # 27 µm to reach 22 MPa, as in the paper. The errors of mesh and scans are orders of magnitude.
    # Reason: The data of M12 is not public, and the paper does not state these errors.
    mesh_noise_um: float = 0.5
    hurst_exponent: float = 0.8
    macroscale_rms_um: float = 12.0
    placement_error_um: float = 30.0
    relocation_error_um: float = 40.0
    noise_um: float = 0.1
    noise_length_along_um: float = 0.0
    noise_length_across_um: float = 0.0
    spike_fraction: float = 0.005
    wear_fraction: float = 0.25

    def __post_init__(self) -> None:
        if self.shortest_wavelength_mm >= self.cut_off_wavelength_mm:
            raise ConfigError(
                "specimen.scan_spacing_um",
                f"{_SHORTEST_POINTS:g} points of {self.scan_spacing_um} µm, the shortest wave, are "
                f"not below the cut-off wavelength, {self.cut_off_wavelength_mm} mm",
                "Lower it, or raise specimen.cut_off_wavelength_mm.",
            )

    @property
    def scan_spacing_mm(self) -> float:
        """Distance between scan points, mm."""
        return self.scan_spacing_um * 1e-3

    @property
    def scan_size_mm(self) -> float:
        """Side of a scan, mm."""
        return self.scan_points * self.scan_spacing_mm

    @property
    def shortest_wavelength_mm(self) -> float:
        """Shortest wavelength of the surface, mm."""
        return _SHORTEST_POINTS * self.scan_spacing_mm


def stream(seed: int, *names: str) -> np.random.Generator:
    """Random generator with this name, independent of all others and of the order of calls.

    So an additional patch in the table does not change the surface or the other patches.
    """
    key = tuple(zlib.crc32(name.encode("utf-8")) for name in names)
    return np.random.Generator(
        np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key))
    )


def self_affine_field(
    generator: np.random.Generator,
    count: int,
    spacing: float,
    *,
    hurst_exponent: float,
    roll_off: float,
    longest: float = np.inf,
    shortest: float = 0.0,
) -> np.ndarray:
    """A periodic Gaussian field with a self-affine spectrum, ``shortest <= wavelength < longest``.

    The two-dimensional power spectral density is C (f/f_r)^(-2-2H) above the roll-off frequency f_r
    = 1/roll_off and C = roll_off² below it. C does not depend on count and spacing, so fields of
    different grids and bands add up to one spectrum. All lengths have the same, arbitrary unit. The
    heights (count, count), float32, have the unit in which the density at roll-off is roll_off².

    Examples
    --------
    >>> import gstlib
    >>> waves = {"hurst_exponent": 0.8, "roll_off": 0.2, "shortest": 0.04}  # lengths in mm
    >>> field = gstlib.self_affine_field(np.random.default_rng(1), 64, 0.01, **waves)
    >>> field.shape, bool(abs(field.mean()) < 1e-3 * field.std())
    ((64, 64), True)
    """
    # White noise of unit variance has the density spacing².
    spectrum = scipy.fft.rfft2(_white_noise(generator, count))
    frequency = radial_frequency((count, count), spacing)
    outside = frequency <= 1 / longest
    if shortest > 0:
        outside |= frequency > 1 / shortest
    spectrum *= np.maximum(frequency * roll_off, 1) ** (-1 - hurst_exponent)
    spectrum *= roll_off / spacing
    spectrum[outside] = 0
    return scipy.fft.irfft2(spectrum, s=(count, count), overwrite_x=True).astype(
        np.float32
    )


def smooth_field(
    generator: np.random.Generator, count: int, spacing: float, length: float
) -> np.ndarray:
    """A periodic Gaussian field (count, count), mean 0, variance 1, correlated over `length`."""
    spectrum = scipy.fft.rfft2(_white_noise(generator, count))
    along_y = scipy.fft.fftfreq(count, spacing)[:, None]
    for frequency in (along_y, scipy.fft.rfftfreq(count, spacing)):
        spectrum *= np.exp(-((np.pi * length / 2 * frequency) ** 2))
    field = scipy.fft.irfft2(spectrum, s=(count, count), overwrite_x=True)
    field -= field.mean()
    deviation = field.std()
    return (field / deviation if deviation > 0 else field).astype(np.float32)


def rounded(heights: np.ndarray) -> np.ndarray:
    """Heights (mm) to about 1 nm, float32."""
    return (np.round(heights / _HEIGHT_STEP_MM) * _HEIGHT_STEP_MM).astype(np.float32)


def _white_noise(generator: np.random.Generator, count: int) -> np.ndarray:
    """Normal random numbers, drawn in single precision to halve the time."""
    return generator.standard_normal((count, count), dtype=np.float32).astype(float)
