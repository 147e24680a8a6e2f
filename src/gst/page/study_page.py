"""The page of a study, with the answer, the contents and the record, from its stored results."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from gst.page.figures.style import AGREEMENT
from gst.page.load_points import draws_to_explore, load_points, truth_met
from gst.page.page import Shown, embedded
from gst.page.results import Results
from gst.page.scene import tool_scene
from gst.page.templates import render
from gst.page.verdict import MODELS, verdict
from gst.page.viewer import three_js
from gst.run.chain import messages_of
from gstlib import __version__
from gstlib.errors import InputError
from gstlib.io.files import sha256, write_whole
from gstlib.settings import Settings
from gstlib.validation.scoring import own_model
from gstlib.wear.archard import BARE, INTERLAYER

# Tables with a row for each patch, by their names on a card.
_OF_PATCHES = {
    "pressure": "patch_pressures",
    "interval": "patch_intervals",
    "microscale": "microscale_summary",
    "scores": "validation_patches",
    "registration": "registration",
    "placement": "placement",
    "wear": "wear",
}
_ABOUT_PAGE = (
    "0 Overview",
    "the page of the study",
    "The answer, the tool in 3D, all warnings, a card for each patch, every figure and table.",
)


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
    asked = Settings(**config).by_stage()["infer_use"]
    load = load_points(study, asked["stated"]["load_point"])
    is_scanned = "places" not in study.tables
    content = {
        "study": study,
        "config": config,
        "version": __version__,
        "dates": [] if config["specimen"] else scan_dates(study),
        "given": asked["stated"] | {"modulus": asked["modulus"]},
        "load": load,
        "grades": [] if is_scanned else study.outlined.to_dict("records"),
        "draws": draws_to_explore(study, config["wear_law"]),
        "truth": truth_met(study, load["held"]),
        "answer": verdict(study, config),
        "faults": [*config_faults, *reported(page.parent, steps, "ERROR")],
        "warnings": reported(page.parent, steps, "WARNING"),
        "notes": reported(page.parent, steps, "NOTE"),
        "scene": tool_scene(study, active_tool),
        "proposed": [] if is_scanned else study.table("places").to_dict("records"),
        "records": patch_records(study) if is_scanned else {},
        "shown": shown,
        "agreement": AGREEMENT,
        "three_js": three_js(),
        "methods": methods,
        "curves": {
            f"figures/{file.name}": file.read_text("utf-8")
            for file in study.files.get("curves", [])
        },
    }
    write_whole(page, render("page.html", **content).encode())


def scan_dates(study: Results) -> list[str]:
    """The first and the last day on which scans were taken, if their files say when."""
    patches = (study.places or {}).get("patch", [])
    days = set()
    for epoch in ("t0", "t1"):
        for scan in study.by_patch(epoch, patches).values():
            when = str(scan.attrs.get("acquired", ""))
            days |= set(re.findall(r"^\d{4}-\d\d-\d\d", when))
    return sorted({min(days), max(days)}) if days else []


def patch_records(study: Results) -> dict[str, dict[str, Any]]:
    """The content of the card of each patch: its rows of the tables, or empty dicts, and pictures.

    ``wear`` is the row of the study's own prediction, ``mcc`` the score of every other model by the
    model's name in words; ``picture`` and ``strip`` are data URLs, ``scans`` the names of scans.
    """
    tables = {
        name: study.table(table)
        for name, table in _OF_PATCHES.items()
        if table in study.tables
    }
    others = pd.DataFrame(columns=["patch", "model", "mcc"])
    if "wear" in tables:
        wear = tables["wear"]
        tables["wear"] = wear[wear.model == own_model(list(wear.model))]
        others = wear[~wear.model.isin([BARE, INTERLAYER])]
        others = others.assign(model=others.model.map(MODELS))
    rows = {name: _by_patch(table) for name, table in tables.items()}
    records = {}
    for patch, t0, t1 in study.outlined[["patch", "t0", "t1"]].itertuples(index=False):
        mcc = others[others.patch == patch].set_index("model").mcc
        records[patch] = {
            "patch": patch,
            "scans": " → ".join(filter(None, [t0, t1])),
            "picture": _picture(study, "by_patch", f"{patch}.png"),
            "strip": _picture(study, "strips", f"{patch}.jpg"),
            "mcc": mcc.to_dict(),
            **{name: rows.get(name, {}).get(patch, {}) for name in _OF_PATCHES},
        }
    return records


def _by_patch(table: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """The row of each patch in a table, without its empty cells."""
    rows = table.astype(object).set_index("patch").iterrows()
    return {str(patch): row.dropna().to_dict() for patch, row in rows}


def _picture(study: Results, folder: str, name: str) -> str | None:
    """A picture of a patch as a data URL, if there is one."""
    if not study.has(folder) or not (file := study.files[folder] / name).exists():
        return None
    return embedded(file)


def reported(results: Path, steps: Sequence[str], level: str) -> list[dict[str, Any]]:
    """The messages of the steps at a level, each once: ``text``, ``steps``, ``patches`` named.

    `level` is one of `gst.run.chain.LEVELS`.
    """
    reporters: dict[str, list[str]] = {}
    for name in steps:
        # a batch is not a separate step
        step = re.sub(r"_\d+$", "", name).replace("_", " ")
        for text in messages_of(results, name, level):
            reporters.setdefault(text, []).append(step)
    messages = []
    for text, names in reporters.items():
        match = re.match(r"patch(?:es)? ([\w-]+(?:, [\w-]+)*)", text)
        patches = match[1].split(", ") if match else []
        reporting = list(dict.fromkeys(names))
        messages.append({"text": text, "steps": reporting, "patches": patches})
    return messages


def write_contents(contents: Path, page: Path, entries: Sequence[Shown]) -> None:
    """Write the list of the results with their captions, the page first."""
    listed = []
    for one in [Shown(page, *_ABOUT_PAGE), *entries]:
        name = one.file.relative_to(page.parent).as_posix()
        listed.append(asdict(one) | {"file": name, "sha256": sha256(one.file)})
    write_json(contents, listed)


def write_json(file: Path, content: object) -> None:
    """Write a file of JSON for people and programs, whole or not at all."""
    text = json.dumps(content, indent=1, ensure_ascii=False)
    write_whole(file, f"{text}\n".encode())
