"""Record where the study's results come from.

Inputs: the patch table and every measured file. Outputs: provenance.json. Settings: the config, the
program's commit.
"""

import json
import os
from pathlib import Path

from gstlib.logs import job_log
from gstlib.provenance import study_provenance


def main(inputs: list[str], output: Path, *, config: dict, commit: str | None) -> None:
    text = json.dumps(study_provenance(config, inputs, commit), indent=1, ensure_ascii=False)
    temporary = output.with_name(f".{output.name}.{os.getpid()}.part")
    try:
        temporary.write_text(text + "\n", encoding="utf-8")
        os.replace(temporary, output)
    finally:
        temporary.unlink(missing_ok=True)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            list(snakemake.input),
            Path(snakemake.output.record),
            config=snakemake.params.config,
            commit=snakemake.params.commit,
        )
