"""The page of a study, with the answer, the contents and the record, from its stored results."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from gst.config.poses import poses_of
from gst.page.page import (
    Shown,
    by_category,
    caption_html,
    patch_records,
    render,
    reported,
    tool_scene,
)
from gst.page.verdict import Answer, verdict, where_to_scan
from gst.run.chain import certified_inputs, versions_of
from gst.run.provenance import study_provenance
from gstlib.conditions import load_force
from gstlib.errors import InputError
from gstlib.io.files import sha256, write_whole
from gstlib.io.meshes import read_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.macroscale.active_tool import ActiveTool, posed_mesh
from gstlib.macroscale.sampling_sites import concentration
from gstlib.surfaces.footprints import footprint_weights, places_of, square_of
from gstlib.surfaces.frames import FRAME, stored_frame

__all__ = ["StudyPage", "refuse_edited"]

# Tables that the answer is computed from.
_SCORED = ["patch_pressures", "patch_intervals", "registration", "validation_patches"]
_SCORED += ["validation_summary", "exposure", "use", "laws", "placement"]
_INSIDE = 0.5  # share of an element that lies in a patch which colours it
_PAGE = "0 Overview", "the page of the study"
_WHAT = (
    "The answer, the tool in 3D, all warnings, a card for each patch, every figure and table."
)


def refuse_edited(tables: Mapping[str, str]) -> None:
    """Raise an `InputError` if a table is no longer the one with this SHA-256, by path."""
    for table, digest in tables.items():
        if not Path(table).is_file() or sha256(table) != digest:
            raise InputError(table, "was edited while the study ran", "Run the study again.")


@dataclass(frozen=True)
class StudyPage:
    """What the page of a study is made of."""

    # ``mesh, counterface, surface, contact, exposure``; ``shown``, the figures and tables on the
    # page, and ``behind``, that which is packed with them; ``captions`` of these; ``by_patch``,
    # and ``strips``, the folders of the pictures of single patches; ``made_from``, the measured
    # files. An empty list stands for what the study does not have.
    files: Mapping[str, Any]
    titles: Sequence[Sequence[str]]  # category and title of each that has a caption
    steps: Mapping[str, str]  # the study's, with their hashes (`gst.run.chain.hashes_of`)
    places: Mapping[str, list]  # columns ``patch, x_mm, y_mm, rotation_deg, t0, t1``
    patch_mm: float
    mesh_unit: str
    active_tool: Mapping[str, Any] | None  # of `ActiveTool.read`
    config: Mapping[str, Any]
    config_faults: Sequence[Mapping[str, Any]]  # that the config accepts in its own values

    def write(
        self, page: Path, record: Path, contents: Path, *, commit: str | None, program: str
    ) -> None:
        """Write the page, the record and the contents; `commit` and `program` are the program's.

        Raises an `InputError` if a result is not as its step made it, or a step was asked something
        else than the config says.
        """
        results = page.parent
        inputs = certified_inputs(results, self.steps, self.files["made_from"])
        said = {
            "answer": self.answer,
            "generated": self.config["specimen"] is not None,
            "faults": [*self.config_faults, *reported(results, [*self.steps], "ERROR")],
        }
        write_whole(page, render("page.html", **said, **self._content(results)).encode())
        entries = [Shown(page, *_PAGE, _WHAT), *self.entries]
        _write_json(contents, _listed(entries, results))
        versions = versions_of(results, self.steps)
        _write_json(record, study_provenance(self.config, inputs, commit, program, versions))

    @cached_property
    def _tables(self) -> dict[str, Path]:
        return {file.stem: file for file in self.files["shown"] if file.suffix == ".csv"}

    @property
    def _force_N(self) -> float:  # noqa: N802
        return load_force(self.config["load"], self.config["square"]["size_mm"])

    @cached_property
    def proposed(self) -> pd.DataFrame | None:
        """Places to scan, of a study without patches."""
        return read_table(self._tables["places"]) if "places" in self._tables else None

    @cached_property
    def fields(self) -> list[xr.DataArray]:
        """What the tool shows: pressure, measured loss and, of a gesture, exposure."""
        found = [read_dataset(self.files["contact"], only=["pressure"]).pressure]
        found[0].attrs["title"] = "pressure"
        if self.files["exposure"]:
            exposure = read_dataset(self.files["exposure"], only=["exposure"]).exposure
            found.append(exposure.assign_attrs(title="exposure"))
        if self.proposed is not None:
            return found
        found = [square_of(field, self.config["square"]["size_mm"]) for field in found]
        if "registration" in self._tables:
            found.insert(1, self._loss_on(found[0]))
        return found

    def _loss_on(self, square: xr.DataArray) -> xr.DataArray:
        """The mean depth that each patch lost, on the grid of the square."""
        registration = read_table(self._tables["registration"]).set_index("patch")
        loss = xr.zeros_like(square)
        for patch, place in places_of(pd.DataFrame(self.places)).items():
            depth = registration.mean_wear_depth_um.get(patch, math.nan)
            if depth > 0:
                inside = footprint_weights(square, place, self.patch_mm) > _INSIDE
                loss.values[inside] = depth
        return loss.assign_attrs(title="measured loss", units="µm")

    @cached_property
    def answer(self) -> Answer:
        """What the study found."""
        square_mm = self.config["square"]["size_mm"]
        given = {"force_N": self._force_N, "square_mm": square_mm}
        if self.proposed is not None:
            left = read_dataset(self.files["exposure"], only=["exposure", "touched"])
            size = {"size_mm": square_mm, "patch_mm": self.patch_mm}
            held = concentration(left, self.proposed, **size)
            use = read_table(self._tables["use"]) if "use" in self._tables else None
            return where_to_scan(self.proposed, held, use=use, **given)
        poses = poses_of(self.config)
        return verdict(
            {name: read_table(self._tables[name]) for name in _SCORED if name in self._tables},
            **given,
            interlayer=self.config["interlayer"],
            pressure_cap=self.config["pressure_cap_MPa"],
            poses=None if poses is None else len(poses),
            wear_law=self.config["wear_law"],
            second=bool(self.files["counterface"]),
        )

    @cached_property
    def entries(self) -> list[Shown]:
        """Every figure and table with its caption."""
        behind = [self.files["behind"]] if self.files["behind"] else []
        listed = zip(
            [*self.files["shown"], *behind], self.files["captions"], self.titles, strict=True
        )
        return [
            Shown(file, category, title, self._caption(caption))
            for file, caption, (category, title) in listed
        ]

    def _caption(self, file: Path) -> str:
        return caption_html(file.read_text("utf-8"), config=self.config)

    def _scene(self) -> dict[str, Any]:
        """The tool in 3D."""
        frame = stored_frame(read_dataset(self.files["surface"], only=FRAME))
        size, other, places = self.config["square"]["size_mm"], None, self.places
        if self.files["counterface"] and self.active_tool:
            other = posed_mesh(ActiveTool.read(**self.active_tool), frame, size_mm=size)
        if self.proposed is not None:
            places = self.proposed.rename(columns={"place": "patch"}).assign(rotation_deg=0.0)
        tool = read_mesh(self.files["mesh"], unit=self.mesh_unit)
        return tool_scene(tool, frame, self.fields, places, (size, self.patch_mm), other)

    def _content(self, results: Path) -> dict[str, Any]:
        scene, records = self._scene(), []
        if self.proposed is None:
            folders = (self.files[name] or None for name in ("by_patch", "strips"))
            records = patch_records(self._tables, *folders)
            scans = pd.DataFrame(self.places).set_index("patch")
            for record in records:
                names = scans.loc[record["patch"], ["t0", "t1"]]
                record["scans"] = " → ".join(filter(None, names))
        return {
            "title": self.config["title"],
            "force": self._force_N,
            "proposed": [] if self.proposed is None else self.proposed.to_dict("records"),
            "scene": scene,
            "size": scene["frame"]["size"],
            "records": {record["patch"]: record for record in records},
            "warnings": reported(results, [*self.steps], "WARNING"),
            "notes": reported(results, [*self.steps], "NOTE"),
            "shown": by_category(self.entries[: len(self.files["shown"])]),
            "compared": "validation_summary" in self._tables,
        }


def _listed(entries: Sequence[Shown], results: Path) -> list[dict[str, str]]:
    """What the results are, file by file."""
    return [
        {
            "file": one.file.relative_to(results).as_posix(),
            "category": one.category,
            "title": one.title,
            "caption": one.caption,
            "sha256": sha256(one.file),
        }
        for one in entries
    ]


def _write_json(file: Path, content: object) -> None:
    text = json.dumps(content, indent=1, ensure_ascii=False)
    write_whole(file, f"{text}\n".encode())
