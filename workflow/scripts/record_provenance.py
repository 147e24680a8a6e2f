"""Record where the study's results come from.

Inputs: the patch table and every measured file. Outputs: provenance.json. Settings: the config, the
program's commit.
"""

import json
from pathlib import Path

from gstlib.io.files import write_whole
from gstlib.logs import job_log
from gstlib.provenance import study_provenance


def main(inputs: list[str], output: Path, *, config: dict, commit: str | None) -> None:
    text = json.dumps(study_provenance(config, inputs, commit), indent=1, ensure_ascii=False)
    write_whole(output, f"{text}\n".encode())


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            list(snakemake.input),
            Path(snakemake.output.record),
            config=snakemake.params.config,
            commit=snakemake.params.commit,
        )
