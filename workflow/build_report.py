"""Build the report of a finished study, unless it is up to date, and say where everything is."""

import argparse
import subprocess
import sys
from pathlib import Path

from gstlib.errors import ConfigError
from gstlib.io.config_file import read_config_file

DEFAULT = Path(__file__).parents[1] / "config" / "config.yaml"


def results_folder(config: Path) -> Path:
    """The study's result folder: the key `results`, from the config or from the default one."""
    for file in (config, DEFAULT):
        try:
            settings = read_config_file(file)
        except ConfigError as error:
            raise SystemExit(f"\nERROR: {error}") from None
        if "results" in settings:
            return Path(str(settings["results"]))
    raise SystemExit(f"{DEFAULT} lacks the key 'results'")


def is_up_to_date(report: Path) -> bool:
    """Whether the report is there, and no older than anything that it shows."""
    folder = report.parent
    # its texts show the config: the title, settings; the record is written anew when that changes
    shown = [*folder.glob("tables/*"), *folder.glob("figures/**/*.png")]
    newest = max(file.stat().st_mtime for file in [folder / "provenance.json", *shown])
    return report.exists() and report.stat().st_mtime >= newest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("config", type=Path)
    parser.add_argument("--print-folder", action="store_true", help="only print the result folder")
    arguments = parser.parse_args()
    folder = results_folder(arguments.config)
    if arguments.print_folder:
        print(folder)
        return
    report = folder / "report.html"
    if not is_up_to_date(report):
        snakemake = [sys.executable, "-m", "snakemake", "--configfile", arguments.config]
        # half a report, newer than all that it shows, would pass for whole
        part = report.with_name(".report.part.html")
        subprocess.run([*snakemake, "--report", part, "--quiet", "all"], check=True)
        part.replace(report)
    print(f"Done. Report: {report} (open it in a browser); tables: {folder / 'tables'}")


if __name__ == "__main__":
    main()
