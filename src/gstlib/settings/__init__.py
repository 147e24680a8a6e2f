"""The settings of a study: every key of its config, typed and checked.

`Settings` is the only source of the keys, their types, bounds, defaults and meanings. The schema of
a config (`json_schema`), the defaults and config/README.md are derived from it.
"""

from typing import Any, Literal, Self

from pydantic import Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from gstlib.conditions import (
    load_force,
    resolved_load_point,
    study_modulus,
    study_radius,
)
from gstlib.errors import FAULTS
from gstlib.settings.contradictions import contradictions
from gstlib.settings.sections import (
    Counterface,
    DetectionSettings,
    Gesture,
    Grinding,
    Inputs,
    Interlayer,
    Load,
    Macroscale,
    Material,
    Microscale,
    Preprocessing,
    Registration,
    Scans,
    Section,
    Selection,
    Specimen,
    Square,
    Texts,
    Texture,
    Uncertainty,
    Use,
    Validation,
    WearLaw,
)

__all__ = ["Settings", "json_schema"]


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
    seed: int = Field(1, ge=0)
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
    pressure_cap_MPa: float | None = Field(2000.0, gt=0, le=100_000)
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
        modulus = study_modulus(self.material.model_dump())
        return self._of_macroscale(modulus) | self._of_patches(modulus)

    def _of_macroscale(self, modulus: float) -> dict[str, dict[str, Any]]:
        """The arguments of the stages that handle the whole face."""
        size_mm = self.square.size_mm
        patch_mm = self.scans.size_mm
        load = self.load.model_dump()
        force_N = load_force(load, size_mm)
        tolerance = self.macroscale.tolerance
        at_load = {"modulus": modulus, "tolerance": tolerance, "force_N": force_N}
        # The square of the paper stays on its mean plane and is pressed by a flat.
        load_point, face_mm = None, None
        if self.coupling == "equilibrium":
            load_point = resolved_load_point(load, size_mm)
            face_mm = self.macroscale.face_mm
        errors = self.uncertainty
        use = {} if self.use is None else self.use.model_dump()
        strikes = {name: use.pop(name) for name in ("scatter_mm", "stroke_mm") if use}
        return {
            "grid_macroscale": {
                **self.square.model_dump(),
                "grid": self.macroscale.grid,
                "interpolation": self.macroscale.interpolation,
                "face_mm": face_mm,
            },
            "compose_surface": {
                "patch_mm": patch_mm,
                "s_filter_um": self.microscale.s_filter_um,
                "placement_um": errors.placement_um,
                "seed": self.seed,
            },
            "infer_use": {
                "stated": {
                    "force_N": force_N,
                    "load_point": load_point,
                    "load_point_mm": errors.load_point_mm,
                    "radius_mm": study_radius(self.model_dump()),
                    "radius_log_sd": errors.radius_log_sd,
                    **strikes,
                },
                "modulus": modulus,
                "patch_mm": patch_mm,
                "sampling": use | {"seed": self.seed},
                "wear_law": self.wear_law.model_dump(),
            },
            "solve_macroscale": at_load | {"load_point": load_point},
            "solve_square": at_load,
        }

    def _of_patches(self, modulus: float) -> dict[str, dict[str, Any]]:
        """The arguments of the stages that handle the scanned patches."""
        patch_mm = self.scans.size_mm
        return {
            "prepare_scans": {
                "scans": self.scans.model_dump(),
                "preprocessing": self.preprocessing.model_dump(),
            },
            "couple_scales": {"patch_mm": patch_mm},
            "check_placement": {
                "patch_mm": patch_mm,
                "placement_um": self.uncertainty.placement_um,
                "accept": self.accept,
                **self.scans.mould.model_dump(),
            },
            "register_patches": self.registration.model_dump()
            | self.detection.model_dump(),
            "select_patches": {
                "selection": self.selection.model_dump(),
                "max_gain_to_loss_ratio": self.validation.max_gain_to_loss_ratio,
            },
            "solve_patches": self.microscale.model_dump()
            | {"contact_modulus_MPa": modulus},
            "fit_wear": {
                "patch_mm": patch_mm,
                "steps": self.wear_steps,
                "interlayer": self.interlayer and self.interlayer.model_dump(),
                "wear_law": self.wear_law.model_dump(),
            },
            "predict_wear": {"pressure_cap": self.pressure_cap_MPa},
            "score_wear": {
                "expected_most_worn": self.validation.expected_most_worn,
                "seed": self.seed,
                "resamples": self.validation.resamples,
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
        if isinstance(rule.get("enum"), list):  # which says the type, too
            rule.pop("type", None)
        if isinstance(text := rule.get("description"), str):
            rule["description"] = " ".join(text.split())
        return rule

    return in_place(schema)


def _merged(rules: list[dict[str, Any]]) -> dict[str, Any]:
    """One rule for values that match one of several rules."""
    merged = {key: part for rule in rules for key, part in rule.items()}
    types = [rule["type"] for rule in rules]
    return merged | {"type": types if types[1:] else types[0]}
