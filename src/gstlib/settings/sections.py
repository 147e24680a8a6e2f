"""One class for each section of a config: its keys with type, bounds, default and meaning.

A string below a key is its description, which messages and config/README.md show. What cannot go
together is in `gstlib.settings.contradictions`.
"""

from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_serializer
from pydantic.json_schema import SkipJsonSchema

__all__ = [
    "Counterface",
    "Gesture",
    "Grinding",
    "Inputs",
    "Interlayer",
    "Load",
    "Macroscale",
    "Material",
    "Microscale",
]
__all__ += [
    "Mould",
    "Pose",
    "Preprocessing",
    "Registration",
    "Scans",
    "Section",
    "Selection",
    "Specimen",
    "Square",
]
__all__ += [
    "DetectionSettings",
    "Texts",
    "Texture",
    "Uncertainty",
    "Use",
    "Validation",
    "WearLaw",
]

AnyType = TypeVar("AnyType")
# A key without a default: it may be left out.
Given: TypeAlias = AnyType | SkipJsonSchema[None]
Texts = list[str]
Point = Annotated[list[float], Field(min_length=2, max_length=2)]
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Points = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Row = Annotated[list[float], Field(min_length=4, max_length=4)]
Matrix = Annotated[list[Row], Field(min_length=4, max_length=4)]
Radius = Annotated[float, Field(ge=1, le=100_000)]
Radii = Annotated[list[Radius], Field(min_length=2, max_length=2)]
Modulus = Annotated[float, Field(ge=500, le=2_000_000)]
Poisson = Annotated[float, Field(gt=-1, le=0.5)]
_STEPS = "Load steps, at equal increments of the far-field displacement."
Steps = Annotated[int, Field(ge=1, le=1000, description=_STEPS)]
_TOLERANCE = """Largest violation of the contact conditions, relative to the largest rigid
interpenetration."""
Tolerance = Annotated[float, Field(ge=1e-12, le=1e-6, description=_TOLERANCE)]
_DISPLACEMENT = """Far-field displacement (µm) beyond which a target pressure counts as out of
reach."""
Displacement = Annotated[float, Field(gt=0, le=100_000, description=_DISPLACEMENT)]


class Section(BaseModel):
    """Keys of a config; a key of another name, or a value of another type, is refused."""

    model_config = ConfigDict(
        strict=True,
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
    )

    @field_validator("*", mode="before")
    @classmethod
    def _whole(cls, value: Any) -> Any:
        """5.0 as an integer, which it is in JSON; where a number is asked for, it is one again."""
        return int(value) if isinstance(value, float) and value.is_integer() else value


def _without_defaults(schema: dict[str, Any]) -> None:
    for key in schema["properties"].values():
        key.pop("default", None)


class Alternatives(Section):
    """A section whose keys exclude each other: a key that is left out stays out."""

    model_config = ConfigDict(json_schema_extra=_without_defaults)

    @model_serializer(mode="wrap")
    def _only_given(self, dump: Any) -> dict[str, Any]:
        return {
            key: part
            for key, part in dump(self).items()
            if key in self.model_fields_set
        }


class Inputs(Section):
    """The measured files. Null when a specimen is generated instead."""

    mesh: str
    """Mesh of the tool (STL, PLY, OBJ, OFF, GLB or 3MF)."""
    mesh_unit: Literal["mm", "cm", "m", "um", "in", "ft"]
    """Unit of the mesh's coordinates; GLB is in m by its specification."""
    scan_folder: str | None = None
    """Folder of the scans that the patch table names; a patch table needs it."""


class Specimen(Section):
    """The synthetic specimen. Null when measured files are given in `inputs`."""

    seed: int = Field(7, ge=0)
    """Seed of everything random. Surface, mesh, wear and each patch have streams of their own."""
    counterface_seed: int | None = Field(None, ge=0)
    """Seed of an active tool of the same kind, whose square is laid on that of the first, turned
    over; null for none, but the one that `counterface` describes."""
    mesh_edge_mm: float = Field(0.3144, gt=0, le=10)
    """Mean edge length of the mesh."""
    cut_off_wavelength_mm: float = Field(0.6, gt=0, lt=2.5)
    """Longest wavelength that the mesh does not see (mm); it separates the macroscale surface from
    the detail. Shorter than 2.5 mm, above which the spectrum is flat: so the macroscale surface
    has some of the spectrum's slope."""
    scan_points: int = Field(512, ge=16, le=4096)
    """Points along each side of a scan."""
    scan_spacing_um: float = Field(1.66, gt=0, le=1000)
    """Distance of scan points."""
    unmeasured_size_um: float = Field(12.0, gt=0, le=1000)
    """Size of the blots that lack a value."""
    wear_placement: Literal["summits", "archard", "interlayer"] = "archard"
    """Where wear lies: by a law, Archard's with the bare stone or with an interlayer, at a use
    that the study is not told; or by rule on summits, where the macroscale surface is high."""


class Square(Section):
    """The analysed square and where it lies on the mesh."""

    size_mm: float = Field(5.0, gt=0, le=100)
    """Side of the analysed square (mm)."""
    points_mm: Points = [[2.5, 2.5, 0.0], [-2.5, 2.5, 0.0], [2.5, -2.5, 0.0]]
    """Three points [x, y, z] of the mesh (mm), as `gst place` writes them: the reference corner,
    the corner that x runs to, and the one that y runs to, anticlockwise as one looks at the
    stone."""


class Material(Section):
    """Elastic constants of the passive (1) and active (2) stone."""

    young_1_MPa: Modulus = 19500.0
    """Young's modulus of the passive tool (MPa; 1 GPa is 1000 MPa)."""
    poisson_1: Poisson = 0.24
    """Poisson's ratio of the passive tool."""
    young_2_MPa: Modulus = 19500.0
    """Young's modulus of the active tool (MPa; 1 GPa is 1000 MPa)."""
    poisson_2: Poisson = 0.24
    """Poisson's ratio of the active tool."""
    contact_modulus_MPa: Modulus | None = None
    """Contact modulus E* (MPa) to use as it stands; null computes it from the constants above as
    1/E* = (1 - ν₁²)/E₁ + (1 - ν₂²)/E₂."""


class Load(Section):
    """The force of use, or the mean pressure on the square (exactly one of them), and where it
    acts. The default is the paper's 22 MPa on its square of 25 mm².
    """

    force_N: float | None = Field(None, ge=0.1, le=100_000)
    """Force that presses the stones together (N), normal to the square. A hand pushes with some
    tens to some hundreds of N."""
    pressure_MPa: float | None = Field(None, gt=0, le=100_000)
    """The force over the square's area (MPa)."""
    at_mm: Point | None = None
    """Point [x, y] of the square's axes (mm) through which the force acts; the stone is free to
    tilt about it. Null for the middle of the square."""


class Macroscale(Section):
    """Contact of the use-face of the mesh, at rest under its load."""

    grid: int = Field(100, ge=8, le=4096)
    """Elements along each side of the square."""
    face_mm: float = Field(15.0, gt=0, le=500)
    """Side of the face (mm), with the square in its middle: as much of the stone as comes to rest
    on the other. With the coupling of the paper, the square is pressed alone."""
    interpolation: Literal["best", "linear"] = "best"
    """How the heights between the mesh's vertices are found: linearly over the triangles between
    them (the paper), or by the best of three ways at predicting vertices left out: linearly,
    smoothly over these triangles, or by a cubic radial basis of the 50 nearest vertices."""
    steps: Steps = 20
    tolerance: Tolerance = 1e-9
    maximum_displacement_um: Displacement = 200.0


class Mould(Section):
    """Undoes the negative copy when a mould was scanned instead of the stone."""

    invert: bool = True
    """Whether heights change sign; true for moulds, which are negatives, false for the stone
    itself."""
    flip: Literal["x", "y", None] = "x"
    """Axis along which the map is reversed; null for none."""


class Scans(Section):
    """How the confocal scans were taken and stored."""

    size_mm: float = Field(0.85, gt=0, le=50)
    """Side of a (square) patch (mm); a scan of another size is refused, or cut."""
    unit: Literal[None, "mm", "um", "nm", "m"] = None
    """Length unit of files that do not say it; null refuses such files."""
    spacing_um: float | None = Field(None, gt=0, le=500)
    """Distance of the points (µm) in files that do not say it; null refuses such files."""
    mould: Mould = Mould()


class Preprocessing(Section):
    """What is done to a scan before contact."""

    maximum_unmeasured: float = Field(0.1, ge=0, le=1)
    """A scan with a larger share of unmeasured points is refused."""
    outlier_rule: Literal["window", "median"] = "median"
    """Rule whose outliers are replaced (the paper's, or the robust one)."""
    outlier_fraction: float = Field(0.01, ge=0, le=0.2)
    """Rule window: largest share of the measured points that may be outliers."""
    outlier_median_threshold: float = Field(5.0, gt=0)
    """Rule median: distance from the window's median beyond which a point is an outlier, in robust
    standard deviations."""


class Registration(Section):
    """How T1 is laid over T0."""

    maximum_shift_mm: float = Field(0.6, gt=0, le=50)
    """Farthest shift of T1 against T0 along each axis that is surely looked for (mm); in any case
    T1 must cover a quarter of T0 to be found."""


class DetectionSettings(Section):
    """What counts as height lost or gained from T0 to T1."""

    minimum_cluster_points: int = Field(8, ge=1, le=10_000)
    """Fewest adjacent points (corners count) beyond the level of detection that make a loss or a
    gain. Noise alone puts 2.5 % of all points beyond it on either side, but hardly ever so many
    together if its points are independent. If the errors of neighbouring points correlate, more
    points are needed, and the table of registrations says how many."""


class Texture(Section):
    """Filters of the surface texture (ISO 25178-3), both Gaussian (ISO 16610-61), after the
    plane is taken off.
    """

    s_filter_um: float = Field(8.0, gt=0, le=10_000)
    """Nesting index of the S-filter, which takes out shorter waves (µm)."""
    l_filter_um: float | None = Field(250.0, gt=0, le=100_000)
    """Nesting index of the L-filter, which takes out longer waves (µm); null leaves them in. T0
    and T1 are compared where they share a rectangle at least as long and as wide."""


class Uncertainty(Section):
    """How far places and elastic constants may be off, for the intervals of the patches'
    pressures.
    """

    placement_um: float = Field(30.0, ge=0, le=200)
    """Standard deviation of a patch's place along each axis (µm)."""
    pose_um: float = Field(100.0, ge=0, le=1000)
    """That of the place of the active tool, where there is a mesh of it."""
    load_point_mm: float = Field(1.0, ge=0, le=20)
    """That of the load point (mm), as far as it is the same in all strokes; the scatter from
    stroke to stroke is gesture.load_point_scatter_mm."""
    radius_log_sd: float = Field(0.7, ge=0, le=3)
    """Standard deviation of the logarithm of the active tool's radius; 0.7 is a factor of 2."""
    force_log_sd: float = Field(0.2, ge=0, le=2)
    """Standard deviation of the logarithm of the force."""
    young_log_sd: float = Field(0.2, ge=0, le=1)
    """Standard deviation of the logarithm of each stone's Young's modulus."""
    poisson: float = Field(0.05, ge=0, le=0.5)
    """Standard deviation of each stone's Poisson's ratio."""


class Selection(Section):
    """Which patches enter the microscale study."""

    minimum_pressure_MPa: float = Field(1.0, ge=0)
    """Patches with a lower macroscale pressure are left out (MPa)."""
    minimum_overlap: float = Field(0.7, ge=0, le=1)
    """Least share of T0's area that T1 must cover."""
    minimum_correlation: float = Field(0.5, ge=-1, le=1)
    """Least correlation of the detail (band-passed heights) of T1 with that of T0 over their
    overlap."""


class Microscale(Section):
    """Contact of each patch with a flat, up to its own pressure."""

    s_filter_um: float | None = Field(5.0, gt=0)
    """Nesting index of the Gaussian S-filter (ISO 16610-61) on the scans before contact: noise of
    single points touches first. With null there is none."""
    steps: Steps = 20
    tolerance: Tolerance = 1e-9
    maximum_displacement_um: Displacement = 200.0


class Pose(Alternatives):
    """Where the active tool stands on the passive one, said in one of two ways."""

    points_mm: Given[Points] = None
    """The square as picked on the active tool, as `square.points_mm` on the passive one; it is
    laid on that turned over, its x against the other's."""
    matrix: Given[Matrix] = None
    """What takes points of the active mesh to the passive one: a turn and a shift (mm), as MeshLab
    or CloudCompare gives it after aligning the two."""


class Counterface(Alternatives):
    """The active tool: its radius or its mesh, pressed on the face; a scan of it, pressed on
    each patch; null for a flat. With the coupling of the paper, a flat presses the square.
    """

    radius_mm: Radius | Radii | None = None
    """Radius (mm) of a rounded active tool, as what a hand holds is; null for a flat. Of an
    ellipsoidal one two: that along an axis, and that across it."""
    angle_deg: Given[Annotated[float, Field(ge=-180, le=180)]] = None
    """Of that axis on the square, from x towards y; 0 if it is not said."""
    scan: Given[str] = None
    """Scan of the active tool's face, taken as the patches' scans are and with as many points; it
    is prepared as they are and turned over about the y axis."""
    mesh: Given[str] = None
    """Mesh of the active tool (STL, PLY, OBJ, OFF, GLB or 3MF)."""
    mesh_unit: Given[Literal["mm", "cm", "m", "um", "in", "ft"]] = None
    """Unit of its coordinates; mm if it is not said."""
    pose: Given[Pose] = None


class Gesture(Alternatives):
    """How the active tool moves on the passive one, pose by pose, each at rest: a table of
    poses, or the number of poses of a stroke or of a load point that scatters; null for one
    pose.
    """

    table: Given[str] = None
    """Table with a row for each pose; its columns are described below."""
    stroke_mm: Given[Annotated[float, Field(ge=0)]] = None
    """A stroke of this length along the square's x, with the pose in its middle."""
    load_point_scatter_mm: Given[Annotated[float, Field(ge=0, le=100)]] = None
    """Standard deviation, along each axis, of the points at which the hand pushes."""
    poses: Given[Annotated[int, Field(ge=1, le=100_000)]] = None
    """Number of poses of the stroke, or of points at which the hand pushes."""


class Grinding(Section):
    """Tangential load on each patch of the microscale study, for stick and slip (cases.csv);
    null for none.
    """

    friction: float = Field(0.6, gt=0, le=5)
    """Coulomb's coefficient of friction μ between the stones."""
    tangential_ratio: float = Field(0.5, ge=0, le=1)
    """Tangential force Q over the force μP that makes a patch slide: 0 sticks, 1 slides."""


class WearLaw(Section):
    """How the loss of a patch grows with its pressure p, as max(p − threshold_MPa, 0) to the
    power of exponent. The default is Archard's law. laws.csv compares it with others.
    """

    threshold_MPa: float = Field(0.0, ge=0, le=100_000)
    """Pressure of a patch up to which it does not wear."""
    exponent: float = Field(1.0, ge=0, le=5)
    """With 0, every patch above the threshold loses as much."""


class Use(Section):
    """How the tool was used, read from the losses of the patches: where it was pressed, and
    against how round a tool, from what load and counterface state, with the errors of
    uncertainty. Null goes on as stated. It needs coupling: equilibrium and scans after use.
    """

    draws: int = Field(100, ge=20, le=100_000)
    """Contacts that are solved in a round, of single strikes."""
    rounds: int = Field(8, ge=2, le=1000)
    """Most rounds, each of strikes that the wear so far makes likely. There are fewer where the
    contacts are predicted well from each other."""
    particles: int = Field(2000, ge=200, le=100_000)
    """Uses that are drawn in the end, between the solved contacts."""
    scatter_mm: float = Field(1.0, ge=0)
    """Scale of the scatter of strikes along each axis. Beforehand, half of the uses have none, and
    it is half-normal in the others. 0 has all strikes in one place."""
    stroke_mm: float = Field(3.0, ge=0)
    """Scale of the length of a stroke in any direction. Beforehand, half of the uses have none,
    and it is half-normal in the others. 0 has no strokes."""


class Interlayer(Section):
    """An elastic layer that takes turns with the bare stone in wearing the patches, as plants or
    hide between the stones do; null for none. Its share of the wear is fitted to the measured
    losses.
    """

    young_MPa: float = Field(gt=0, le=100_000)
    """Young's modulus; less than the stones'."""
    poisson: float = Field(ge=0, le=0.5)
    """Poisson's ratio."""
    thickness_um: float = Field(gt=0, le=10_000)
    """Thickness; at least the spacing of the scans' points."""


class Validation(Section):
    """Comparison of predicted with measured height loss."""

    resamples: int = Field(9999, ge=99, le=100_000)
    """Number of bootstrap resamples of the patches, and of draws of chance."""
    max_gain_to_loss_ratio: float = Field(0.2, gt=0, le=1)
    """Largest share of a patch's loss that may be noise, as the area that rose tells, for the loss
    to be above the noise. Points too high by error at T0 are predicted to wear, and lost at T1
    without any wear."""
    expected_most_worn: Texts = []
    """Patches said beforehand to be the worst worn; whether they are is tested where the patch
    table has all of them. Empty for none."""
