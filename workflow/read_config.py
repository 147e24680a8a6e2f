"""Read the config before Snakemake does, which answers one that is no YAML with a traceback."""

import argparse
from pathlib import Path

from build_report import results_folder

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("config", type=Path)
    results_folder(parser.parse_args().config)
