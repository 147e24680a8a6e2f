"""A study from a mesh and a folder of scans: `gst new FOLDER --mesh M --scans S`.

It writes ``study.yaml`` and ``patches.csv``, and reports each inferred value with its source. Then
it looks for the positions of the scans as the page of `gst place` does. Missing values are marked
`TODO`, and `gst check` refuses them.
"""

import contextlib
import math
import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy.spatial.distance import pdist

from gst import ROOT
from gst.config.edited import with_values
from gst.config.patches import cell_of
from gst.config.todo import TODO, is_to_do
from gst.setup.place_scans import find_places, stages_of
from gst.setup.place_state import save_answers, save_places, state_of
from gst.setup.scan_folder import Pairs, Scan, pair_scans, read_scans, scans_in
from gstlib.errors import InputError
from gstlib.io.files import write_whole
from gstlib.io.meshes import UNITS, is_mesh, read_mesh, steps_of, units_of_size
from gstlib.settings import Settings

if TYPE_CHECKING:
    import trimesh


_OK, _DOUBT, _TO_DO = "ok", "look", "to do"
# Sides of a patch that differ by less are equal: as `gstlib.io.scans.cut_scan` has it.
_SAME_SIZE = 0.01
# ASSUME: Least distance of scan positions. Scans of different patches share at most half of their
# side. Reason: If stage coordinates are closer, they were not recorded, or the stone was moved
# between the scans.
_LEAST_APART = 0.5
_CONFIG, _TABLE = "study.yaml", "patches.csv"
# Columns of the listing.
_TOPIC, _WIDEST = 10, 90
# Files left out that are named.
_SHOWN = 12
# How the load point scatters where the study proposes places to scan, as in config/mesh_only.yaml.
_GESTURE = {"load_point_scatter_mm": 1.0, "poses": 60}
# Values that only the user can give.
_USE = (
    "load.force_N",
    "counterface.radius_mm",
    "material.young_1_MPa",
    "material.young_2_MPa",
)
_HEAD = """\
# Made by `gst new` from the files that it names. Values that begin with TODO are missing, and
# `gst check` lists them. Paths are relative to this folder. All other keys have their defaults.
# The steps are described in docs/how-to/your-own-tool.md.
"""


def new_study(
    folder: Path,
    mesh: Path,
    scans: Sequence[Path],
    overview: Path | None = None,
    names: str | None = None,
) -> str:
    """Write a study into a folder; returns the inferred values, their sources and the missing ones.

    An `overview` is a map of the face that holds the scanned places; among the scans, the one that
    is much larger than the others is taken for it. `names` is the pattern of the scans' names, as
    `gst.setup.file_names.read_names` has it. Raises an `InputError` if a file cannot be read, or
    the folder has a study.
    """
    for path in (folder / _CONFIG, folder / _TABLE):
        if path.exists():
            remedy = "Name another folder, or remove it."
            raise InputError(path, "exists already", remedy)
    draft = _Draft(folder)
    draft.add_mesh(mesh)
    if scans:
        pairs = draft.add_scans(scans, overview, names)
        draft.write()
        draft.place(pairs, overview)
    else:
        draft.values |= {"inputs.scan_folder": None, "gesture": _GESTURE}
        text = "none: the study proposes positions to scan, for a load point that scatters by 1 mm"
        draft.note("Scans", text, _DOUBT)
        draft.write()
    use = "force, active tool and rocks: the files do not contain them"
    draft.note("Use", use, _TO_DO)
    return draft.listing() + _what_next(folder)


class _Draft:
    """The values of a config as they are inferred, the patch table, and notes on their sources."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.notes: list[tuple[str, str, str]] = []  # topic, text and state
        self.table: pd.DataFrame | None = None
        self.values: dict[str, Any] = {
            "results": "results",
            "title": folder.resolve().name,
            "patches": None,
            "square.points_mm": TODO,
            "square.size_mm": Settings().square.size_mm,
        } | dict.fromkeys(_USE, TODO)

    def note(self, topic: str, text: str, state: str = "") -> None:
        self.notes.append((topic, text, state))

    def add_mesh(self, path: Path) -> None:
        """The unit of the mesh: the file's own, or the one that makes a stone; or `TODO`."""
        mesh = _read_in_any_unit(path)
        unit = mesh.metadata["file_unit"]
        sides = mesh.extents / UNITS[unit]
        shown = " × ".join(f"{side:.4g}" for side in sides)
        fitting = units_of_size(float(max(sides)))
        self.values["inputs.mesh"] = self._relative(path)
        if mesh.metadata["states_unit"]:
            text = f"{shown} {unit}, as the file states"
        elif len(fitting) == 1:
            (unit,) = fitting
            mesh = read_mesh(path, unit=unit)
            text = f"{shown} → {unit} (only {unit} makes a hand-sized stone)"
        else:
            sizes = [f"{max(sides) * UNITS[each]:.3g} mm ({each})" for each in fitting]
            text = f"{shown}, without a unit: is the stone {' or '.join(sizes)} long?"
            self.values["inputs.mesh_unit"] = TODO
            self.note("Mesh", text, _TO_DO)
            return
        self.values["inputs.mesh_unit"] = unit
        self.note("Mesh", f"{text}, coordinates in {steps_of(mesh)}", _OK)

    def _relative(self, path: Path) -> str:
        """A path from the folder of the study."""
        return os.path.relpath(path.resolve(), self.folder.resolve())

    def add_scans(
        self, paths: Sequence[Path], overview: Path | None, names: str | None
    ) -> Pairs:
        """The scans that belong together, their unit and size."""
        root, files, others = scans_in(paths)
        if overview is not None:
            files = [file for file in files if file != overview.resolve()]
        scans, faults = read_scans(root, files)
        if not scans:
            why = "".join(f": {fault}" for fault in faults[:1])
            problem = f"does not contain a scan of a patch that can be read{why}"
            raise InputError(root, problem, "Export them again.")
        pairs = pair_scans(scans, names)
        usual = [scan for scan in scans if scan not in pairs.overviews]
        self._add_unit(usual)
        is_cut = self._add_size([*pairs.before.values()] or usual)
        self.table = _table(pairs, is_cut=is_cut)
        self.values |= {
            "patches": _TABLE,
            "inputs.scan_folder": self._relative(root),
            "scans.mould.invert": pairs.invert,
            "scans.mould.flip": "x" if pairs.invert is True else None,
        }
        self._note_pairs(pairs)
        for fault in faults:
            self.note("Not read", fault.removeprefix(f"{root}/"), _DOUBT)
        left = [*pairs.left, *(path.relative_to(root).as_posix() for path in others)]
        left = [name for name in left if not is_mesh(name)]
        if left:
            more = f", … ({len(left)} files)" * (len(left) > _SHOWN)
            self.note("Left out", ", ".join(left[:_SHOWN]) + more)
        return pairs

    def _add_unit(self, scans: Sequence[Scan]) -> None:
        """The unit of files that do not state it, and the spacing if the files do not state it."""
        units, count = {scan.unit for scan in scans} - {None}, f"{len(scans)} files"
        if TODO in units or len(units) > 1:
            text = f"{count}; some state neither unit nor spacing: please enter both"
            self.values |= {"scans.unit": TODO, "scans.spacing_um": TODO}
            self.note("Scans", text, _TO_DO)
            return
        unit = units.pop() if units else None
        sizes = {f"{scan.size_mm[1]:.3g} × {scan.size_mm[0]:.3g}" for scan in scans}
        steps = {f"{1e3 * scan.spacing_mm[1]:.3g}" for scan in scans}
        stated = f"{unit} (only {unit} makes such a field)" if unit else "unit stated"
        text = (
            f"{' and '.join(sorted(sizes))} mm, every {' and '.join(sorted(steps))} µm"
        )
        self.values["scans.unit"] = unit
        self.note("Scans", f"{count}, {text}, {stated}", _OK)

    def _add_size(self, scans: Sequence[Scan]) -> bool:
        """The side of the patches. Returns whether they are cut from the scans before use."""
        sized = np.array([scan.size_mm for scan in scans if scan.unit != TODO])
        is_sized, is_cut = len(sized) == len(scans), False
        self.values["scans.size_mm"] = TODO
        if len(sized):
            is_cut = not _are_same(sized)
            side = f"{sized.mean():.3g}"
            if is_cut:
                side = f"{math.floor(1e3 * sized.min()) / 1e3:g}"
            if is_cut and _are_same(sized.min(axis=1)):
                text = f"not all are square: the middle {side} mm of each scan before use are taken"
                self.note("", text, _DOUBT)
            elif is_cut:
                text = (
                    f"the scans differ in size: is {side} mm the side of all patches?"
                )
                self.note("", text, _TO_DO)
                is_sized = False
            self.values["scans.size_mm"] = float(side) if is_sized else f"{TODO} {side}"
        return is_cut

    def _note_pairs(self, pairs: Pairs) -> None:
        """Scans that belong together, with reasons and questions."""
        for row, evidence in zip(pairs.rows, pairs.evidence, strict=True):
            text = "  ".join(filter(None, [*row, evidence]))
            state = _TO_DO if TODO in text else _DOUBT if ";" in evidence else _OK
            self.note("", text, state)
        again = sum(bool(row.repeat) for row in pairs.rows)
        after = sum(row.t1 not in ("", TODO) for row in pairs.rows)
        text = f"{len(pairs.rows)} patches, {after} with a scan after use, {again} scanned twice"
        self.note("", "; ".join(filter(None, [text, pairs.earlier])), _OK)
        for question in pairs.questions:
            self.note("", question, _TO_DO)
        for overview in pairs.overviews:
            height, width = overview.size_mm
            size = f"{width:.3g} × {height:.3g} mm"
            text = f"{overview.name}, {size}, is a map of several patches"
            self.note("Overview", text, _DOUBT)

    def write(self) -> None:
        """Write the config and the patch table, whose semicolons leave room for decimal commas."""
        own = (ROOT / "config/own.yaml").read_text(encoding="utf-8")
        body = own[own.index("\nresults:") :].replace(".venv/bin/gst", "gst")
        body = with_values(body.replace("data/own/mesh.stl", "MESH"), self.values)
        if self.table is not None:
            text = self.table.to_csv(sep=";", index=False, lineterminator="\n")
            write_whole(self.folder / _TABLE, text.encode())
        write_whole(self.folder / _CONFIG, f"{_HEAD}{body}".encode())

    def place(self, pairs: Pairs, overview: Path | None) -> None:
        """Write the positions of the scans, and whether they are of moulds."""
        path, overview = Path(_CONFIG), overview and overview.resolve()
        mould, is_open = pairs.mould, is_to_do(pairs.invert)
        with contextlib.chdir(self.folder):
            try:
                found = find_places(path, overview)
            except InputError as error:
                self.note("Mould", mould, _TO_DO if is_open else _OK)
                self._place_by_stage(path, pairs, error.problem)
                return
            answers = found["answers"]
            inverted = answers.get("scans.mould.invert")
            if inverted is not None:
                way = "inverted, as moulds" if inverted else "as it was scanned"
                mould = f"the scanned surface fits the mesh {way}"
                if not is_open:
                    answers["scans.mould.invert"] = f"{TODO} {str(inverted).lower()}"
                    mould = f"{pairs.mould}, but {mould}: which is right?"
                is_open = not is_open
            _save(path, found["square"], found["places"])
            save_answers(path, answers)
        self.note("Mould", mould, _TO_DO if is_open else _OK)
        placed = {place["patch"] for place in found["places"]}
        self.note("Where", found["all"], _OK if placed else _TO_DO)
        for patch, fit in found["fits"].items():
            self.note("", f"{patch}: {fit}", _OK if patch in placed else _TO_DO)

    def _place_by_stage(self, path: Path, pairs: Pairs, problem: str) -> None:
        """Write distances of patches, in the middle of a square that is still to be laid."""
        side_mm, size_mm = (
            self.values[f"{key}.size_mm"] for key in ("square", "scans")
        )
        scans = [*pairs.before.values()]
        stages = stages_of(scans)
        if stages is None or is_to_do(size_mm) or not _are_apart(scans, size_mm):
            text = f"the study {problem}: please enter x_mm and y_mm"
            self.note("Where", text, _TO_DO)
            return
        # a mould is seen from behind
        at = np.asarray(stages) * ((-1, 1) if pairs.invert is True else (1, 1))
        span = float(np.ptp(at, axis=0).max()) + size_mm
        side_mm = max(side_mm, math.ceil(2 * span) / 2)  # in halves of a millimetre
        at += (side_mm - at.min(axis=0) - at.max(axis=0)) / 2
        places = pd.DataFrame(at, columns=["x_mm", "y_mm"]).assign(
            patch=[*pairs.before]
        )
        square = {"points_mm": None, "size_mm": side_mm}
        _save(path, square, places.to_dict("records"))
        text = f"by the stage, over {span:.3g} mm; no file contains the direction of its axes"
        self.note("Where", text, _DOUBT)

    def listing(self) -> str:
        """The notes in lines."""
        wide = min(_WIDEST, max(len(text) for _, text, _ in self.notes))
        listed = [
            f"  {topic:<{_TOPIC}}{text:<{wide}}  {state}".rstrip()
            for topic, text, state in self.notes
        ]
        return "\n".join([*listed, ""])


def _read_in_any_unit(path: Path) -> "trimesh.Trimesh":
    """The mesh in the unit that it states or in mm, or else in the first in which it can be."""
    try:
        return read_mesh(path)
    except InputError:
        for unit in UNITS:
            with contextlib.suppress(InputError):
                return read_mesh(path, unit=unit)
        raise


def _are_same(sides: np.ndarray) -> bool:
    return bool(np.ptp(sides) <= _SAME_SIZE * sides.min())


def _table(pairs: Pairs, *, is_cut: bool) -> pd.DataFrame:
    """The patch table."""
    rows = pd.DataFrame(pairs.rows)
    rows.insert(1, "x_mm", TODO)
    rows.insert(2, "y_mm", TODO)
    scans = rows.columns[3:]
    rows[scans] = rows[scans].map(cell_of)
    if not rows["repeat"].any():
        rows = rows.drop(columns="repeat")
    return rows.assign(crop_x_mm=0, crop_y_mm=0) if is_cut else rows


def _are_apart(scans: Sequence[Scan], size_mm: float) -> bool:
    """Whether the stage positions of maps of one size are those of different patches."""
    sizes = np.array([scan.size_mm for scan in scans])
    apart = pdist([scan.stage_mm for scan in scans], "chebyshev").min()
    return apart >= _LEAST_APART * size_mm and all(map(_are_same, sizes.T))


def _save(path: Path, square: Mapping, places: Sequence[Mapping]) -> None:
    by_patch = {place["patch"]: place for place in places}
    rows = state_of(path)["patches"]
    save_places(path, square, [row | by_patch.get(row["patch"], {}) for row in rows])


def _what_next(folder: Path) -> str:
    """The files that were written, and the next commands."""
    files = [file for file in (folder / _CONFIG, folder / _TABLE) if file.exists()]
    place = shlex.join(["gst", "place", str(folder)])
    return (
        f"  wrote {' and '.join(map(str, files))}\n"
        f"  ({_OK}: read from the files; {_DOUBT}: a default or a doubt; {_TO_DO}: still {TODO})\n"
        f"\nNext:\n  {place}\n"
        "  (opens a page to place the scans, describe the use, check and run;\n"
        f"  or replace each {TODO} by hand, then run gst check and gst study)\n"
    )
