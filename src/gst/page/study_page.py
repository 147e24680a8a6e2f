"""The page of a study, with the answer, the contents and the record, from its stored results."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from gst.config.poses import poses_of
from gst.page.explorer import draws_to_explore
from gst.page.load_points import load_points
from gst.page.page import Shown, by_category, data_url, embedded, render, tool_scene
from gst.page.results import Results
from gst.page.truth import truth_met
from gst.page.verdict import MODELS, Answer, verdict, where_to_scan
from gst.run.chain import messages_of
from gstlib import __version__
from gstlib.errors import InputError
from gstlib.io.files import sha256, write_whole
from gstlib.macroscale.active_tool import ActiveTool, posed_mesh
from gstlib.macroscale.sampling_sites import concentration
from gstlib.settings import Settings
from gstlib.surfaces.footprints import footprint_weights, places_of, square_of
from gstlib.validation.baselines import BASELINES, ORACLE
from gstlib.validation.scoring import own_model
from gstlib.wear.archard import CAPPED

__all__ = [
    "refuse_edited",
    "reported",
    "write_contents",
    "write_json",
    "write_study_page",
]

# Tables that the answer is computed from.
_SCORED = ["patch_pressures", "patch_intervals", "registration", "validation_patches"]
_SCORED += ["validation_summary", "exposure", "use", "laws", "placement"]
# Tables with a row for each patch, by their names on a card.
_OF_PATCHES = {
    "pressure": "patch_pressures.csv",
    "interval": "patch_intervals.csv",
    "microscale": "microscale_summary.csv",
    "scores": "validation_patches.csv",
    "registration": "registration.csv",
    "placement": "placement.csv",
}
_INSIDE = 0.5  # share of an element that lies in a patch which colours it
_PAGE = "0 Overview", "the page of the study"
_WHAT = "The answer, the tool in 3D, all warnings, a card for each patch, every figure and table."


def refuse_edited(tables: Mapping[str, str]) -> None:
    """Raise an `InputError` if a table is no longer the one with this SHA-256, by path."""
    for table, digest in tables.items():
        if not Path(table).is_file() or sha256(table) != digest:
            raise InputError(
                table, "was edited while the study ran", "Run the study again."
            )


def write_study_page(
    page: Path,
    study: Results,
    config: Mapping[str, Any],
    shown: Sequence[Shown],
    *,
    steps: Sequence[str],
    config_faults: Sequence[Mapping[str, Any]],
    active_tool: Mapping[str, Any] | None,
    methods: str,
) -> None:
    """Write the page of a study in the folder of its results.

    Parameters
    ----------
    page : Path
    study : Results
        With the files ``mesh, surface, contact`` and, if there are, ``counterface, exposure, use,
        t0, t1`` (folders of prepared scans), ``by_patch`` and ``strips`` (folders of pictures),
        ``curves`` (figures as SVG), and tables by the names of their files. Its places have ``t0``
        and ``t1``, too: names of scans.
    config : mapping
    shown : sequence of Shown
        Figures and tables.
    steps : sequence of str
        The steps of the study, whose messages the page shows.
    config_faults : sequence
        Faults that the config accepts in its own values, as from `reported`.
    active_tool : mapping, optional
        Arguments of `ActiveTool.read`.
    methods : str
        The methods paragraph with its references.
    """
    results = page.parent
    proposed = study.table("places.csv") if study.has("places.csv") else None
    asked = Settings(**config).by_stage()["infer_use"]
    graded = pd.DataFrame({} if proposed is None else study.places)
    load = load_points(study, asked["stated"]["load_point"])
    content = {
        "version": __version__,
        "dates": [] if config["specimen"] else scan_dates(study),
        "given": asked["stated"] | {"modulus": asked["modulus"]},
        "load": load,
        "grades": graded.to_dict("records"),
        "draws": draws_to_explore(study, config["wear_law"]),
        "truth": truth_met(study, load["held"]),
        "answer": _answer(study, config, proposed),
        "generated": (config["specimen"] or {}).get("wear_placement"),
        "worn": study.has("registration.csv") or not graded.empty,
        "faults": [*config_faults, *reported(results, steps, "ERROR")],
        "warnings": reported(results, steps, "WARNING"),
        "notes": reported(results, steps, "NOTE"),
        "title": config["title"],
        "force": study.force_N,
        "size": study.size_mm,
        "patch_mm": study.patch_mm,
        "scene": _scene(study, proposed, active_tool),
        "proposed": [] if proposed is None else proposed.to_dict("records"),
        "records": patch_records(study) if proposed is None else {},
        "shown": by_category(shown),
        "methods": methods,
        "curves": {
            f"figures/{file.name}": file.read_text("utf-8")
            for file in study.files.get("curves", [])
        },
        "compared": study.has("validation_summary.csv"),
    }
    write_whole(page, render("page.html", **content).encode())


def scan_dates(study: Results) -> list[str]:
    """The first and the last day on which scans were taken, if their files say when."""
    patches = (study.places or {}).get("patch", [])
    when = [
        str(scan.attrs.get("acquired", ""))[:10]
        for epoch in ("t0", "t1")
        for scan in study.by_patch(epoch, patches).values()
    ]
    days = sorted(filter(re.compile(r"\d{4}-\d\d-\d\d").fullmatch, when))
    return sorted({*days[:1], *days[-1:]})


def _answer(
    study: Results, config: Mapping[str, Any], proposed: pd.DataFrame | None
) -> Answer:
    """The answer of the study: about its wear or, without patches, where to scan."""
    tables = {
        name: study.table(f"{name}.csv") for name in _SCORED if study.has(f"{name}.csv")
    }
    load = {"force_N": study.force_N, "square_mm": study.size_mm}
    if proposed is not None:
        exposure = study.data("exposure", "exposure", "touched")
        size = {"size_mm": study.size_mm, "patch_mm": study.patch_mm}
        held = concentration(exposure, proposed, **size)
        return where_to_scan(proposed, held, use=tables.get("use"), **load)
    poses = poses_of(config)
    return verdict(
        tables,
        **load,
        interlayer=config["interlayer"],
        pressure_cap=config["pressure_cap_MPa"],
        poses=None if poses is None else len(poses),
        wear_law=config["wear_law"],
        second=study.has("counterface"),
    )


def _scene(
    study: Results, proposed: pd.DataFrame | None, active_tool: Mapping[str, Any] | None
) -> dict[str, Any]:
    """The tool in 3D, with pressure, measured loss and, of a gesture, exposure on it."""
    tool, frame = study.tool
    fields = [study.data("contact", "pressure").pressure.assign_attrs(title="pressure")]
    if study.has("exposure"):
        exposure = study.data("exposure", "exposure").exposure
        fields.append(exposure.assign_attrs(title="exposure"))
    x = fields[0].x.values  # the face is as wide along y
    places: Any = study.places
    if proposed is None:
        fields = [square_of(field, study.size_mm) for field in fields]
        if study.has("registration.csv"):
            fields.insert(1, _loss_on(fields[0], study))
    else:
        places = proposed.rename(columns={"place": "patch"}).assign(rotation_deg=0.0)
    active = None
    if study.has("counterface") and active_tool:
        active = posed_mesh(
            ActiveTool.read(**active_tool), frame, size_mm=study.size_mm
        )
    sizes = study.size_mm, study.patch_mm
    scene = tool_scene(tool, frame, fields, places, sizes, active)
    half = (x[1] - x[0]) / 2
    return scene | {
        "face": [round(float(x[0] - half), 6), round(float(x[-1] + half), 6)]
    }


def _loss_on(square: xr.DataArray, study: Results) -> xr.DataArray:
    """The mean depth that each patch lost, on the grid of the square."""
    depths = study.table("registration.csv").set_index("patch").mean_wear_depth_um
    loss = xr.zeros_like(square)
    for patch, place in places_of(pd.DataFrame(study.places)).items():
        depth = depths.get(patch, math.nan)
        if depth > 0:
            share = footprint_weights(square, place, study.patch_mm)
            loss.values[share > _INSIDE] = depth
    return loss.assign_attrs(title="measured loss, mean over the patch", units="µm")


def patch_records(study: Results) -> dict[str, dict[str, Any]]:
    """The content of the card of each patch: its rows of the tables, or empty dicts, and pictures.

    ``wear`` is the row of the study's own prediction, ``mcc`` the score of every other model by the
    model's name in words; ``picture`` and ``strip`` are data URLs, ``scans`` the names of scans.
    """
    rows = {name: _rows_of(study, file) for name, file in _OF_PATCHES.items()}
    models: dict[str, dict[str, dict]] = {}
    if study.has("wear.csv"):
        for row in study.table("wear.csv").to_dict("records"):
            models.setdefault(row["patch"], {})[row["model"]] = row
    scans = pd.DataFrame(study.places).set_index("patch")
    records = {}
    for patch in rows["pressure"]:
        wear = models.get(patch, {})
        names = scans.loc[patch, ["t0", "t1"]]
        others = [model for model in (CAPPED, *BASELINES, ORACLE) if model in wear]
        records[patch] = {
            "patch": patch,
            "scans": " → ".join(filter(None, names)),
            "picture": _picture(study, "by_patch", f"{patch}.png"),
            "strip": _picture(study, "strips", f"{patch}.jpg"),
            "wear": wear.get(own_model(list(wear)), {}),
            "mcc": {MODELS[model]: wear[model]["mcc"] for model in others},
            **{name: table.get(patch, {}) for name, table in rows.items()},
        }
    return records


def _rows_of(study: Results, file: str) -> dict[str, dict[str, Any]]:
    """The row of each patch in a table, without its empty cells."""
    if not study.has(file):
        return {}
    records = study.table(file).astype(object).to_dict("records")
    return {
        row["patch"]: {name: value for name, value in row.items() if pd.notna(value)}
        for row in records
    }


def _picture(study: Results, folder: str, name: str) -> str | None:
    """A picture of a patch as a data URL, if there is one."""
    if not study.has(folder) or not (file := study.files[folder] / name).exists():
        return None
    content = file.read_bytes()
    return embedded(content) if file.suffix == ".png" else data_url(content, "jpeg")


def reported(results: Path, steps: Sequence[str], level: str) -> list[dict[str, Any]]:
    """The messages of the steps at a level, each once: ``text``, ``steps``, ``patches`` named.

    `level` is one of `gst.run.chain.LEVELS`.
    """
    reporters: dict[str, dict[str, None]] = {}
    for name in steps:
        step = re.sub(r"_\d+$", "", name).replace(
            "_", " "
        )  # a batch is not a separate step
        for text in messages_of(results, name, level):
            reporters.setdefault(text, {})[step] = None
    messages = []
    for text, names in reporters.items():
        match = re.match(r"patch(?:es)? ([\w-]+(?:, [\w-]+)*)", text)
        patches = match[1].split(", ") if match else []
        messages.append({"text": text, "steps": list(names), "patches": patches})
    return messages


def write_contents(contents: Path, page: Path, entries: Sequence[Shown]) -> None:
    """Write the list of the results with their captions, the page first."""
    listed = [
        {
            "file": one.file.relative_to(page.parent).as_posix(),
            "category": one.category,
            "title": one.title,
            "caption": one.caption,
            "sha256": sha256(one.file),
        }
        for one in [Shown(page, *_PAGE, _WHAT), *entries]
    ]
    write_json(contents, listed)


def write_json(file: Path, content: object) -> None:
    """Write a file of JSON for people and programs, whole or not at all."""
    text = json.dumps(content, indent=1, ensure_ascii=False)
    write_whole(file, f"{text}\n".encode())
