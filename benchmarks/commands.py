"""The study by Snakemake, in a folder of its own."""

import os
import shutil
import subprocess
import sys

import yaml
from runner import ROOT


def snakemake_command(folder, config, *arguments):
    """Snakemake on the config `config` in `folder`, by this interpreter, with more arguments."""
    command = [
        sys.executable,
        "-m",
        "snakemake",
        "--snakefile",
        str(ROOT / "Snakefile"),
    ]
    command += ["--directory", str(folder), *arguments]
    return [*command, "--configfile", str(folder / config)]


def run_study(folder, config, cores, environment):
    """Run a shipped study in `folder`, with more in its environment; return its results."""
    shutil.copytree(ROOT / "config", folder / "config")
    command = snakemake_command(folder, config, "--cores", str(cores), "--quiet", "all")
    subprocess.run(command, cwd=folder, env=os.environ | environment, check=True)
    return folder / yaml.safe_load((folder / config).read_text())["results"]
