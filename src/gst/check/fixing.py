"""Faults with one cure, and how it is applied: `gst check --fix`.

The user sees the difference of the files first, and confirms it; each file is kept beside, as
``study.yaml.bak``. What could have two causes has no cure here: exchanged epochs, for one, look
like moulds that were not undone, unless the mesh shows which of the two it is.
"""

import difflib
import filecmp
import itertools
import logging
import math
import os
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gst.config.edited import Cells, save_text, text_of, with_cells, with_values
from gst.config.reading import read_config_file
from gstlib.change.selection import exchanged_epochs, is_more
from gstlib.coupling.comparison import CANNOT_TELL, SHIFTED, shows_waves
from gstlib.coupling.orientations import AS_GIVEN, Mould, as_measured, lying_right
from gstlib.coupling.placement import FAULT as PLACEMENT
from gstlib.coupling.placement import check_placement
from gstlib.errors import ConfigError, GstError
from gstlib.macroscale.face import largest_face
from gstlib.study import Study


class Cure(NamedTuple):
    """The changes that remove a fault, in the config by key and in the patch table; the reason.

    `button` names it in a word or two; `fault` is the name of the fault, if a config can accept it.
    """

    why: str
    values: Mapping[str, Any] = {}
    cells: Cells | None = None
    button: str = "Mend"
    fault: str = ""


def cures_of(study: Study) -> list[Cure]:
    """The cures of a study's faults, as far as each has one alone.

    Its scans can be read. A T1 that cannot be registered has left the study.
    """
    former = logging.root.manager.disable
    logging.disable()  # the check has reported all problems
    try:
        return [*_of_places(study), *_of_face(study)]
    finally:
        logging.disable(former)


def _of_places(study: Study) -> Iterator[Cure]:
    """Of scans that are laid wrongly, epochs exchanged, and a table mirrored or shifted."""
    config, patches = study.config, study.patches.set_index("patch")
    if patches.empty or not shows_waves(study.face.height, config["scans"]["size_mm"]):
        return
    scans = {patch: study.prepared[patch, "T0"] for patch in patches.index}
    settings = study.settings["check_placement"] | {"accept": [PLACEMENT]}
    table = check_placement(study.face.height, study.patches, scans, **settings)
    together, mould = table.iloc[-1], Mould(**config["scans"]["mould"])
    size_mm = config["square"]["size_mm"]
    if together.orientation not in ("", AS_GIVEN):
        if not patches.flip.any():  # in some rows, which are another matter
            yield from _laid_right(together.orientation, mould, size_mm)
        return
    alone = table.iloc[:-1]
    for row in alone[alone.orientation != ""].itertuples():
        own = mould.of_row(patches.flip[row.patch])
        yield from _laid_right(row.orientation, own, size_mm, row.patch)
    if together.status == CANNOT_TELL:
        return
    # heights that fit the mesh have the right sign, so that they rose tells the epochs
    if _are_exchanged(study):
        yield Cure(
            "t0 and t1 are exchanged: heights rose with use",
            cells=lambda row: (
                {"t0": row["t1"], "t1": row["t0"]} if row["t0"] and row["t1"] else {}
            ),
            button="Exchange",
            fault="epochs",
        )
    elif together.status == SHIFTED:
        x, y = (round(float(together[f"shift_{axis}_um"])) / 1e3 for axis in "xy")
        yield Cure(
            f"all patches lie {x:+g} mm along x and {y:+g} mm along y from their given positions",
            cells=lambda row: _plus(row, x_mm=x, y_mm=y),
            button="Move",
            fault=PLACEMENT,
        )


def _laid_right(
    orientation: str, mould: Mould, size_mm: float, patch: str = ""
) -> Iterator[Cure]:
    """Of all patches, or one, that fit the mesh with another orientation or table than as given.

    `mould` undid the moulds. Heights in the file of one patch are not inverted here.
    """
    look, _, mistake = orientation.partition("with ")
    right, turn = lying_right(look.strip(), mould, is_alone=bool(patch))
    former = mould._asdict()
    new = {key: own for key, own in right._asdict().items() if own != former[key]}
    if patch and "invert" in new:
        return

    def cells(row: Mapping[str, str]) -> Mapping[str, object]:
        if patch not in ("", row["patch"]):
            return {}
        changed = _plus(row, rotation_deg=turn)
        if patch and "flip" in new:
            changed["flip"] = right.flip or "none"
        if mistake:
            x, y = (_number(row[column]) for column in ("x_mm", "y_mm"))
            x, y = as_measured(x, y, size_mm, mistake)
            changed |= {"x_mm": _cell(x), "y_mm": _cell(y)}
        return changed

    fit = f"patch {patch} fits" if patch else "the patches fit"
    yield Cure(
        f"{fit} the mesh {orientation}",
        {} if patch else {f"scans.mould.{key}": value for key, value in new.items()},
        cells if patch or turn or mistake else None,
        "Turn" if turn else "Move" if mistake else "Mirror",
        PLACEMENT,
    )


def _are_exchanged(study: Study) -> bool:
    """Whether heights rose from T0 to T1 on most patches, and clearly fell on none."""
    try:
        table = study.registration
    except GstError:
        return False
    fell = is_more(table.loss_fraction, table.gain_fraction)
    is_mixed = (fell & table.found.astype(bool)).any()
    return not is_mixed and any(exchanged_epochs(table))


def _plus(row: Mapping[str, str], **more: float) -> dict[str, str]:
    """Numbers of a row and what is added to them; angles stay within half a turn."""
    cells = {}
    for column, added in more.items():
        total = _number(row.get(column) or "0") + added
        if column == "rotation_deg" and not -180 <= total <= 180:
            total -= math.copysign(360, total)
        if added:
            cells[column] = _cell(total)
    return cells


def _cell(number: float) -> str:
    return f"{round(number, 4):g}"


def _number(cell: str) -> float:
    return float(cell.replace(",", "."))


def _of_face(study: Study) -> Iterator[Cure]:
    """Of a face that is larger than the stone is thick, if the square is not."""
    config, side = study.config, largest_face(study.face.height.attrs["thickness_mm"])
    if config["square"]["size_mm"] <= side < config["macroscale"]["face_mm"]:
        why = f"the stone is {side:g} mm thick under the square, less than its face"
        yield Cure(why, {"macroscale.face_mm": side}, button=f"Use {side:g} mm")


def offer(config: Path, cures: Sequence[Cure], *, is_confirmed: bool = False) -> bool:
    """Show the changes of cures to config and patch table, ask, and return if they were made."""
    table = read_config_file(config).get("patches")
    before = {config: text_of(config)}
    if table and any(cure.cells for cure in cures):
        before[Path(table)] = text_of(Path(table))
    after = dict(before)
    for cure in cures:
        after[config] = with_values(after[config], cure.values)
        if cure.cells is not None and table:
            after[Path(table)] = with_cells(after[Path(table)], cure.cells)
    changed = [path for path in before if after[path] != before[path]]
    if not changed:
        print("The fix cannot be written into these files.")
        return False
    reasons = (f"{cure.why[0].upper()}{cure.why[1:]}." for cure in cures)
    print("", *reasons, "", sep="\n")
    for path in changed:
        old, new = before[path].splitlines(), after[path].splitlines()
        names = str(path), f"{path}, mended"
        print(*difflib.unified_diff(old, new, *names, lineterm="", n=1), sep="\n")
    if not (is_confirmed or _confirmed()):
        return False
    for path in changed:
        if text_of(path) != before[path]:
            problem = "has changed since it was read"
            raise ConfigError(path, problem, "Run the command again.")
    for path in changed:
        copy = keep_copy(path)
        save_text(path, after[path])
        print(f"{path}: written (backup: {copy})")
    return True


def _confirmed() -> bool:
    if sys.stdin.isatty():
        question = "\nWrite this, and keep the files as they are beside it? [y/N] "
        print(question, end="", flush=True)
    return sys.stdin.readline().strip() == "y"  # empty where nobody is there to answer


def keep_copy(path: Path) -> Path:
    """Copy a file and its mode to the first free name beside it, such as ``patches.csv.bak``.

    An existing copy with the same content is kept instead.
    """
    for number in itertools.count(1):
        copy = path.with_name(f"{path.name}.bak{number if number > 1 else ''}")
        if not os.path.lexists(copy):
            shutil.copy(path, copy)
            break
        if not copy.is_symlink() and filecmp.cmp(path, copy, shallow=False):
            break
    return copy
