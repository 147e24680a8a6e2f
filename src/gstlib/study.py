"""The method: every stage of the study as one pure function, and the stages strung together.

Read it from top to bottom. It follows section 2 of Marulli, Sorrentino & Paggi (2024, J. Archaeol.
Sci. Rep. 104939) and goes on where the paper stops:

1. The square of the tool's mesh becomes heights on a grid (`grid_macroscale`). The scans, cleaned
   (`prepare_scan`), are laid on it where they were taken (`compose_surface`). The whole is pressed
   against a flat up to the target pressure (`solve_macroscale`), or against a second stone, whose
   mesh was posed on it; in other poses, too (`gstlib.gesture`).
2. Each scanned patch carries the macroscale forces in its outline (`couple_scales`): a pressure
   with an interval (`bound_pressures`). `place_patches` checks where the patches lie.
3. T1 is registered to T0, which gives the height that use took away (`register_patch`).
   `select_patches` tells which patches enter the study.
4. Each patch, as it lies on the stone (`place_patch`), is pressed at the scan's resolution up to
   its own pressure (`solve_patch`). Another contact modulus, stick and slip, and a ceiling on the
   pressure are further cases (`gstlib.cases`).
5. Predicted contact is scored against measured loss (`score_patches`), and the texture is measured
   before and after use (`measure_texture`).
6. The square and its patches wear by Archard's law (`wear_square`). The loss that it predicts for a
   patch from the loss of the others (`predict_wear`) is compared with the measured one
   (`score_wear`).

Two variants of the coupling exist. In the paper's, `levelled`, the mesh alone makes the square, and
a patch is pressed as its scan was levelled. In `placed`, the scans enter the square, and a patch
keeps its plane in the stone and yields to the pressures around it. Both are held against one
contact of the whole square at the scans' resolution (`solve_reference`, `compare_scales`).

The functions take and return datasets and tables, and read and write no file of results: the
workflow's scripts do, one stage each. `Study` runs the same stages in memory, for sweeps over
settings and for many generated specimens. Each function imports what it needs by itself: a job then
loads no more than its own stage.

Lengths are in mm and pressures in MPa unless a name says otherwise. Arguments mean the same
everywhere: `surface`, `contact`, `pressures`, `change` are what an earlier stage returns; `patches`
is the patch table; `square`, `material`, `scans`, ... are the config's sections of that name, and
other keywords are its keys; `patch_mm` is the side of a patch; `source` is the file that a dataset
comes from, for error messages.
"""

import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.io.results import columns_of

if TYPE_CHECKING:
    import trimesh

    from gstlib.validation.scoring import PatchScores

__all__ = [
    "STUDY_SECTIONS",
    "Study",
    "bound_pressures",
    "compare_scales",
    "compose_surface",
    "couple_scales",
    "fit_mat",
    "grid_macroscale",
    "gridding_table",
    "levelled_patch",
    "measure_texture",
    "microscale_tables",
    "place_patch",
    "place_patches",
    "predict_wear",
    "prepare_scan",
    "preprocessing_table",
    "register_patch",
    "registration_table",
    "score_patches",
    "score_wear",
    "select_patches",
    "solve_macroscale",
    "solve_patch",
    "solve_reference",
    "wear_square",
]

# The sections of the config that the stages of `Study` depend on, besides `seed`.
STUDY_SECTIONS = (
    "coupling",
    "square",
    "material",
    "macroscale",
    "scans",
    "preprocessing",
    "registration",
    "traces",
    "texture",
    "uncertainty",
    "selection",
    "microscale",
    "validation",
    "wear_steps",
    "mat",
)
# Which pressure of a patch each variant takes, of `couple_scales`.
PRESSURES = {"placed": "pressure_MPa", "levelled": "mesh_pressure_MPa"}
# How much deeper, or shallower, the dales of T1 may be than those of T0 before a warning. Wear of a
# quarter of a patch makes them a tenth shallower (generated specimen).
_ODD_HEIGHTS = 1.25


# --- The square -------------------------------------------------------------------------------


def grid_macroscale(
    mesh: "trimesh.Trimesh",
    *,
    square: Mapping,
    grid: int,
    source: str | Path,
    counterface: Mapping | None = None,
    **settings: Any,
) -> xr.Dataset:
    """Heights of the use-face over the analysed square, its plane removed (section 2.1).

    Settings and result are those of `gstlib.preprocess.gridding.grid_mesh`; the frame is in the
    attributes of the result. Of a second stone, `counterface` has the ``mesh``,
    its ``pose``, its ``source`` and ``reach_mm``, as of `gstlib.counterface.grid_counterface`; of
    the result, ``counterface`` (y, x) is its face over the square and ``face`` (face_y, face_x)
    also that around it.
    """
    from gstlib.counterface import face_in_pose, grid_counterface
    from gstlib.coupling import Place
    from gstlib.preprocess.frame import find_frame
    from gstlib.preprocess.gridding import grid_mesh
    from gstlib.preprocess.leveling import remove_plane

    frame = find_frame(square, mesh, source=str(source))
    gridded = grid_mesh(
        mesh,
        frame,
        size_mm=square["size_mm"],
        shape=(grid, grid),
        source=str(source),
        **settings,
    )
    height, _ = remove_plane(gridded.height)
    if counterface is not None:
        names = ("margin_mm", "interpolation")
        of_both = {name: settings[name] for name in names if name in settings}
        face = grid_counterface(surface=gridded.height, frame=frame, **counterface, **of_both)
        over = face_in_pose(face, gridded.height, Place(0.0, 0.0, 0.0))
        face = face.rename(y="face_y", x="face_x")
        gridded = gridded.assign(counterface=over, face=face)
    return gridded.assign(height=height).assign_attrs(
        origin_mm=frame.origin, x_axis=frame.x_axis, normal=frame.normal
    )


def gridding_table(surface: xr.Dataset) -> pd.DataFrame:
    """How well each interpolation predicts vertices left out of the mesh, and which was chosen.

    `surface` is that of `grid_macroscale`, with ``left_out_rms``. The result has
    ``interpolation, left_out_rms_um, chosen``.
    """
    return pd.DataFrame(
        {
            "interpolation": surface.candidate.values,
            "left_out_rms_um": 1e3 * surface.left_out_rms.values,
            "chosen": surface.candidate.values == surface.height.attrs["interpolation"],
        }
    )


def compose_surface(
    surface: xr.Dataset,
    patches: pd.DataFrame,
    heights: Iterable[tuple[str, xr.DataArray]],
    *,
    patch_mm: float,
    s_filter_um: float | None,
    **settings: Any,
) -> xr.Dataset:
    """Lay the T0 scans on the mesh's surface, with detail like theirs between them.

    `heights` are pairs of a patch and its prepared heights, in the table's order. Settings and
    result are those of `gstlib.composite.compose_surface`.
    """
    from gstlib.composite import compose_surface
    from gstlib.preprocess.filtering import s_filtered

    composite = compose_surface(
        surface,
        patches,
        ((patch, s_filtered(height, s_filter_um)) for patch, height in heights),
        patch_mm=patch_mm,
        **settings,
    )
    return composite.assign(surface[["counterface", "face"]] if "face" in surface else {})


def solve_macroscale(
    surface: xr.Dataset, *, source: str | Path = "macroscale", **settings: Any
) -> xr.Dataset:
    """Press the square against a flat, step by step, up to the target pressure (section 2.4).

    Settings and result are those of `gstlib.contact.contact_path`, pressure and gap at every step.
    """
    from gstlib.contact import contact_path, faces_of

    return contact_path(faces_of(surface), source=source, every_step=True, **settings)


# --- From the square to its patches -----------------------------------------------------------


def couple_scales(
    contact: xr.Dataset,
    mesh_contact: xr.Dataset,
    patches: pd.DataFrame,
    *,
    patch_mm: float,
) -> pd.DataFrame:
    """Pressure of each patch: the macroscale forces in its outline over its area (section 2.3).

    `contact` is the square's at the target pressure, and `mesh_contact` that of the mesh alone. The
    result is that of `gstlib.coupling.patch_pressures` with ``mesh_pressure_MPa``, the pressure by
    the mesh alone.
    """
    from gstlib.coupling import patch_pressures

    pressures = patch_pressures(contact.pressure, patches, size_mm=patch_mm)
    by_mesh = patch_pressures(mesh_contact.pressure, patches, size_mm=patch_mm)
    return pressures.assign(mesh_pressure_MPa=by_mesh.pressure_MPa)


def bound_pressures(
    surface: xr.Dataset,
    composite: xr.Dataset | None,
    pressures: pd.DataFrame,
    *,
    material: Mapping[str, float],
    uncertainty: Mapping[str, float],
    seed: int,
    **settings: Any,
) -> pd.DataFrame:
    """95 % intervals of the patches' pressures, and how well the mesh knows their planes.

    Settings and result are those of `gstlib.uncertainty.pressure_intervals`.
    """
    from gstlib.uncertainty import draw_contact_moduli, pressure_intervals

    shares = draw_contact_moduli(
        material,
        young_share=uncertainty["young_share"],
        poisson=uncertainty["poisson"],
        generator=np.random.default_rng(seed),
    )
    settings |= {name: uncertainty[name] for name in ("placement_um", "pose_um")} | {
        "seed": seed
    }
    return pressure_intervals(surface, composite, pressures, shares, **settings)


def place_patches(
    surface: xr.Dataset,
    patches: pd.DataFrame,
    heights: Mapping[str, xr.DataArray],
    *,
    patch_mm: float,
) -> pd.DataFrame:
    """Hold each patch against the square under it.

    `heights` (y, x) are those of the prepared T0 scans, by patch. The result is that of
    `gstlib.placement.place_patches`.
    """
    from gstlib.placement import place_patches

    return place_patches(surface.height, patches, heights, size_mm=patch_mm)


# --- The scans --------------------------------------------------------------------------------


def prepare_scan(
    raw: xr.DataArray,
    *,
    crop: Sequence[float] | None,
    scans: Mapping,
    preprocessing: Mapping,
) -> xr.Dataset:
    """Cut the patch out of a scan, undo the mould, replace outliers, fill and level (section 2.2).

    `raw` comes from `gstlib.io.scans.read_scan`; `crop` is the centre (x, y) of the piece to cut,
    None for a whole scan. The result is that of `gstlib.preprocess.scan.prepare_scan`.
    """
    from gstlib.io.scans import cut_scan
    from gstlib.preprocess.scan import prepare_scan

    raw, mould = cut_scan(raw, crop, scans["size_mm"]), scans["mould"]
    return prepare_scan(
        raw, mould_invert=mould["invert"], mould_flip=mould["flip"], **preprocessing
    )


def preprocessing_table(scans: Mapping[tuple[str, str], Mapping]) -> pd.DataFrame:
    """What was done to each scan, from the attributes of its dataset, by patch and epoch."""
    columns = columns_of("preprocessing")
    rows = [(*scan, *(attrs[name] for name in columns[2:])) for scan, attrs in scans.items()]
    return pd.DataFrame(rows, columns=columns)


def register_patch(
    before: xr.Dataset,
    after: xr.Dataset,
    *,
    patch: str,
    maximum_shift_mm: float,
    minimum_points: int,
) -> xr.Dataset:
    """Register T1 to T0 and take the height change.

    `before` and `after` are prepared scans with ``height``, ``filled`` and ``outlier``. The result
    is that of `gstlib.validation.change.height_change`, with the registration as attributes.
    """
    from gstlib.errors import InputError
    from gstlib.validation.change import measured_change

    try:
        registration, change = measured_change(
            before, after, maximum_shift_mm=maximum_shift_mm, minimum_points=minimum_points
        )
    except InputError as error:  # it names the epoch, but not the patch
        source = f"patch {patch}, {error.source}"
        raise InputError(source, error.problem, error.remedy) from error
    log = logging.getLogger("gstlib")
    scale = registration.height_scale
    if registration.found and max(scale, 1 / scale) > _ODD_HEIGHTS:
        log.warning(
            "patch %s: its dales at T1 are %.3g times as deep as at T0. If that is not wear all "
            "over the patch, the heights of one scan are calibrated otherwise: measured wear is "
            "then wrong",
            patch,
            scale,
        )
    if registration.found and not change.attrs["known_share"]:
        log.warning(
            "patch %s: hardly any point has a height of its own at T0 and at T1 (%.0f %% and "
            "%.0f %% of the scans are holes or outliers, T1 covers %.0f %% of T0), so its wear is "
            "not known. Scan it again, or leave its t1 empty.",
            patch,
            *(
                100 * (epoch.filled | epoch.outlier).values.mean()
                for epoch in (before, after)
            ),
            100 * registration.overlap,
        )
    return change.assign_attrs(registration.as_attrs())


def registration_table(
    changes: Iterable[tuple[str, xr.Dataset]], selection: Mapping[str, float]
) -> pd.DataFrame:
    """How well T1 matches T0 on each patch, how much was lost, and which patches that excludes.

    `changes` are pairs of a patch and its height change.
    """
    from gstlib.validation.change import wear_summary

    rows = []
    for patch, change in changes:
        found = bool(change.attrs["registration_found"])
        rows.append({**change.attrs, **wear_summary(change), "patch": patch, "found": found})
    # what is excluded, and why, follows from the rest
    table = pd.DataFrame(rows, columns=columns_of("registration")[:-2])
    # the pressures have a table of their own: here all pass
    rules = {**selection, "minimum_pressure_MPa": 0.0}
    judged = select_patches(table.assign(pressure_MPa=1.0), table, rules)
    return table.assign(excluded=~judged.in_study, reason=judged.reason)


def select_patches(
    pressures: pd.DataFrame, registration: pd.DataFrame, selection: Mapping[str, float]
) -> pd.DataFrame:
    """Which patches enter the study, by their pressure and by how well T1 matches T0.

    Patches that `registration` (from `registration_table`) lacks have no T1: their pressure alone
    decides. The result is `pressures` with ``in_study`` and ``reason``, empty where a patch is in.
    """
    known = registration.set_index("patch").to_dict("index")
    pressure_MPa = selection["minimum_pressure_MPa"]
    reasons = []
    for row in pressures.itertuples(index=False):
        found = []
        if not row.pressure_MPa > 0:
            found.append("no macroscale contact")
        elif row.pressure_MPa < pressure_MPa:
            found.append(f"pressure {row.pressure_MPa:.3g} below {pressure_MPa:g} MPa")
        match = known.get(row.patch, {"found": True})
        values = {"overlap": match.get("overlap")}
        if match[
            "found"
        ]:  # of the detail: the long waves of a stone match wherever T1 is laid
            values["correlation"] = match.get("detail_correlation")
        else:
            found.append("T1 was not found on T0")
        for name, value in values.items():
            if value is not None and value < (least := selection[f"minimum_{name}"]):
                found.append(f"T0/T1 {name} {value:.2f} below {least:.2f}")
        reasons.append("; ".join(found))
    return pressures.assign(in_study=[not text for text in reasons], reason=reasons)


# --- The patches ------------------------------------------------------------------------------


def levelled_patch(
    surface: xr.Dataset,
    counterface: xr.Dataset | None,
    *,
    s_filter_um: float | None,
    source: str | Path = "patch",
) -> xr.Dataset:
    """A patch as its scan was levelled, through the S-filter, and the face pressed on it.

    `surface` and `counterface` have ``height`` (y, x); without a counterface, the active stone is
    flat. The result has ``height`` and, if there is one, ``counterface``.
    """
    from gstlib.contact import turned_over
    from gstlib.preprocess.filtering import s_filtered

    faces = {"height": s_filtered(surface.height, s_filter_um)}
    if counterface is not None:
        face = s_filtered(counterface.height, s_filter_um)
        faces["counterface"] = turned_over(
            face, surface.height, source="counterface", patch_source=source
        )
    return xr.Dataset(faces)


def place_patch(
    faces: xr.Dataset, composite: xr.Dataset, contact: xr.Dataset, patch: str
) -> xr.Dataset:
    """A patch of `levelled_patch` as it lies on the stone, among the pressures around it.

    `contact` is the square's at the target pressure. The result adds ``surroundings`` (y, x), the
    displacement by the macroscale pressures outside the outline, mm, and the slopes of the patch's
    plane as attributes ``slope_y`` and ``slope_x``. Of a second stone, ``counterface`` is its face
    over the patch; where that was scanned, the scan, laid on the plane of this face.
    """
    from gstlib.coupling import Place, on_patch, spline_of, surroundings
    from gstlib.preprocess.leveling import remove_plane

    at, patch_mm = composite.sel(patch=patch), composite.attrs["patch_mm"]
    place = Place(*(float(at[name]) for name in ("y_mm", "x_mm", "rotation_deg")))
    displaced = surroundings(
        contact.pressure,
        place,
        faces.height.shape,
        size_mm=patch_mm,
        contact_modulus_MPa=contact.attrs["contact_modulus_MPa"],
    )
    long_name = "displacement by the macroscale pressures outside the patch"
    variable = ("y", "x"), displaced, {"units": "mm", "long_name": long_name}
    if "counterface" in composite:
        spline = spline_of(composite.counterface)
        over = faces.height.copy(data=on_patch(spline, place, faces.height.shape, patch_mm))
        if "counterface" in faces:
            over = faces.counterface + (over - remove_plane(over)[0])
        attrs = {"units": "mm", "long_name": "height of the counterface over the patch"}
        faces = faces.assign(counterface=over.assign_attrs(attrs))
    return faces.assign(surroundings=variable).assign_attrs(
        slope_y=float(at.slope_y), slope_x=float(at.slope_x)
    )


def solve_patch(
    faces: xr.Dataset, *, source: str | Path = "patch", **settings: Any
) -> xr.Dataset:
    """Press a patch, step by step, up to its own pressure (section 2.4).

    Settings and result are those of `gstlib.contact.contact_path`, with ``interface_stiffness``.
    """
    from gstlib.contact import contact_path, interface_stiffness

    contact = contact_path(faces, source=source, **settings)
    return contact.assign(interface_stiffness=interface_stiffness(contact))


def solve_reference(
    heights: xr.DataArray,
    counterface: xr.DataArray | None = None,
    *,
    source: str | Path = "reference",
    **settings: float,
) -> xr.Dataset:
    """One contact of the whole square at the scans' resolution, at the target pressure.

    `counterface` (y, x) is the second stone's face on the macroscale grid, if there is one.
    Settings are those of `gstlib.contact.contact_at_pressure`. The result has ``height`` mm and
    ``pressure`` MPa (y, x), in single precision.
    """
    from gstlib.contact import contact_at_pressure
    from gstlib.coupling import spline_of
    from gstlib.preprocess.leveling import remove_plane
    from gstlib.reference import TOLERANCE

    level = remove_plane(heights)[0].assign_attrs(heights.attrs).to_dataset(name="height")
    if counterface is not None:
        over = spline_of(counterface)(heights.y.values, heights.x.values)
        level["counterface"] = level.height.copy(data=over)
    contact = contact_at_pressure(level, source=source, tolerance=TOLERANCE, **settings)
    return contact[["height", "pressure"]].astype(np.float32)


def compare_scales(
    contacts: Mapping[str, Iterable[tuple[str, xr.Dataset]]],
    reference: xr.Dataset,
    *,
    rim: float,
) -> pd.DataFrame:
    """Contact of the patches, by variant, against the single-scale contact.

    Parameters and result are those of `gstlib.reference.two_scales_table`.
    """
    from gstlib.reference import two_scales_table

    return two_scales_table(contacts, reference, rim=rim)


def microscale_tables(
    contacts: Iterable[tuple[str, xr.Dataset]],
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The state of each patch at its own pressure, and its load path.

    `contacts` are pairs of a patch and its contact. The residual is given as the power of ten that
    it is below: its digits are rounding, which differs from processor to processor.
    """
    from gstlib.contact import load_path_table

    path, state = columns_of("microscale_paths"), columns_of("microscale_summary")
    states, paths = [], [pd.DataFrame(columns=path)]
    for patch, contact in contacts:
        steps = load_path_table(contact).assign(patch=patch)
        residual = float(contact.residual[-1])
        states.append(
            steps.iloc[-1].to_dict()
            | {
                "target_pressure_MPa": contact.attrs["target_pressure_MPa"],
                "residual": 10.0 ** math.ceil(math.log10(residual)) if residual > 0 else 0.0,
            }
        )
        paths.append(steps[path])
    return pd.DataFrame(states, columns=state), pd.concat(
        paths[1:] or paths, ignore_index=True
    )


# --- Was the prediction right? ----------------------------------------------------------------


def score_patches(
    patches: Mapping[str, Iterable[tuple[str, xr.Dataset, xr.Dataset]]],
    pressures: pd.DataFrame,
    microscale: pd.DataFrame,
    *,
    worst: Sequence[str],
    seed: int,
    resamples: int,
    **settings: Any,
) -> dict[str, pd.DataFrame]:
    """Score predicted contact against measured loss, patch by patch and over the patches.

    Parameters
    ----------
    patches : mapping of str to iterable of (patch, xarray.Dataset, xarray.Dataset)
        By variant, the study's own first: contact and height change of each patch in the study.
    pressures, microscale : pandas.DataFrame
        From `select_patches`, for the places, with ``exposure_N_per_mm`` of a gesture, if there is
        one; the first table of `microscale_tables`.
    worst : sequence of str
        Patches that were said beforehand to be the worst worn.

    Returns
    -------
    dict of pandas.DataFrame
        ``patches``, ``gains`` and ``summary`` of the study's own variant, and
        ``variants``, the mean scores of all.
    """
    from gstlib.validation.scoring import patch_tables, score_patch
    from gstlib.validation.summary import summarise

    chance: dict[str, Any] = {"seed": seed, "resamples": resamples}
    by_variant: dict[str, list[PatchScores]] = {}
    for variant, of_variant in patches.items():
        if by_variant:  # chance is that of the study's own variant
            settings = settings | {"shifts": 0}
        by_variant[variant] = [
            score_patch(patch, contact, change, **chance, **settings)
            for patch, contact, change in of_variant
        ]
    found = next(iter(by_variant.values()))
    for warning in filter(None, (one.warning for one in found)):
        logging.getLogger("gstlib").warning("%s", warning)
    predicted = microscale[["patch", "mean_pressure_MPa", "stiffness_MPa_per_um"]].rename(
        columns={"mean_pressure_MPa": "pressure_MPa"}
    )
    known = [name for name in ("x_mm", "y_mm", "exposure_N_per_mm") if name in pressures]
    predicted = predicted.merge(pressures[["patch", *known]], on="patch")
    summary, variants = summarise(by_variant, predicted, expected_worst=worst, **chance)
    return patch_tables(found) | {"summary": summary, "variants": variants}


def wear_square(
    contact: xr.Dataset,
    pressures: pd.DataFrame,
    scores: pd.DataFrame,
    *,
    mat: Mapping[str, float] | None = None,
    source: str | Path = "macroscale",
    **settings: Any,
) -> xr.Dataset | None:
    """Wear the square by Archard's law, and fit its coefficient to the measured losses.

    `contact` is the square's at the target pressure; `scores` is the table ``patches`` of
    `score_patches`, whose believed losses count; `mat` is that section of the config. Settings and
    result are those of `gstlib.wear.wear_square`; None, with a warning, where there is no fit.
    """
    from gstlib.bem import Layer
    from gstlib.errors import InputError
    from gstlib.wear import wear_square

    layer = (
        Layer(mat["young_MPa"], mat["poisson"], mat["thickness_um"] * 1e-3) if mat else None
    )

    lost = scores[scores.believed.astype(bool)].set_index("patch").loss_per_area_um.dropna()
    under_load = pressures.set_index("patch").pressure_MPa[lost.index] > 0
    try:
        if ((lost > 0) & under_load).sum() < 2:
            problem = "fewer than two patches under load lost height, so that its coefficient"
            raise InputError(
                source, f"{problem} cannot be fitted to some and tested on others", ""
            )
        return wear_square(
            contact, pressures, lost.to_dict(), mat=layer, source=source, **settings
        )
    except InputError as error:
        logging.getLogger("gstlib").warning("wear is not predicted: %s", error.problem)
        return None


def fit_mat(
    square: xr.Dataset, patches: Iterable[tuple[str, xr.Dataset, xr.Dataset]]
) -> xr.Dataset:
    """Fit the coefficient of what is between the stones to the maps of loss of all patches but one.

    `patches` are those of a patch, its contact and its height change. The result is that of
    `gstlib.wear.fit_mat`; without a mat it is `square`.
    """
    from gstlib.wear import fit_mat, mat_misfits

    if "mat_pressure" not in square:
        return square
    found = {
        patch: mat_misfits(contact, change, square, patch)
        for patch, contact, change in patches
    }
    return fit_mat(square, found)


def predict_wear(contact: xr.Dataset, square: xr.Dataset, patch: str) -> xr.Dataset:
    """A patch's loss and its heights after use, as the other patches predict them.

    `square` is from `fit_mat`; the result is that of `gstlib.wear.wear_map`.
    """
    from gstlib.wear import wear_map

    return wear_map(contact, square, patch)


def score_wear(
    patches: Iterable[tuple[str, xr.Dataset, xr.Dataset, xr.Dataset]],
    square: xr.Dataset,
    pressures: pd.DataFrame,
    *,
    seed: int,
    resamples: int,
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Predicted against measured loss of each patch, and what the prediction is worth.

    `patches` are those of a patch, its contact, its height change and its `predict_wear`; `square`
    is from `fit_mat`. The tables are those of `gstlib.validation.wear_scores.wear_table` and
    `gstlib.validation.wear_scores.wear_summary`.
    """
    from gstlib.validation.wear_scores import wear_summary, wear_table

    table, profile = wear_table(patches, square, pressures)
    summary = wear_summary(table, profile, square, seed=seed, resamples=resamples)
    return table, profile, summary


def measure_texture(
    patches: Iterable[tuple[str, xr.DataArray, xr.Dataset | None]],
    *,
    s_filter_um: float,
    l_filter_um: float | None,
) -> pd.DataFrame:
    """Areal texture of each patch before and after use, and the change (ISO 25178-2).

    `patches` are triples of a patch, its heights at T0 and, if there is a T1, its height change.
    The filters are None or nesting indices. The rows are those of
    `gstlib.validation.texture.texture_rows`.
    """
    from gstlib.validation.texture import texture_rows

    rows = []
    for patch, height, change in patches:
        of_patch = texture_rows(
            height, change, s_filter_um=s_filter_um, l_filter_um=l_filter_um
        )
        if change is not None and len(of_patch) == 1:
            logging.getLogger("gstlib").warning(
                "patch %s: T1 was not found on T0, or covers too little of it: the texture is that "
                "of T0 alone",
                patch,
            )
        rows += [{"patch": patch, **row} for row in of_patch]
    return pd.DataFrame(rows)


# --- The whole in memory ----------------------------------------------------------------------

Stage = TypeVar("Stage", bound=Callable[..., Any])


def _stage(compute: Stage) -> Stage:
    """A method of `Study` whose result is kept."""

    @wraps(compute)
    def kept(self: "Study", *of: str) -> Any:
        key = (compute.__name__, *of)
        if key not in self.kept:
            self.kept[key] = compute(self, *of)
        return self.kept[key]

    return cast(Stage, kept)


class Study:
    """A study in memory: each stage is computed when it is first asked for, and kept.

    Contacts are solved at the target pressure alone, without the steps on the way to it.

    Parameters
    ----------
    config : mapping
        ``seed`` and the sections `STUDY_SECTIONS`.
    patches : pandas.DataFrame
        The patch table.
    read_mesh : callable
        Gives the stone's mesh, mm.
    read_scan : callable
        Gives the raw scan (y, x) of a patch at an epoch, ``("5", "T0")``, and that of the
        counterface, ``("counterface", "")``, if there is one.
    worn : sequence of str
        The patches that have a T1.
    has_counterface : bool
    second_stone : mapping, optional
        As `counterface` of `grid_macroscale`.
    kept : dict, optional
        Results of stages that are known already, by the stage's name and what it is of (a patch,
        an epoch).
    """

    def __init__(
        self,
        config: Mapping[str, Any],
        patches: pd.DataFrame,
        *,
        read_mesh: Callable[[], "trimesh.Trimesh"],
        read_scan: Callable[[str, str], xr.DataArray],
        worn: Sequence[str],
        has_counterface: bool = False,
        second_stone: Mapping | None = None,
        kept: Mapping[tuple[str, ...], Any] | None = None,
    ):
        self.config, self.patches, self.worn = config, patches, list(worn)
        self.read_mesh, self.read_scan = read_mesh, read_scan
        self.has_counterface, self.second_stone = has_counterface, second_stone
        self.kept = dict(kept or {})

    @_stage
    def surface(self) -> xr.Dataset:
        """Heights of the square, from `grid_macroscale`."""
        names = ("grid", "margin_mm", "interpolation")
        settings = {name: self.config["macroscale"][name] for name in names}
        settings |= {"square": self.config["square"], "source": "mesh"}
        settings["counterface"] = self.second_stone
        return grid_macroscale(self.read_mesh(), **settings)

    @property
    def _patch_mm(self) -> float:
        return self.config["scans"]["size_mm"]

    @_stage
    def composite(self) -> xr.Dataset:
        """The scans laid on the mesh's surface, from `compose_surface`."""
        return compose_surface(
            self.surface(),
            self.patches,
            ((patch, self.prepared(patch, "T0").height) for patch in self.patches.patch),
            s_filter_um=self.config["microscale"]["s_filter_um"],
            placement_um=self.config["uncertainty"]["placement_um"],
            seed=self.config["seed"],
            patch_mm=self._patch_mm,
        )

    @_stage
    def contact(self) -> xr.Dataset:
        """Contact of the square at the target pressure."""
        if self.config["coupling"] == "levelled":
            return self.mesh_contact()
        return self._pressed_square(self.composite())

    @_stage
    def mesh_contact(self) -> xr.Dataset:
        """Contact of the mesh alone at the target pressure."""
        return self._pressed_square(self.surface())

    def _pressed_square(self, surface: xr.Dataset) -> xr.Dataset:
        from gstlib.contact import faces_of

        names = ("target_pressure_MPa", "tolerance")
        settings = {name: self.config["macroscale"][name] for name in names}
        return self._pressed(faces_of(surface), source="macroscale", **settings)

    def _pressed(self, faces: xr.Dataset, **settings: Any) -> xr.Dataset:
        from gstlib.contact import contact_at_pressure, contact_moduli

        modulus, _ = contact_moduli(self.config["material"])
        return contact_at_pressure(faces, contact_modulus_MPa=modulus, **settings)

    @_stage
    def pressures(self) -> pd.DataFrame:
        """Pressure of every patch, from `couple_scales`."""
        contacts = self.contact(), self.mesh_contact()
        return couple_scales(*contacts, self.patches, patch_mm=self._patch_mm)

    @_stage
    def prepared(self, patch: str, epoch: str) -> xr.Dataset:
        """A clean scan, from `prepare_scan`."""
        crops = self.patches.set_index("patch")[["crop_x_mm", "crop_y_mm"]].dropna()
        prepared = prepare_scan(
            self.read_scan(patch, epoch),
            crop=tuple(crops.loc[patch]) if patch in crops.index else None,
            scans=self.config["scans"],
            preprocessing=self.config["preprocessing"],
        )
        return prepared[["height", "filled", "outlier"]]

    @_stage
    def change(self, patch: str) -> xr.Dataset:
        """Height change of a patch, from `register_patch`."""
        epochs = (self.prepared(patch, epoch) for epoch in ("T0", "T1"))
        settings = self.config["registration"] | self.config["traces"]
        return register_patch(*epochs, patch=patch, **settings)

    @_stage
    def selected(self) -> pd.DataFrame:
        """Every patch with its pressure and whether it is in the study, from `select_patches`."""
        changes = ((patch, self.change(patch)) for patch in self.worn)
        quality = registration_table(changes, self.config["selection"])
        return select_patches(self.pressures(), quality, self.config["selection"])

    @_stage
    def patch_contact(self, patch: str, variant: str = "") -> xr.Dataset:
        """Contact of a patch at its own pressure, in the study's own variant unless named."""
        source, variant = f"patch {patch}", variant or self.config["coupling"]
        face = self.prepared("counterface", "") if self.has_counterface else None
        faces = levelled_patch(
            self.prepared(patch, "T0"),
            face,
            s_filter_um=self.config["microscale"]["s_filter_um"],
            source=source,
        )
        if variant == "placed":
            faces = place_patch(faces, self.composite(), self.contact(), patch)
        return self._pressed(
            faces,
            target_pressure_MPa=self.pressures().set_index("patch")[PRESSURES[variant]][
                patch
            ],
            tolerance=self.config["microscale"]["tolerance"],
            source=source,
        )

    def scored(self) -> list[str]:
        """The patches in the study that have a T1, in the table's order."""
        selected = self.selected()
        return [p for p in selected.patch[selected.in_study] if p in self.worn]

    def scores(self, **chance: Any) -> "list[PatchScores]":
        """Scores of these patches; `chance` as of `gstlib.validation.scoring.score_patch`."""
        from gstlib.validation.scoring import score_patch

        names = ("neighbourhood_um", "most_noise", "rim")
        settings = {name: self.config["validation"][name] for name in names}
        return [
            score_patch(
                patch, self.patch_contact(patch), self.change(patch), **settings, **chance
            )
            for patch in self.scored()
        ]

    @_stage
    def worn_square(self) -> xr.Dataset | None:
        """The square as it wears, from `wear_square`; the mat is not fitted yet."""
        from gstlib.validation.scoring import patch_tables

        return wear_square(
            self.contact(),
            self.pressures(),
            patch_tables(self.scores())["patches"],
            patch_mm=self._patch_mm,
            steps=self.config["wear_steps"],
            mat=self.config["mat"],
        )

    def wear(self, *, seed: int, resamples: int) -> tuple[pd.DataFrame, ...]:
        """Tables of `score_wear`, empty where no wear is predicted."""
        if (square := self.worn_square()) is None:
            names = ("wear", "wear_profile", "wear_summary")
            return tuple(pd.DataFrame(columns=columns_of(name)) for name in names)
        worn = {
            patch: (self.patch_contact(patch), self.change(patch))
            for patch in square.measured.dropna("patch").patch.values.tolist()
        }
        fitted = fit_mat(square, ((patch, *of) for patch, of in worn.items()))
        patches = (
            (patch, *of, predict_wear(of[0], fitted, patch)) for patch, of in worn.items()
        )
        return score_wear(patches, fitted, self.pressures(), seed=seed, resamples=resamples)
