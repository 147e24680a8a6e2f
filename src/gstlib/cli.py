"""The command `gst`: a look at one's files from the shell."""

import json
import sys
from pathlib import Path

import click

import gstlib
from gstlib.errors import GstError

__all__ = ["main"]

# What stands here for the keys of a config that a refusal of a file may ask for.
_OPTIONS = {"scans.unit": "--unit", "spacing_um": "--spacing-um"}


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(gstlib.__version__, prog_name="gst")
def main() -> None:
    """Looks at the files of a study. The study itself is run by `make study` (Snakemake)."""


@main.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--unit",
    type=click.Choice(["m", "cm", "mm", "um", "nm", "in"]),
    help="Unit of files that do not say it.",
)
@click.option(
    "--spacing-um",
    type=float,
    help="Spacing (µm) of points in text that does not say it, or to grid scattered points with.",
)
@click.option(
    "--picture",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Draw the heights into this PNG (one file only).",
)
@click.option("--json", "as_json", is_flag=True, help="For machines: one JSON object a line.")
def inspect(files, unit, spacing_um, picture, as_json) -> None:
    """What is in a scan or a mesh: size, spacing, units, unmeasured share, Sq, a thumbnail.

    Ends with exit code 1 if a file cannot be read; the others are shown all the same.
    """
    from gstlib.inspection import inspect_file, text_thumbnail

    if picture is not None and len(files) > 1:
        raise click.UsageError("--picture takes one file")
    if picture is not None and picture.suffix.lower() != ".png":
        raise click.UsageError(f"--picture draws a PNG: name it .png, not '{picture.name}'")
    failed = False
    for file in files:
        try:
            facts, heights = inspect_file(file, unit=unit, spacing_um=spacing_um)
        except GstError as error:
            failed = True
            options = [option for key, option in _OPTIONS.items() if key in str(error)]
            here = f" For gst inspect, that is {' and '.join(options)}." if options else ""
            click.echo(f"ERROR: {error}{here}", err=True)
            continue
        if as_json:
            click.echo(json.dumps({"path": str(file)} | facts))
        else:
            click.echo(f"{file}\n{_table(facts)}\n\n{text_thumbnail(heights)}\n")
        if picture is not None:
            from gstlib.figures import save_figure, surface_figure

            save_figure(surface_figure(heights, title=file.name), picture)
    sys.exit(failed)


def _table(facts: dict[str, object]) -> str:
    width = max(map(len, facts))
    return "\n".join(
        f"  {name.ljust(width)}  {value:.5g}" if isinstance(value, float)
        else f"  {name.ljust(width)}  {value}"
        for name, value in facts.items()
    )  # fmt: skip


@main.command()
@click.argument("before", type=click.Path(path_type=Path))
@click.argument("after", type=click.Path(path_type=Path))
@click.option(
    "--tolerance",
    type=float,
    default=0.0,
    show_default=True,
    help="Numbers that differ by at most this share of their value are the same.",
)
@click.option("--json", "as_json", is_flag=True, help="For machines: one JSON list of changes.")
@click.option(
    "--at-most", type=int, default=20, show_default=True, help="Changes shown of each table."
)
def diff(before, after, tolerance, as_json, at_most) -> None:
    """What changed between two result folders: tables, and config, inputs and versions behind them.

    Exit code 0 if nothing changed, 1 if something did, 2 if they cannot be compared.
    """
    from gstlib import difference

    try:
        changes = difference.compare_results(before, after, tolerance)
    except GstError as error:
        click.echo(f"ERROR: {error}", err=True)
        sys.exit(2)
    if as_json:
        click.echo(difference.as_json(changes))
    else:
        text = difference.describe_changes(changes, at_most)
        click.echo(text or f"No difference between {before} and {after}.")
    # A result comes of its config and inputs: where only those differ, the results are the same.
    sys.exit(any(change.where != "provenance" for change in changes))


@main.command()
@click.argument("results", type=click.Path(path_type=Path))
@click.argument("archive", type=click.Path(path_type=Path, dir_okay=False))
def crate(results, archive) -> None:
    """Pack a study's tables, figures and report into an RO-Crate, a ZIP, for a repository.

    It says with which settings, inputs and versions they were made.
    """
    from gstlib.crate import write_crate

    try:
        count = write_crate(results, archive)
    except GstError as error:
        click.echo(f"ERROR: {error}", err=True)
        sys.exit(1)
    click.echo(f"{archive}: {count} files and where they come from")


@main.command()
@click.argument("results", type=click.Path(path_type=Path))
def config(results) -> None:
    """Print the config that results were made with, to make them again.

    Every value stands in it, defaults included.
    """
    import yaml

    from gstlib.crate import read_record

    try:
        record = read_record(results)
    except GstError as error:
        click.echo(f"ERROR: {error}", err=True)
        sys.exit(1)
    commit = record["software"]["commit"] or "unknown"
    click.echo(f"# gstlib {record['software']['gstlib']}, commit {commit}")
    click.echo(yaml.safe_dump(record["config"], sort_keys=False, allow_unicode=True), nl=False)
