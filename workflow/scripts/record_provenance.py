"""Record where the study's results come from."""

import json
from pathlib import Path

from gstlib.io.files import write_whole
from gstlib.logs import run_script
from gstlib.provenance import study_provenance


def main(files: list[Path], record: Path, *, config: dict, commit: str | None) -> None:
    text = json.dumps(study_provenance(config, files, commit), indent=1, ensure_ascii=False)
    write_whole(record, f"{text}\n".encode())


if "snakemake" in globals():
    run_script(snakemake, main)
