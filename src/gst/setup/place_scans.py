"""The scans on the page of `gst place`: their pictures and their positions on the stone."""

import contextlib
import functools
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from gst.check.matching import Match
from gst.check.sliding import sides_of, wrapped
from gst.config.reading import read_unfinished
from gst.config.todo import is_to_do
from gst.setup.finding import (
    Matches,
    described,
    located,
    seen_in,
    snapped,
    square_around,
)
from gst.setup.place_state import DECIMALS, mesh_of, rows_of, unless_to_do, version_of
from gst.setup.scan_folder import OVERVIEW, Scan, scans_in
from gstlib.coupling.orientations import Mould, lying_right
from gstlib.errors import ConfigError, GstError, InputError, accepting, concerning
from gstlib.io.scans import cut_scan, read_scan
from gstlib.io.stage import stage_of
from gstlib.preprocess.scans import crop_of, mould_of, prepare_scan
from gstlib.surfaces.footprints import PatchPosition, places_of
from gstlib.surfaces.frames import frame_from_points
from gstlib.surfaces.grid import coarser

# Points along the side of a picture.
_PICTURE_POINTS = 160
_MATCHED_POINTS = 256  # along the side of an overview
# Share of unmeasured points up to which a scan can be shown.
_MOSTLY_HOLES = 0.9


def find_places(path: Path, overview: Path | None = None) -> dict[str, Any]:
    """Positions of the scans on the stone by their heights, to be shown; nothing is written.

    On an overview map, by default the largest in the scans' folder, or tied together by the stage;
    otherwise near the places that the table has. The result has the ``square`` and the ``places``
    that were found (``patch, x_mm, y_mm, rotation_deg``); a sentence on each patch (``fits``) and
    on ``all``; and the ``answers`` that follow from the orientation of the scans.
    """
    config = read_unfinished(path)
    rows, _ = rows_of(config)
    scans = dict(zip(rows.patch, _scans_of(path, [*rows.index]), strict=True))
    heights = {patch: scan.heights for patch, scan in scans.items()}
    mesh, size_mm = mesh_of(path), config["square"]["size_mm"]
    laid = unless_to_do(config["square"]["points_mm"])
    used = [*rows.t0, *rows.t1, *rows["repeat"]]
    matches = located(
        mesh,
        heights,
        overview=_overview_of(config, used, overview),
        stages=stages_of([*scans.values()]),
    )
    each, problem = matches.scans, ""
    if matches.placed:
        if laid is None:
            laid, size_mm = square_around(
                matches, side_mm=config["scans"]["size_mm"], least_mm=size_mm
            )
        places = seen_in(frame_from_points(laid), matches)
    else:
        hand = rows.dropna(subset=["x_mm", "y_mm"])
        if laid is None or hand.empty:
            remedy = "Place the square, and drag the scans to it."
            raise ConfigError(path, _nothing_found(matches), remedy)
        frame = frame_from_points(laid)
        try:
            each = snapped(mesh, frame, size_mm, heights, places_of(hand))
        except ValueError as error:
            problem = f"the mesh is too coarse: {error}"
        places = {name: match.place for name, match in each.items() if match.is_found}
    answers, turn = _of_matches(config, each, places)
    return {
        "square": {"points_mm": laid, "size_mm": size_mm},
        "places": [
            {"patch": patch} | _shown(place, turn) for patch, place in places.items()
        ],
        "fits": {patch: described(match) for patch, match in each.items()},
        "all": problem or _how_many(len(places), len(rows), each),
        "answers": answers,
    }


def _shown(place: PatchPosition, turn: float) -> dict[str, float]:
    turned = place._replace(rotation_deg=wrapped(place.rotation_deg + turn))
    return {name: round(value, DECIMALS) for name, value in turned._asdict().items()}


def _how_many(places: int, scans: int, matches: Mapping[str, Match]) -> str:
    """The number of scans found, the uncertain ones, and the remedy."""
    uncertain = [patch for patch, match in matches.items() if match.is_uncertain]
    text = f"{places} of {scans} scans were found. The list shows how well each fits."
    if places < scans:
        text += " The others were not moved."
    if uncertain:
        text += (
            f" The positions of {', '.join(uncertain)} are not certain. Drag these scans nearer to "
            "their positions, or add an overview map."
        )
    elif not places:
        text += " Drag each to within 0.75 mm and 12° of its position on the stone, then try again."
    return text


def _nothing_found(matches: Matches) -> str:
    """Why no scan was found without positions by hand."""
    if matches.on_stone is None:
        return "has neither an overview map nor positions from the stage or by hand"
    return f"has scans that were not found on the stone: {described(matches.on_stone)}"


def _of_matches(
    config: Mapping, matches: Mapping[str, Match], places: Mapping[str, PatchPosition]
) -> tuple[dict[str, Any], float]:
    """How moulds are undone and how sure places are, by scans that were matched undone.

    And by how much (degrees) each is turned besides.
    """
    if not places:
        return {}, 0.0
    mould, match = config["scans"]["mould"], matches[next(iter(places))]
    errors_mm = [matches[patch].error_mm for patch in places]
    error_um = math.ceil(1e3 * math.sqrt(np.mean(np.square(errors_mm))))
    values: dict[str, Any] = {"uncertainty.placement_um": error_um}
    if match.inverted or is_to_do(mould["invert"]):
        values["scans.mould.invert"] = match.inverted != (mould["invert"] is True)
    if not match.mirrored:
        return values, 0.0
    turns = [place.rotation_deg for place in places.values()]
    # as it was scanned rather than upside down
    is_upright = np.cos(np.radians(turns)).sum() >= 0
    look = f"reversed along {'x' if is_upright else 'y'}"
    right, turn = lying_right(look, Mould(**mould))
    values["scans.mould.flip"] = right.flip
    return values, turn if is_upright else turn + 180.0


def _overview_of(
    config: Mapping, used: Sequence[str], overview: Path | None
) -> xr.DataArray | None:
    """The heights of an overview: the given map, or the largest in the scans' folder.

    The largest counts if no patch uses it and it holds several patches.
    """
    scans = config["scans"]
    grid = {name: scans[name] for name in ("unit", "spacing_um")}
    if overview is None:
        maps = _maps(Path(config["inputs"]["scan_folder"]), used, grid)
        best = max(maps, key=_shorter_side, default=None)
        if best is None or _shorter_side(best) <= OVERVIEW * scans["size_mm"]:
            return None
    else:
        best = read_scan(overview, **grid)
    best = coarser(best, max(1, min(best.shape) // _MATCHED_POINTS))
    return _prepared(best, scans["mould"])


def _shorter_side(surface: xr.DataArray) -> float:
    return min(sides_of(surface))


def _maps(folder: Path, used: Sequence[str], grid: Mapping) -> Iterator[xr.DataArray]:
    """The maps that can be read and are no patch's, one at a time: each may be large."""
    root, paths, _ = scans_in([folder])
    for path in paths:
        if path.relative_to(root).as_posix() not in used:
            with contextlib.suppress(GstError):
                yield read_scan(path, **grid)


def _prepared(surface: xr.DataArray, mould: Mapping) -> xr.DataArray:
    """The heights of the stone. A mould that is still to be confirmed counts as none."""
    return prepare_scan(
        surface,
        mould_invert=mould["invert"] is True,
        mould_flip=mould["flip"],
        maximum_unmeasured=_MOSTLY_HOLES,
    ).height


class _Scan(NamedTuple):
    """A scan as the page needs it."""

    picture: bytes  # PNG, y up
    stage_mm: tuple[float, float] | None
    heights: xr.DataArray  # prepared, on the picture's points


def picture_of(path: Path, number: int) -> bytes:
    """The scan at T0 of a row of the patch table, as it lies on the square, shaded (PNG)."""
    return _scans_of(path, [number])[0].picture


def has_stage(path: Path) -> bool:
    """Whether every scan has a place from the stage, each another."""
    rows, has_scans = rows_of(read_unfinished(path))
    return has_scans and stages_of(_scans_of(path, [*rows.index])) is not None


def stages_of(scans: Sequence["_Scan | Scan"]) -> list[tuple[float, float]] | None:
    """The stage's places; None unless it has one for each of several scans, each another."""
    stages = [scan.stage_mm for scan in scans if scan.stage_mm is not None]
    return stages if 1 < len({*stages}) == len(scans) else None


def _scans_of(path: Path, numbers: Sequence[int]) -> list[_Scan]:
    config = read_unfinished(path)
    rows, _ = rows_of(config)
    scan_folder = (config["inputs"] or {}).get("scan_folder")
    settings = config["scans"]
    grid = settings["size_mm"], settings["unit"], settings["spacing_um"]
    if scan_folder is None or any(map(is_to_do, grid)):
        problem = "does not state folder, unit, spacing and side of the scans"
        remedy = "Give inputs.scan_folder, and answer the open questions."
        raise ConfigError(path, problem, remedy)
    folder = Path(scan_folder).resolve()
    scans = []
    for number in numbers:
        if number not in rows.index or not rows.t0[number]:
            raise InputError(path, f"does not have a scan {number}", "Reload the page.")
        file = (folder / rows.t0[number]).resolve()
        if not file.is_relative_to(folder):
            raise InputError(file, f"lies outside {folder}", "Correct the patch table.")
        row = rows.loc[number]
        mould = (*mould_of(settings["mould"], row.flip).items(),)
        with accepting(config["accept"]), concerning([row.patch]):
            scans.append(_scan(file, grid, mould, crop_of(row), version_of(file)))
    return scans


@functools.lru_cache(maxsize=1000)
def _scan(
    file: Path,
    settings: tuple[float, str | None, float | None],
    mould: tuple[tuple[str, Any], ...],
    crop: tuple[float, float] | None,
    _version: object,
) -> _Scan:
    from matplotlib.image import imsave

    from gst.page.figures.maps import raking

    size_mm, unit, spacing_um = settings
    raw = read_scan(file, unit=unit, spacing_um=spacing_um)
    piece = cut_scan(raw, crop, size_mm)
    piece = coarser(piece, max(1, math.ceil(min(piece.shape) / _PICTURE_POINTS)))
    heights = _prepared(piece, dict(mould))
    content = io.BytesIO()
    # a picture begins with its top row
    imsave(content, raking(heights)[::-1], format="png")
    return _Scan(content.getvalue(), stage_of(raw), heights)
