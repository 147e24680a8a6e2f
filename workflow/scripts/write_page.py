"""Write the page of the study: the answer, the tool in 3D, every patch, figure and table.

Inputs: the tool's mesh, its square and contact; every figure and table that is shown, and the
captions of both; the folder with the pictures of single patches, if there is one. Outputs: the
page, and the answer alone for the report. Settings: the category and the title of each figure and
table; the logs of the run's steps, for their warnings; the patches' places and size; the config,
which captions quote.
"""

from pathlib import Path

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
from gst.verdict import SCORE, verdict
from gstlib.counterface import SecondStone, posed_mesh
from gstlib.geometry import FRAME, stored_frame
from gstlib.io.files import write_whole
from gstlib.io.meshes import read_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_pressures, read_table


def main(
    mesh: Path,
    counterface: Path,
    surface: Path,
    contact: Path,
    shown: list[Path],
    captions: list[Path],
    by_patch: Path | list,
    page: Path,
    report: Path,
    *,
    titles: list[list[str]],
    logs: list[str],
    places: dict[str, list],
    patch_mm: float,
    mesh_unit: str,
    second_stone: dict | None,
    config: dict,
) -> None:
    tables = {file.stem: file for file in shown if file.suffix == ".csv"}
    pictures = {file.stem: file for file in shown if file.suffix == ".png"}
    frame = stored_frame(read_dataset(surface, only=FRAME))
    pressure = read_dataset(contact, only=["pressure"])["pressure"]
    answer = verdict(
        read_pressures(tables["patch_pressures"]),
        read_table(tables["patch_intervals"]),
        *(
            read_table(tables[name]) if name in tables else None
            for name in ("validation_gains", "validation_variants")
        ),
        square_force_N=float(pressure.mean()) * config["square"]["size_mm"] ** 2,
    )
    said = {"verdict": answer, "generated": config["specimen"] is not None}
    overview = embedded(pictures["overview"].read_bytes())
    write_whole(report, render("page.report.html", **said, overview=overview).encode())

    other, size = None, config["square"]["size_mm"]
    if counterface:
        other = posed_mesh(SecondStone.read(**second_stone), frame, size_mm=size)
    tool = read_mesh(mesh, unit=mesh_unit)
    scene = tool_scene(tool, frame, pressure, places, patch_mm, other)
    entries = [
        Shown(file, category, title, caption_html(caption.read_text("utf-8"), config=config))
        for file, caption, (category, title) in zip(shown, captions, titles, strict=True)
    ]
    records = patch_records(tables, by_patch or None)
    content = {
        "title": config["title"],
        "target": config["macroscale"]["target_pressure_MPa"],
        "scene": scene,
        "size": scene["frame"]["size"],
        "records": {record["patch"]: record for record in records},
        "warnings": warned([Path(log) for log in logs]),
        "shown": by_category(entries),
        "compared": "validation_gains" in tables,
        "score": SCORE,
    }
    write_whole(page, render("page.html", **said, **content).encode())


if "snakemake" in globals():
    run_script(snakemake, main)
