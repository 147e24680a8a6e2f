"""Every number that makes a generated specimen, with its unit in its name."""

from dataclasses import dataclass, fields

from gstlib.errors import ConfigError

__all__ = ["WEAR_PLACEMENTS", "SpecimenParameters"]

WEAR_PLACEMENTS = ("summits", "random")


@dataclass(frozen=True)
class SpecimenParameters:
    """What a generated specimen is made from; the config section ``specimen``, key by key.

    Attributes
    ----------
    seed : int
        Seed of everything random. Surface, mesh, wear and each patch have streams of their own.
    outer_size_mm : (3,) sequence of float
        Outer size of the pebble along x, y and z; the use-face looks along +z.
    concavity_mm : float
        How deep the use-face is dished at its centre.
    mesh_edge_mm : float
        Mean edge length of the mesh.
    mesh_noise_um : float
        R.m.s. of the mesh's own error in height (photogrammetric noise).
    hurst_exponent : float
        Hurst exponent of the self-affine surface.
    roll_off_wavelength_mm : float
        Wavelength above which the spectrum is flat.
    cut_off_wavelength_mm : float
        Longest wavelength that the mesh does not see; it parts macroscale surface from detail.
    macroscale_rms_um : float
        R.m.s. height of the macroscale part on the square, its plane removed.
    shortest_wavelength_points : float
        Shortest wavelength of the surface, in scan points.
    scan_points : int
        Points along each side of a scan.
    scan_spacing_um : float
        Distance of scan points.
    margin_mm : float
        How far the surface is known beyond the square, at least.
    placement_error_um : float
        R.m.s. of the T0 scan's place about its nominal one, along each axis.
    relocation_error_um : float
        R.m.s. of the T1 scan's place about that of T0, along each axis.
    rotation_error_deg : float
        R.m.s. of a scan's rotation about its nominal one.
    poor_overlap_share : float
        Share of patches whose T1 scan misses 40 to 70 % of the T0 scan's area.
    tilt_mrad : float
        R.m.s. tilt with which a mould lies under the instrument, along each axis.
    noise_um : float
        R.m.s. of the instrument's noise, point by point.
    spike_share : float
        Share of points that are spikes.
    spike_height_um : (2,) sequence of float
        Smallest and largest height of a spike; its sign is chance.
    unmeasured_share : float
        Share of points without a value.
    unmeasured_size_um : float
        Size of the blots that lack a value.
    wear_placement : {"summits", "random"}
        Where wear lies: on summits, where the macroscale surface is high; or the same wear moved
        elsewhere by chance, with no relation to the heights under it.
    wear_share : float
        Share of the square where summits are worn to half of the full severity or more.
    wear_chance_um : float
        R.m.s. of the chance added to the macroscale height when deciding where wear is severe.
    wear_chance_length_um : float
        Length over which that chance varies.
    wear_reference_length_um : float
        Standard deviation of the Gaussian that smooths the stone, to tell summits from valleys.
    wear_reach_sigma : float
        How far above the smoothed stone summits are cut at full severity, over the r.m.s. of the
        heights above it.
    chips_per_mm2 : float
        Number of chips per area where wear is at its most severe.
    chip_radius_um : float
        Median radius of a chip.
    chip_depth_share : float
        Depth of a chip over its radius.
    valley_share : float
        Share of the area that loses material whatever its height.
    valley_depth_um : float
        Greatest depth of that loss.
    valley_size_um : float
        Length over which that loss varies.
    wear_threshold_um : float
        Depth from which a point counts as worn in the truth.
    """

    seed: int
    outer_size_mm: tuple[float, float, float]
    concavity_mm: float
    mesh_edge_mm: float
    mesh_noise_um: float
    hurst_exponent: float
    roll_off_wavelength_mm: float
    cut_off_wavelength_mm: float
    macroscale_rms_um: float
    shortest_wavelength_points: float
    scan_points: int
    scan_spacing_um: float
    margin_mm: float
    placement_error_um: float
    relocation_error_um: float
    rotation_error_deg: float
    poor_overlap_share: float
    tilt_mrad: float
    noise_um: float
    spike_share: float
    spike_height_um: tuple[float, float]
    unmeasured_share: float
    unmeasured_size_um: float
    wear_placement: str
    wear_share: float
    wear_chance_um: float
    wear_chance_length_um: float
    wear_reference_length_um: float
    wear_reach_sigma: float
    chips_per_mm2: float
    chip_radius_um: float
    chip_depth_share: float
    valley_share: float
    valley_depth_um: float
    valley_size_um: float
    wear_threshold_um: float

    def __post_init__(self) -> None:
        for field in fields(self):  # a config file has lists where a frozen object needs tuples
            value = getattr(self, field.name)
            if isinstance(value, list):
                object.__setattr__(self, field.name, tuple(value))
        if self.cut_off_wavelength_mm >= self.roll_off_wavelength_mm:
            raise ConfigError(
                "specimen.cut_off_wavelength_mm",
                f"{self.cut_off_wavelength_mm} mm is not below the roll-off wavelength, "
                f"{self.roll_off_wavelength_mm} mm",
                "Lower it, or raise specimen.roll_off_wavelength_mm.",
            )
        if self.shortest_wavelength_mm >= self.cut_off_wavelength_mm:
            raise ConfigError(
                "specimen.shortest_wavelength_points",
                f"{self.shortest_wavelength_points} points of {self.scan_spacing_um} µm are not "
                f"below the cut-off wavelength, {self.cut_off_wavelength_mm} mm",
                "Lower it or specimen.scan_spacing_um.",
            )
        if self.wear_placement not in WEAR_PLACEMENTS:
            raise ConfigError(
                "specimen.wear_placement",
                f"is '{self.wear_placement}'",
                f"One of: {', '.join(WEAR_PLACEMENTS)}.",
            )
        if self.spike_height_um[0] > self.spike_height_um[1]:
            raise ConfigError(
                "specimen.spike_height_um",
                f"{list(self.spike_height_um)} is not [smallest, largest]",
                "Swap the two heights.",
            )

    @property
    def scan_spacing_mm(self) -> float:
        """Distance of scan points, mm."""
        return self.scan_spacing_um * 1e-3

    @property
    def scan_size_mm(self) -> float:
        """Side of a scan, mm."""
        return self.scan_points * self.scan_spacing_mm

    @property
    def shortest_wavelength_mm(self) -> float:
        """Shortest wavelength of the surface, mm."""
        return self.shortest_wavelength_points * self.scan_spacing_mm
