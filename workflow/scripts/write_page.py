"""Write the page of the study, its provenance and its contents."""

from pathlib import Path

from gst.page.captions import caption_html, caption_of
from gst.page.methods import methods_text
from gst.page.page import Shown
from gst.page.results import Results
from gst.page.study_page import (
    refuse_edited,
    write_contents,
    write_json,
    write_study_page,
)
from gst.run.chain import certified_inputs, versions_of
from gst.run.logs import run_in_snakemake
from gst.run.provenance import study_provenance
from gstlib.conditions import load_force


def main(
    page: Path,
    record: Path,
    contents: Path,
    *,
    shown: list[Path],
    behind: Path | list,
    made_from: list[Path],
    described: list[list[str]],
    steps: dict[str, str],
    places: dict[str, list],
    mesh_unit: str,
    config: dict,
    tables: dict[str, str],
    commit: str | None,
    program: str,
    config_faults: list[dict],
    active_tool: dict | None,
    **files: Path | list[Path],
) -> None:
    """`shown` are figures and tables on the page, and `behind` contains the numbers of a figure.

    Each is `described` by its caption, category and title. `files` are as in `write_study_page`.
    `tables` contains the SHA-256 of the tables of the config when the run began.

    Raises an `InputError` if a result has changed since its step made it, or if a step had other
    parameters than the config gives.
    """
    refuse_edited(tables)
    inputs = certified_inputs(page.parent, steps, made_from)
    study = Results(
        {**files, **{file.name: file for file in shown}},
        places=places,
        size_mm=config["square"]["size_mm"],
        patch_mm=config["scans"]["size_mm"],
        force_N=load_force(config["load"], config["square"]["size_mm"]),
        mesh_unit=mesh_unit,
    )
    all_files = [*shown, *([behind] if behind else [])]
    entries = [
        Shown(file, category, title, caption_html(caption_of(caption), config=config))
        for file, (caption, category, title) in zip(all_files, described, strict=True)
    ]
    versions = versions_of(page.parent, steps)
    origin = study_provenance(config, inputs, commit, program, versions)
    about = {
        "methods": methods_text(
            origin, study.tables, study.table("use") if "use" in study.tables else None
        ),
        "config_faults": config_faults,
        "active_tool": active_tool,
        "steps": list(steps),
    }
    write_study_page(page, study, config, entries[: len(shown)], **about)
    write_contents(contents, page, entries)
    write_json(record, origin)


run_in_snakemake(main)
