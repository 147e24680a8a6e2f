"""Read the config before Snakemake does, which answers one that is no YAML with a traceback."""

import argparse
from pathlib import Path

from build_report import results_folder

from gstlib.io.config_file import read_config_file

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("config", type=Path)
    parser.add_argument("--needs", metavar="SECTION", help="that is null in config.yaml")
    arguments = parser.parse_args()
    results_folder(arguments.config)
    needed = arguments.needs
    if needed and not read_config_file(arguments.config).get(needed):
        raise SystemExit(
            f"\nERROR: {arguments.config}: has no section '{needed}'. Put one into it, as in "
            f"config/{needed}.yaml."
        )
