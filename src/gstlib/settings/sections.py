"""The settings of a study, with a class for each section of its config.

Keys have type, bounds, default and meaning. The string below a key is its description, which
messages and config/README.md show. Keys that exclude each other are in
`gstlib.settings.contradictions`.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self, TypeAlias, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import InitErrorDetails, PydanticCustomError

from gstlib.conditions import (
    load_force,
    resolved_load_point,
    study_modulus,
    study_radius,
)
from gstlib.errors import FAULTS
from gstlib.settings.contradictions import contradictions

__all__ = ["Section", "Settings", "json_schema"]

AnyType = TypeVar("AnyType")
# A key without a default, which may be omitted.
Given: TypeAlias = AnyType | SkipJsonSchema[None]
Texts = list[str]
MeshUnit = Literal["mm", "cm", "m", "um", "in", "ft"]
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
Displacement = Annotated[PositiveFloat, Field(le=100_000, description=_DISPLACEMENT)]


class Section(BaseModel):
    """Keys of a config. Unknown keys and values of another type are refused."""

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
        """Convert 5.0 to an integer, as in JSON; a key that is a number converts it back."""
        return int(value) if isinstance(value, float) and value.is_integer() else value


def _without_defaults(schema: dict[str, Any]) -> None:
    for key in schema["properties"].values():
        key.pop("default", None)


class Alternatives(Section):
    """A section whose keys exclude each other. A key that is omitted has no value."""

    model_config = ConfigDict(json_schema_extra=_without_defaults)

    @model_serializer(mode="wrap")
    def _only_given(self, dump: Any) -> dict[str, Any]:
        return {
            key: part
            for key, part in dump(self).items()
            if key in self.model_fields_set
        }


class Inputs(Section):
    """The measured files. Null if a specimen is generated instead."""

    mesh: str
    """Mesh of the tool (STL, PLY, OBJ, OFF, GLB or 3MF)."""
    mesh_unit: MeshUnit
    """Unit of the coordinates of the mesh. The GLB format prescribes m."""
    scan_folder: str | None = None
    """Folder of the scans in the patch table. It is required if there is a patch table."""


class Specimen(Section):
    """The synthetic specimen. Null if `inputs` contains measured files."""

    seed: NonNegativeInt = 7
    """Seed of all random parts. Surface, mesh, wear and each patch have streams of their own."""
    counterface_seed: NonNegativeInt | None = None
    """Seed of a generated active tool of the same kind. It is turned over, and its square faces the
    square of the passive tool. With null, `counterface` describes the active tool."""
    mesh_edge_mm: PositiveFloat = Field(0.3144, le=10)
    """Mean edge length of the mesh (mm)."""
    cut_off_wavelength_mm: PositiveFloat = Field(0.6, lt=2.5)
    """Longest wavelength that the mesh does not resolve (mm). It separates the macroscale surface
    from the detail. It must be below 2.5 mm, above which the spectrum is flat. So the macroscale
    surface has a part of the sloping spectrum."""
    scan_points: int = Field(512, ge=16, le=4096)
    """Number of points along each side of a scan."""
    scan_spacing_um: PositiveFloat = Field(1.66, le=1000)
    """Spacing of the points of a scan (µm)."""
    unmeasured_size_um: PositiveFloat = Field(12.0, le=1000)
    """Size of the spots of unmeasured points (µm)."""
    noise_length_along_um: NonNegativeFloat = Field(0.0, le=10_000)
    """Distance along a scan line at which the errors of two points correlate by 1/e (µm). With 0,
    errors are independent. Neighbours on measured repeats correlate by 0.88 to 0.97."""
    noise_length_across_um: NonNegativeFloat = Field(0.0, le=10_000)
    """The same distance across scan lines (µm)."""
    wear_placement: Literal["summits", "archard", "interlayer"] = "archard"
    """Origin of the wear. Archard's law wears the bare stone (archard), or an interlayer takes part
    (interlayer). Their load case is hidden from the study. With summits, a rule without contact
    wears high places of the macroscale surface."""


class Square(Section):
    """The analysed square and its position on the mesh."""

    size_mm: PositiveFloat = Field(5.0, le=100)
    """Side of the analysed square (mm)."""
    points_mm: Points = [[2.5, 2.5, 0.0], [-2.5, 2.5, 0.0], [2.5, -2.5, 0.0]]
    """Three points [x, y, z] on the mesh (mm), as `gst place` writes them. They are the reference
    corner and the ends of its x and y edges, anticlockwise seen from outside the stone."""


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
    """Contact modulus E* (MPa). Null computes it from the constants above as 1/E* = (1 - ν₁²)/E₁ +
    (1 - ν₂²)/E₂."""


class Load(Section):
    """The force of use and its load point. Give either the force or the mean pressure on the
    square. The default is the paper's 22 MPa on its square of 25 mm².
    """

    force_N: float | None = Field(None, ge=0.1, le=100_000)
    """Force that presses the stones together (N), normal to the square. A hand exerts some tens to
    some hundreds of N."""
    pressure_MPa: PositiveFloat | None = Field(None, le=100_000)
    """Force divided by the area of the square (MPa)."""
    at_mm: Point | None = None
    """Load point [x, y] in the axes of the square (mm), through which the force acts. The stone is
    free to tilt about it. Null for the middle of the square."""


class Macroscale(Section):
    """Contact of the use-face of the mesh, in equilibrium under its load."""

    grid: int = Field(100, ge=8, le=4096)
    """Number of elements along each side of the square."""
    face_mm: PositiveFloat = Field(15.0, le=500)
    """Side of the face (mm), with the square in its middle. The face should contain all of the
    stone that may touch the active tool. With the coupling of the paper, the square is pressed
    alone."""
    interpolation: Literal["best", "linear"] = "best"
    """Interpolation of heights between the vertices of the mesh. With linear, as in the paper, it
    is linear over the triangles. With best, it is the one of three ways that predicts omitted
    vertices best: linear, smooth over the triangles, or a cubic radial basis of the 50 nearest
    vertices."""
    steps: Steps = 20
    tolerance: Tolerance = 1e-9
    maximum_displacement_um: Displacement = 200.0


class Mould(Section):
    """Reversal of the negative copy if a mould was scanned instead of the stone."""

    invert: bool = True
    """Whether to change the sign of heights. True for moulds, which are negatives; false for the
    stone itself."""
    flip: Literal["x", "y", None] = "x"
    """Axis along which the map is reversed; null for none."""


class Scans(Section):
    """Size, units and origin of the confocal scans."""

    size_mm: PositiveFloat = Field(0.85, le=50)
    """Side of a square patch (mm). Scans of another size are cut or refused."""
    unit: Literal[None, "mm", "um", "nm", "m"] = None
    """Length unit of files that do not state one. Null refuses such files."""
    spacing_um: PositiveFloat | None = Field(None, le=500)
    """Spacing of points (µm) in files that do not state one. Null refuses such files."""
    mould: Mould = Mould()


class Preprocessing(Section):
    """Preparation of a scan before contact."""

    maximum_unmeasured: NonNegativeFloat = Field(0.1, le=1)
    """Largest fraction of unmeasured points. Scans above it are refused."""
    outlier_rule: Literal["window", "median"] = "median"
    """Rule for outliers, which are replaced. window is the paper's; median is robust."""
    outlier_fraction: NonNegativeFloat = Field(0.01, le=0.2)
    """For rule window: largest fraction of the measured points that may be outliers."""
    outlier_median_threshold: PositiveFloat = 5.0
    """For rule median: an outlier differs from the median of its window by more than this number of
    robust standard deviations."""


class Registration(Section):
    """Registration of T1 to T0."""

    maximum_shift_mm: PositiveFloat = Field(0.6, le=50)
    """Largest shift of T1 against T0 along each axis that the search covers with certainty (mm). T1
    must cover at least a quarter of T0."""


class DetectionSettings(Section):
    """Criterion for height lost or gained from T0 to T1."""

    minimum_cluster_points: int = Field(8, ge=1, le=10_000)
    """Smallest cluster of adjacent points (corners count) beyond the level of detection that is a
    loss or a gain. Noise alone exceeds this level at 2.5 % of all points on either side, but
    independent errors hardly ever form such clusters. If errors of neighbouring points correlate,
    larger clusters are required; registration.csv lists their size."""


class Texture(Section):
    """Filters of the surface texture (ISO 25178-3), applied after a plane is removed. Both are
    Gaussian (ISO 16610-61).
    """

    s_filter_um: PositiveFloat = Field(8.0, le=10_000)
    """Nesting index of the S-filter, which removes shorter waves (µm)."""
    l_filter_um: PositiveFloat | None = Field(250.0, le=100_000)
    """Nesting index of the L-filter, which removes longer waves (µm). Null keeps them. T0 and T1
    are compared if they share a rectangle at least as long and as wide."""


class Uncertainty(Section):
    """Errors of positions, loads and elastic constants, for the intervals of the pressures of the
    patches.
    """

    placement_um: NonNegativeFloat = Field(30.0, le=200)
    """Standard deviation of the position of a patch along each axis (µm)."""
    pose_um: NonNegativeFloat = Field(100.0, le=1000)
    """Standard deviation of the position of the active tool (µm), if it has a mesh."""
    load_point_mm: NonNegativeFloat = Field(1.0, le=20)
    """Standard deviation of the load point (mm), for an error that all strokes share. The scatter
    between strokes is gesture.load_point_scatter_mm."""
    radius_log_sd: NonNegativeFloat = Field(0.7, le=3)
    """Standard deviation of the logarithm of the active tool's radius; 0.7 is a factor of 2."""
    force_log_sd: NonNegativeFloat = Field(0.2, le=2)
    """Standard deviation of the logarithm of the force."""
    young_log_sd: NonNegativeFloat = Field(0.2, le=1)
    """Standard deviation of the logarithm of each stone's Young's modulus."""
    poisson: NonNegativeFloat = Field(0.05, le=0.5)
    """Standard deviation of each stone's Poisson's ratio."""


class Selection(Section):
    """Criteria for the patches of the microscale study."""

    minimum_pressure_MPa: NonNegativeFloat = 1.0
    """Lowest macroscale pressure of a patch (MPa). Patches below it are left out."""
    minimum_overlap: NonNegativeFloat = Field(0.7, le=1)
    """Smallest fraction of the area of T0 that T1 must cover."""
    minimum_correlation: float = Field(0.5, ge=-1, le=1)
    """Smallest correlation of the detail (band-passed heights) of T1 and T0 over their overlap."""


class Microscale(Section):
    """Contact of each patch with a flat, up to the pressure of the patch."""

    s_filter_um: PositiveFloat | None = 5.0
    """Nesting index of the Gaussian S-filter (ISO 16610-61) on the scans before contact (µm).
    Without a filter, noise at single points touches first. Null for no filter."""
    steps: Steps = 20
    tolerance: Tolerance = 1e-9
    maximum_displacement_um: Displacement = 200.0


class Pose(Alternatives):
    """Position of the active tool on the passive one. Give either points_mm or matrix."""

    points_mm: Given[Points] = None
    """Corners of the square on the active tool, picked like `square.points_mm` on the passive one
    (mm). The active tool is turned over, with opposite x axes of the squares."""
    matrix: Given[Matrix] = None
    """Transformation from the active mesh to the passive one, as 4 × 4 matrix of a rotation and a
    shift (mm). MeshLab and CloudCompare report it after an alignment."""


class Counterface(Alternatives):
    """The active tool. Its radius or mesh is pressed on the face, and a scan of it on each patch.
    Null for a flat. With the coupling of the paper, a flat presses the square.
    """

    radius_mm: Radius | Radii | None = None
    """Radius of a rounded active tool, such as a handstone (mm). An ellipsoidal tool has two radii,
    along an axis and across it. Null for a flat."""
    angle_deg: Given[Annotated[float, Field(ge=-180, le=180)]] = None
    """Direction of the axis of the first radius, in degrees from x towards y. The default is 0."""
    scan: Given[str] = None
    """Scan of the face of the active tool. It must have the settings and the number of points of
    the scans of patches. It is prepared like them and turned over about the y axis."""
    mesh: Given[str] = None
    """Mesh of the active tool (STL, PLY, OBJ, OFF, GLB or 3MF)."""
    mesh_unit: Given[MeshUnit] = None
    """Unit of the coordinates of this mesh. The default is mm."""
    pose: Given[Pose] = None


class Gesture(Alternatives):
    """Poses of the active tool on the passive one, each in equilibrium. Give a table of poses, or
    poses and either stroke_mm or load_point_scatter_mm. Null for one pose.
    """

    table: Given[str] = None
    """Table with one row per pose. Its columns are described below."""
    stroke_mm: Given[NonNegativeFloat] = None
    """Length of a stroke along the x axis of the square (mm). The pose is in its middle."""
    load_point_scatter_mm: Given[Annotated[NonNegativeFloat, Field(le=100)]] = None
    """Standard deviation of the load points along each axis (mm)."""
    poses: Given[Annotated[int, Field(ge=1, le=100_000)]] = None
    """Number of poses of the stroke, or number of load points."""


class Grinding(Section):
    """Tangential load on each patch of the microscale study, for stick and slip (cases.csv). Null
    for none.
    """

    friction: PositiveFloat = Field(0.6, le=5)
    """Coulomb's coefficient of friction μ between the stones."""
    tangential_ratio: NonNegativeFloat = Field(0.5, le=1)
    """Tangential force Q divided by μP, the force that makes a patch slide. A patch sticks at 0 and
    slides at 1."""


class WearLaw(Section):
    """Law of wear. The loss of a patch with pressure p is proportional to max(p − threshold_MPa, 0)
    to the power of exponent. The default is Archard's law. laws.csv compares it with others.
    """

    threshold_MPa: NonNegativeFloat = Field(0.0, le=100_000)
    """Pressure up to which a patch does not wear (MPa)."""
    exponent: NonNegativeFloat = Field(1.0, le=5)
    """Exponent of the law. With 0, all patches above the threshold have the same loss."""


class Use(Section):
    """Inference of load point, scatter and radius of the active tool from the losses of the
    patches. The prior is given by load, counterface and uncertainty. It needs coupling: equilibrium
    and scans after use. Null skips the inference and keeps the values of load and counterface.
    """

    draws: int = Field(100, ge=20, le=100_000)
    """Number of contacts of single strikes that are solved in a round."""
    rounds: int = Field(8, ge=2, le=1000)
    """Largest number of rounds. Each draws strikes that are likely given the losses and the
    contacts so far. The rounds end early if these contacts predict each other well."""
    particles: int = Field(2000, ge=200, le=100_000)
    """Number of draws of the final sample, which interpolates between the solved contacts."""
    scatter_mm: NonNegativeFloat = 1.0
    """Scale of the scatter of strikes along each axis (mm). The prior is no scatter with
    probability 0.5, and half-normal with this scale otherwise. With 0, all strikes share one
    position."""
    stroke_mm: NonNegativeFloat = 3.0
    """Scale of the length of a stroke in any direction (mm). The prior is no stroke with
    probability 0.5, and half-normal with this scale otherwise. 0 excludes strokes."""


class Interlayer(Section):
    """An elastic layer between the stones, such as plants or hide. It alternates with the bare
    stone in wearing the patches. Its share of the wear is fitted to the measured losses. Null for
    none.
    """

    young_MPa: PositiveFloat = Field(le=100_000)
    """Young's modulus (MPa). It must be below the moduli of the stones."""
    poisson: NonNegativeFloat = Field(le=0.5)
    """Poisson's ratio."""
    thickness_um: PositiveFloat = Field(le=10_000)
    """Thickness (µm). It must be at least the spacing of the points of the scans."""


class Validation(Section):
    """Comparison of the predicted with the measured loss of height."""

    resamples: int = Field(9999, ge=99, le=100_000)
    """Number of bootstrap resamples of the patches, and of control draws."""
    max_gain_to_loss_ratio: PositiveFloat = Field(0.2, le=1)
    """Largest ratio of gained to lost area at which the loss of a patch is above the noise. Errors
    at T0 require this limit: points that are too high by error are predicted to wear, and seem to
    be lost at T1."""
    expected_most_worn: Texts = []
    """Patches that were expected, before the analysis, to be the most worn. This is tested if the
    patch table contains all of them. Empty for none."""


class Settings(Section):
    """The settings of one study, as in its config file. Each key has a default.

    The keys of lengths, forces and pressures end with their unit. A value of another type or beyond
    its bounds, an unknown key and contradictory values raise a `pydantic.ValidationError` that
    lists them all.

    Examples
    --------
    >>> settings = Settings(square={"size_mm": 4.0}, load={"pressure_MPa": 22.0})
    >>> settings.square.size_mm, settings.load.force_N, settings.wear_steps
    (4.0, None, 5)
    """

    results: str = Field("results", min_length=1, pattern="^[A-Za-z0-9._/-]+$")
    """Folder for all results of the study. Its name may contain letters without accents, digits,
    and . _ - /"""
    title: str = Field("synthetic specimen", min_length=1)
    """Name of the specimen, shown at the head of the page."""
    seed: NonNegativeInt = 1
    """Seed of all random draws of the analysis (bootstrap, permutations, intervals)."""
    accept: Texts = Field(
        [],
        description="Faults that do not stop the study. Each message gives the name of its fault. "
        "A name accepts the fault everywhere, and name:patch (such as placement:loc3) accepts it "
        "for one patch. The page then shows the fault above the answer. The faults: "
        + "; ".join(f"{name} ({meaning})" for name, meaning in FAULTS.items())
        + ".",
    )
    patches: str | None = "config/patches.tsv"
    """Patch table (TSV or CSV) with one row per scanned patch; see config/README.md. Null if no
    scans exist yet: the study then presses the mesh alone and proposes positions to scan."""
    published: str | None = None
    """CSV file of published figures, which are printed beside the computed ones, or null."""
    coupling: Literal["equilibrium", "paper"] = "equilibrium"
    """Coupling of the two scales. With equilibrium, the scans are positioned on the mesh and
    pressed with it at the macroscale. Each patch keeps its plane in the stone and yields to the
    pressures around it. The coupling of the paper is solved, too, for comparison. With paper, the
    mesh is pressed without the scans, and each patch as its scan was levelled."""
    reference_realisations: int | None = Field(4, ge=1, le=1000)
    """Number of contacts of the whole square at the scans' resolution, which measure the error of
    the coupling. Each draws the unscanned detail anew. The surface of a synthetic specimen is known
    and pressed once. Each contact takes about 20 s and 1.7 GB for 3000 × 3000 points. Null, and the
    coupling of the paper, skip this comparison."""
    max_plotted_patches: int = Field(40, ge=1, le=10_000)
    """Largest number of patches that have figures of their own, or a panel in a figure. If there
    are more, a selection is drawn, in even steps from the most to the least loaded. Tables list all
    patches."""
    inputs: Inputs | None = None
    specimen: Specimen | None = Specimen()
    square: Square = Square()
    material: Material = Material()
    load: Load = Load(force_N=550.0)
    macroscale: Macroscale = Macroscale()
    scans: Scans = Scans()
    preprocessing: Preprocessing = Preprocessing()
    registration: Registration = Registration()
    detection: DetectionSettings = DetectionSettings()
    texture: Texture = Texture()
    uncertainty: Uncertainty = Uncertainty()
    selection: Selection = Selection()
    microscale: Microscale = Microscale()
    counterface: Counterface | None = Counterface(radius_mm=200.0)
    gesture: Gesture | None = None
    grinding: Grinding | None = Grinding()
    pressure_cap_MPa: PositiveFloat | None = Field(2000.0, le=100_000)
    """Pressure cap: the largest pressure that an element carries (MPa). cases.csv compares the
    capped contact of each patch. Null for no cap."""
    wear_steps: int = Field(5, ge=1, le=100)
    """Number of steps of Archard's law in which square and patches wear down to the measured
    losses. The error is inversely proportional to this number."""
    wear_law: WearLaw = WearLaw()
    use: Use | None = Use()
    interlayer: Interlayer | None = None
    validation: Validation = Validation()

    @model_validator(mode="after")
    def _refuse_contradictions(self) -> Self:
        faults = [
            InitErrorDetails(
                type=PydanticCustomError("contradiction", "{text}", {"text": text}),
                input=None,
            )
            for text in contradictions(self)
        ]
        if faults:
            raise ValidationError.from_exception_data("Settings", faults)
        return self

    def by_stage(self) -> dict[str, dict[str, Any]]:
        """The arguments of the function of each stage, by the name of the stage."""
        config = self.model_dump()
        modulus = study_modulus(config["material"])
        return self._of_face(config, modulus) | self._of_patches(config, modulus)

    def _of_face(
        self, config: Mapping[str, Any], modulus: float
    ) -> dict[str, dict[str, Any]]:
        """The arguments of the stages that handle the whole face."""
        square, macroscale, errors = self.square, self.macroscale, self.uncertainty
        patch_mm, seed = self.scans.size_mm, self.seed
        at_load = {
            "modulus": modulus,
            "tolerance": macroscale.tolerance,
            "force_N": load_force(config["load"], square.size_mm),
        }
        # The square of the paper stays on its mean plane and is pressed by a flat.
        load_point, face_mm = None, None
        if self.coupling == "equilibrium":
            load_point = resolved_load_point(config["load"], square.size_mm)
            face_mm = macroscale.face_mm
        use = dict(config["use"] or {})
        strikes = {name: use.pop(name) for name in ("scatter_mm", "stroke_mm") if use}
        return {
            "grid_macroscale": {
                **config["square"],
                "grid": macroscale.grid,
                "interpolation": macroscale.interpolation,
                "face_mm": face_mm,
            },
            "compose_surface": {
                "patch_mm": patch_mm,
                "s_filter_um": self.microscale.s_filter_um,
                "placement_um": errors.placement_um,
                "seed": seed,
            },
            "infer_use": {
                "stated": {
                    "force_N": at_load["force_N"],
                    "load_point": load_point,
                    "load_point_mm": errors.load_point_mm,
                    "radius_mm": study_radius(config),
                    "radius_log_sd": errors.radius_log_sd,
                    **strikes,
                },
                "modulus": modulus,
                "patch_mm": patch_mm,
                "sampling": use | {"seed": seed},
                "wear_law": config["wear_law"],
            },
            "solve_macroscale": at_load | {"load_point": load_point},
            "solve_square": at_load,
        }

    def _of_patches(
        self, config: Mapping[str, Any], modulus: float
    ) -> dict[str, dict[str, Any]]:
        """The arguments of the stages that handle the scanned patches."""
        patch_mm, validation = self.scans.size_mm, self.validation
        return {
            "prepare_scans": {
                name: config[name] for name in ("scans", "preprocessing")
            },
            "couple_scales": {"patch_mm": patch_mm},
            "check_placement": {
                "patch_mm": patch_mm,
                "placement_um": self.uncertainty.placement_um,
                "accept": self.accept,
                **config["scans"]["mould"],
            },
            "register_patches": config["registration"] | config["detection"],
            "select_patches": {
                "selection": config["selection"],
                "max_gain_to_loss_ratio": validation.max_gain_to_loss_ratio,
            },
            "solve_patches": config["microscale"] | {"contact_modulus_MPa": modulus},
            "fit_wear": {
                "patch_mm": patch_mm,
                "steps": self.wear_steps,
                "interlayer": config["interlayer"],
                "wear_law": config["wear_law"],
            },
            "predict_wear": {"pressure_cap": self.pressure_cap_MPa},
            "score_wear": {
                "expected_most_worn": validation.expected_most_worn,
                "seed": self.seed,
                "resamples": validation.resamples,
            },
        }


def json_schema() -> dict[str, Any]:
    """The JSON schema of a config, with sections in place and a list for several types.

    Examples
    --------
    >>> json_schema()["properties"]["wear_steps"]["maximum"]
    100
    """
    schema = Settings.model_json_schema()
    definitions = schema.pop("$defs")

    def in_place(rule: Any) -> Any:
        if isinstance(rule, list):
            return [in_place(part) for part in rule]
        if not isinstance(rule, dict):
            return rule
        rule = dict(rule)
        if name := rule.pop("$ref", "").rpartition("/")[2]:
            rule = definitions[name] | rule
        rule = {key: in_place(part) for key, part in rule.items()}
        if several := rule.pop("anyOf", None):
            rule = _merged(several) | rule
        if "enum" in rule:  # which says the type, too
            rule.pop("type", None)
        if text := rule.get("description"):
            rule["description"] = " ".join(text.split())
        return rule

    return in_place(schema)


def _merged(rules: list[dict[str, Any]]) -> dict[str, Any]:
    """One rule for values that match one of several rules."""
    merged = {key: part for rule in rules for key, part in rule.items()}
    types = [rule["type"] for rule in rules]
    return merged | {"type": types if types[1:] else types[0]}
