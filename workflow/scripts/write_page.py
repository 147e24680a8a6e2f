"""Write the page of the study: the answer, the tool in 3D, every patch, figure and table.

Inputs: the tool's mesh, its square and contact; every figure and table that is shown, the table
that is packed with them, and the captions of all; the folder with the pictures of single patches,
if there is one; every file that the study was made from. Outputs: the page, and the answer alone
for the report; the record of where the results come from; the contents: of the page and each of the
others file, category, title, caption (HTML) and SHA-256. Settings: the category and the title of
each figure and table; the names of the study's steps, for their records; the patches' places and
size; the whole config, which captions quote; the commit and the hash of the program.
"""

import json
from pathlib import Path

from gst.chain import certified_inputs
from gst.logs import run_script
from gst.page import (
    Shown,
    by_category,
    caption_html,
    embedded,
    patch_records,
    render,
    tool_scene,
    warned,
)
from gst.poses import poses_of
from gst.provenance import study_provenance
from gst.verdict import verdict, where_to_scan
from gstlib.conditions import load_force
from gstlib.io.files import sha256, write_whole
from gstlib.io.meshes import read_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.macroscale.active_tool import SecondStone, posed_mesh
from gstlib.macroscale.sampling_sites import concentration
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.frames import FRAME, stored_frame

# Tables that the answer is computed from.
JUDGED = ["patch_pressures", "patch_intervals", "registration", "validation_patches"]
JUDGED += ["validation_summary", "exposure"]
PAGE = "0 Overview", "the page of the study"
WHAT = (
    "The answer, the tool in 3D, all warnings, a card for each patch, every figure and table."
)


def main(
    mesh: Path,
    counterface: Path,
    surface: Path,
    contact: Path,
    exposure: Path | list,
    shown: list[Path],
    behind: Path | list,
    captions: list[Path],
    by_patch: Path | list,
    made_from: list[Path],
    page: Path,
    report: Path,
    record: Path,
    contents: Path,
    *,
    titles: list[list[str]],
    steps: list[str],
    places: dict[str, list],
    patch_mm: float,
    mesh_unit: str,
    second_stone: dict | None,
    config: dict,
    commit: str | None,
    program: str,
) -> None:
    inputs = certified_inputs(results := page.parent, steps, made_from)
    listed_files = [*shown, *([behind] if behind else [])]
    tables = {file.stem: file for file in shown if file.suffix == ".csv"}
    pictures = {file.stem: file for file in shown if file.suffix == ".png"}
    frame = stored_frame(read_dataset(surface, only=FRAME))
    size = config["square"]["size_mm"]
    fields = [read_dataset(contact, only=["pressure"]).pressure]
    fields[0].attrs["title"] = "pressure"
    if exposure:
        found = read_dataset(exposure, only=["exposure", "touched"])
        fields.append(found.exposure.assign_attrs(title="exposure"))
    force_N, proposed = load_force(config["load"], size), None
    if "places" in tables:
        proposed = read_table(tables["places"])
        held = concentration(found, proposed, size_mm=size, patch_mm=patch_mm)
        answer = where_to_scan(proposed, held, force_N=force_N)
        places = proposed.rename(columns={"place": "patch"}).assign(rotation_deg=0.0)
    else:
        fields = [square_of(field, size) for field in fields]
        answer = verdict(
            {name: read_table(tables[name]) for name in JUDGED if name in tables},
            force_N=force_N,
            mat=config["mat"],
            hardness_MPa=config["hardness"],
            poses=None if (poses := poses_of(config)) is None else len(poses),
            second=bool(counterface),
        )
    said = {"verdict": answer, "generated": config["specimen"] is not None}
    overview = embedded(pictures["overview" if proposed is None else "places"].read_bytes())
    write_whole(report, render("page.report.html", **said, overview=overview).encode())

    other = None
    if counterface:
        other = posed_mesh(SecondStone.read(**second_stone), frame, size_mm=size)
    tool = read_mesh(mesh, unit=mesh_unit)
    scene = tool_scene(tool, frame, fields, places, (size, patch_mm), other)
    entries = [
        Shown(file, category, title, caption_html(caption.read_text("utf-8"), config=config))
        for file, caption, (category, title) in zip(listed_files, captions, titles, strict=True)
    ]
    records = patch_records(tables, by_patch or None) if proposed is None else []
    content = {
        "title": config["title"],
        "force": force_N,
        "proposed": [] if proposed is None else proposed.to_dict("records"),
        "scene": scene,
        "size": scene["frame"]["size"],
        "records": {record["patch"]: record for record in records},
        "warnings": warned(results, steps),
        "shown": by_category(entries[: len(shown)]),
        "compared": "validation_summary" in tables,
    }
    write_whole(page, render("page.html", **said, **content).encode())
    write_json(contents, listed([Shown(page, *PAGE, WHAT), *entries], results))
    write_json(record, study_provenance(config, inputs, commit, program))


def listed(entries: list[Shown], results: Path) -> list[dict[str, str]]:
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


def write_json(file: Path, content: object) -> None:
    text = json.dumps(content, indent=1, ensure_ascii=False)
    write_whole(file, f"{text}\n".encode())


if "snakemake" in globals():
    run_script(snakemake, main)
