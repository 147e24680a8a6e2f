"""The command that runs the study in a folder of its own."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def snakemake_command(folder, config, *arguments):
    """Snakemake on the config `config` in `folder`, by this interpreter, with more arguments."""
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")]
    command += ["--directory", str(folder), *arguments]
    return [*command, "--configfile", str(folder / config)]
