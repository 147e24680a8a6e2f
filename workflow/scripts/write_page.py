"""Write the page of the study, the record of its sources, and the contents."""

from pathlib import Path

from gst import ROOT
from gst.page.study_page import StudyPage, refuse_edited
from gst.run.logs import run_script


def main(
    page: Path,
    record: Path,
    contents: Path,
    *,
    captions: list[str],
    titles: list[list[str]],
    steps: dict[str, str],
    places: dict[str, list],
    patch_mm: float,
    mesh_unit: str,
    active_tool: dict | None,
    config: dict,
    config_faults: list[dict],
    tables: dict[str, str],
    commit: str | None,
    program: str,
    **files: Path | list[Path],
) -> None:
    """`files` are the inputs (see `StudyPage`), `captions` names of files of the program.

    `tables` are those of the config, with their SHA-256 as the run began.
    """
    refuse_edited(tables)
    files["captions"] = [ROOT / "workflow/report" / caption for caption in captions]
    told = titles, steps, places, patch_mm, mesh_unit, active_tool, config, config_faults
    study = StudyPage(files, *told)
    study.write(page, record, contents, commit=commit, program=program)


if "snakemake" in globals():
    run_script(snakemake, main)
