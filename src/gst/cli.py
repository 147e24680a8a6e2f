"""The command `gst`: everything that a user can do with a study from the shell.

The commands have these exit codes. Once `study` has started Snakemake, it returns Snakemake's code.

- 0: success
- 1: `diff` found tables that differ
- 2: error (any `GstError` or `OSError`), wrong usage or interrupted
"""

import io
import logging
import os
import shlex
import sys
from pathlib import Path

import click

import gst
import gstlib
from gstlib.errors import GstError
from gstlib.io.files import write_whole

# The first words of a config that `gst new` wrote.
_MADE_BY_NEW = "# Made by `gst new`"
# The user's current folder, if it is not the folder of the study.
_HERE = "gst.here"
_SETTINGS = {"help_option_names": ["-h", "--help"], "show_default": True}


_PATH = click.Path(path_type=Path)
_POSITIVE = click.FloatRange(min=0, min_open=True)
_UNITS = click.Choice(["m", "cm", "mm", "um", "nm", "in"])
_UNIT = click.option(
    "--unit", type=_UNITS, help="Unit of files that do not contain one."
)
_SPACING = click.option(
    "--spacing-um",
    type=_POSITIVE,
    help="Point spacing of text files that do not contain it, µm.",
)
# of `gst.page.figures.style.save_figure`
_ENDINGS = ".png", ".svg", ".pdf"
_RESULTS = click.argument("results", type=_PATH)


def _in_its_folder(
    context: click.Context, _parameter: click.Parameter, config: Path
) -> Path:
    """The config. For a folder that `gst new` made, or its ``study.yaml``, enter the folder."""
    folder = config if config.is_dir() else config.parent
    study = folder / "study.yaml"
    if config not in (folder, study) or not study.is_file():
        return config
    # paths in config/study.yaml of a package start from the folder around config
    text = study.read_text("utf-8-sig", "replace")
    if config == study and not text.startswith(_MADE_BY_NEW):
        return config
    if folder.resolve() != Path.cwd():
        click.echo(f"In {folder}:")
        context.meta[_HERE] = Path.cwd()
        os.chdir(folder)
    return Path("study.yaml")


def _drawable(
    _context: click.Context, _parameter: click.Parameter, picture: Path | None
) -> Path | None:
    """The name of a picture; its ending is checked before anything is computed."""
    if picture is not None and picture.suffix.lower() not in _ENDINGS:
        raise click.BadParameter("end the name in .png, .svg or .pdf")
    return picture


_PICTURE = click.option(
    "--output",
    type=_PATH,
    callback=_drawable,
    help="Picture (PNG, SVG or PDF), by default a new one here, named after its source.",
)


_CONFIG = click.argument(
    "config", type=_PATH, default="config/config.yaml", callback=_in_its_folder
)


class _Screen(logging.Handler):
    """Shows the warnings of a command that has no config, in terms of its options."""

    def emit(self, record: logging.LogRecord) -> None:
        from gst.share.options import in_options

        text = in_options(record.getMessage())
        click.echo(f"{record.levelname}: {text}", err=True)


class _Commands(click.Group):
    """Commands that end with the message of an error and exit code 2."""

    def invoke(self, ctx: click.Context) -> None:
        if isinstance(sys.stdout, io.TextIOWrapper):
            # the terminal may lack characters of a file's name
            sys.stdout.reconfigure(errors="backslashreplace")
        try:
            super().invoke(ctx)
        except (GstError, OSError) as error:  # such as a name that is too long
            from gst.share.options import in_options

            is_alone = ctx.invoked_subcommand in ("press", "change")
            message = in_options(str(error)) if is_alone else error
            click.echo(f"ERROR: {message}", err=True)
        except (EOFError, KeyboardInterrupt):
            click.echo("Interrupted.", err=True)
        else:
            return
        ctx.exit(2)


@click.group(cls=_Commands, context_settings=_SETTINGS)
@click.version_option(gstlib.__version__, prog_name="gst")
@click.pass_context
def main(context) -> None:
    """Where does a ground stone tool wear? Set up, check and run a study, or inspect its files.

    Exit code 0 means success. Code 1 means that `diff` found tables that differ. Code 2 means an
    error, wrong usage or an interruption. `study` returns Snakemake's code once that has started.
    """
    if context.invoked_subcommand in ("new", "inspect", "press", "change"):
        root, screen = logging.getLogger(), _Screen(logging.WARNING)
        root.addHandler(screen)
        context.call_on_close(lambda: root.removeHandler(screen))


@main.command()
@click.argument("folder", type=_PATH)
@click.option("--mesh", type=_PATH, help="Mesh of the tool.")
@click.option(
    "--scans", type=_PATH, multiple=True, help="Scans or their folder (repeatable)."
)
@click.option(
    "--overview", type=_PATH, help="Larger map of the face, used to locate the scans."
)
@click.option("--names", help="Pattern of the scans' names, such as {patch}_{epoch}.")
@click.option("--like", type=click.Choice(gst.SHIPPED), help="Copy a shipped config.")
def new(folder, mesh, scans, overview, names, like) -> None:
    """Create a study in FOLDER from files or a shipped config."""
    if like and (mesh or scans):
        raise click.UsageError("give either --like, or --mesh and --scans")
    if (overview or names) and not scans:
        raise click.UsageError("--overview and --names also need --scans")
    if scans and mesh is None:
        raise click.UsageError(
            "--scans also needs --mesh, the mesh of the scanned tool"
        )
    if mesh is not None:
        from gst.setup.new_study import new_study

        click.echo(new_study(folder, mesh, scans, overview, names), nl=False)
        return
    from gst.run.running import lay_out

    like = like or "own"
    click.echo("\n".join(map(str, lay_out(folder, like))))
    again = f"cd {shlex.quote(str(folder))}; gst check config/{like}.yaml"
    click.echo(f"Fill in these files, then run: {again}")


@main.command()
@click.argument("folder", type=_PATH, callback=_in_its_folder)
@click.option(
    "--browser/--no-browser", default=True, help="Open the page in the browser."
)
def place(folder, browser) -> None:
    """Lead the study in FOLDER to its result, in a browser."""
    from gst.setup.place import serve

    serve(folder, browser=browser)


@main.command()
@_CONFIG
@click.option(
    "--fix", is_flag=True, help="Show single possible fixes; apply them if confirmed."
)
@click.option("--yes", is_flag=True, help="With --fix: apply without asking.")
def check(config, fix, yes) -> None:
    """Check all files of CONFIG, and list the steps of a run."""
    from gst.check.checking import check_study
    from gst.check.fixing import Cure, offer

    cures: list[Cure] | None = [] if fix else None
    try:
        check_study(config, cures)
    except GstError as error:
        if not cures:
            raise
        click.echo(f"ERROR: {error}", err=True)
    if not fix:
        return
    if not cures:
        click.echo("No automatic fixes are available.")
    elif offer(config, cures, is_confirmed=yes):
        click.echo("Run the check again.")
    else:
        sys.exit(2)


@main.command(context_settings={"ignore_unknown_options": True})
@_CONFIG
@click.argument(
    "options", metavar="[SNAKEMAKE OPTIONS]...", nargs=-1, type=click.UNPROCESSED
)
@click.option("--cores", help="Number of parallel jobs (2 in the default profile).")
@click.option(
    "--profile",
    default="default",
    help="default, slurm, or the path of your own profile.",
)
@click.option("--plan", is_flag=True, help="Show the jobs without running them.")
@click.pass_context
def study(context, config, options, cores, profile, plan) -> None:
    """Run the study of CONFIG; accepts options of Snakemake."""
    if str(config).startswith("-"):
        raise click.UsageError(f"put CONFIG before the Snakemake option {config}")
    from gst.run.running import run_study

    asked = {"cores": cores, "profile": profile, "plan": plan, "options": options}
    sys.exit(run_study(config, here=context.meta.get(_HERE), **asked))


@main.command()
@click.argument("files", nargs=-1, required=True, type=_PATH)
@_UNIT
@_SPACING
@click.option("--pictures", type=_PATH, help="Folder for a picture (PNG) of each file.")
def inspect(files, unit, spacing_um, pictures) -> None:
    """Show the contents of scans, meshes and their folders."""
    from gst.check.inspecting import describe_files

    if not describe_files(files, unit=unit, spacing_um=spacing_um, pictures=pictures):
        sys.exit(2)


@main.command()
@click.argument("scan", type=_PATH)
@click.option("--pressure", type=_POSITIVE, required=True, help="Mean pressure, MPa.")
@click.option(
    "--modulus", type=_POSITIVE, default=10346.0, help="Contact modulus E*, MPa."
)
@click.option("--periodic", is_flag=True, help="Repeat the surface periodically.")
@_UNIT
@_SPACING
@_PICTURE
def press(scan, output, **options) -> None:
    """Press one SCAN on a flat, and draw curve and maps."""
    from gst.page.figures.inspected import pressed_figure
    from gst.page.figures.style import save_figure
    from gst.run.owned import free_name
    from gst.share.press import describe_press, press_scan

    prepared, contact = press_scan(scan, **options)
    curve = contact.table()
    click.echo(curve.to_string(index=False, float_format="{:.5g}".format))
    summary = describe_press(prepared, contact.final, options["modulus"])
    click.echo(f"\n{summary}")
    picture = output or free_name(Path(f"{scan.name}.png"))
    save_figure(pressed_figure(prepared["height"], contact, scan.name), picture)
    table = picture.with_name(f"{picture.stem}_curve.csv")
    write_whole(table, curve.to_csv(index=False, float_format="%.5g").encode())
    click.echo(f"picture     {picture}\ncurve       {table}")


@main.command()
@click.argument("t0", type=_PATH)
@click.argument("t1", type=_PATH)
@click.option(
    "--repeat", type=_PATH, help="Second scan of T0, for the detection limit."
)
@click.option(
    "--mould", is_flag=True, help="The scans are of moulds, so turn them over."
)
@_UNIT
@_SPACING
@_PICTURE
def change(t0, t1, repeat, output, **options) -> None:
    """Measure the loss between two scans T0 and T1; draw it."""
    from gst.page.figures.inspected import changed_figure
    from gst.page.figures.style import save_figure
    from gst.run.owned import free_name
    from gst.share.change import compare_scans, describe_change

    height, changed = compare_scans(t0, t1, repeat, **options)
    for line in describe_change(changed):
        click.echo(line)
    picture = output or free_name(Path(f"{t1.stem}_change.png"))
    save_figure(changed_figure(height, changed, (t0.name, t1.name)), picture)
    click.echo(f"picture     {picture}")


@main.command()
@click.argument("before", type=_PATH)
@click.argument("after", type=_PATH)
@click.option(
    "--tolerance",
    type=click.FloatRange(min=0),
    default=0.0,
    help="Relative difference up to which numbers are equal.",
)
def diff(before, after, tolerance) -> None:
    """Compare two results (exit code 1 if tables differ)."""
    from gst.share.difference import compare_results, describe_changes

    changes = compare_results(before, after, tolerance)
    click.echo(
        describe_changes(changes) or f"No difference between {before} and {after}."
    )
    if differ := sorted(set(changes.table) - {"provenance"}):
        click.echo(f"Tables that differ (exit code 1): {', '.join(differ)}")
    sys.exit(bool(differ))


@main.command()
@_RESULTS
@click.option("--to", type=_PATH, help="Folder, by default `export` in RESULTS.")
def export(results, to) -> None:
    """Export maps and tool for other programs (x3p, grid, GLB)."""
    from gst.share.export import export_study

    to = to or results / "export"
    click.echo(f"{to}: {len(export_study(results, to))} files")


@main.command()
@_RESULTS
@click.option(
    "--output", type=_PATH, help="Zip file, by default here, named after RESULTS."
)
@click.option(
    "--author", "authors", multiple=True, help="Author of the study (repeatable)."
)
@click.option("--license", "licence", help="Licence, such as CC-BY-4.0 (SPDX).")
def package(results, output, authors, licence) -> None:
    """Pack a finished study into one zip file."""
    from gst.share.package import pack_study

    output = output or Path(f"{results.resolve().name}.zip")
    count = pack_study(results, output, authors=authors, licence=licence)
    click.echo(f"{output}: {count} files, {output.stat().st_size / 1e6:.1f} MB")
