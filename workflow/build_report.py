"""Build the archive report of a finished study, unless it is up to date, and say what to open."""

import subprocess
import sys
from pathlib import Path

from prepare import read_config

# What the report shows, and the logs of the steps, which tell when they ran.
SHOWN = ("provenance.json", "verdict.html", "tables/*.csv", "figures/**/*.png", "logs/**/*.log")


def is_report_current(results: Path) -> bool:
    """Whether the report exists and is no older than what it shows."""
    report = results / "report.html"
    dates = [file.stat().st_mtime_ns for pattern in SHOWN for file in results.glob(pattern)]
    return report.is_file() and report.stat().st_mtime_ns >= max(dates, default=0)


def main() -> None:
    config = Path(sys.argv[1])
    folder = Path(read_config(config)["results"])
    report = folder / "report.html"
    if not is_report_current(folder):
        # Half a report, newer than everything that it shows, would pass for a whole one.
        part = report.with_name(".report.part.html")
        snakemake = [sys.executable, "-m", "snakemake", "--configfile", config]
        subprocess.run([*snakemake, "--report", part, "--quiet", "all"], check=True)
        part.replace(report)
    print(f"Done. Open {folder / 'index.html'} in a browser.")
    print(f"The archive of the study: {report}; its tables: {folder / 'tables'}")


if __name__ == "__main__":
    main()
