"""A check of a study for the page of `gst place`: every cause once, with its remedies.

`python -m gst.setup.place_check CONFIG` prints it as one line of JSON, and ends with 0 also if
there are faults. A cause is a fault, a warning or a note. It has in ``more`` the same message about
other patches or files, in ``accept`` under which names the config accepts it, and in
``cure`` the changes that remove it: ``values`` of the config and ``cells`` of each patch.
"""

import contextlib
import io
import json
import logging
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gst.check.checking import Walk
from gst.check.fixing import Cure
from gst.config.edited import text_of, with_cells
from gst.setup.place_state import digest_of
from gstlib.errors import NOTE, FaultError, GstError, InputError, InputsError

# Levels of causes, the gravest first, and of the log's messages.
_ORDER = ["error", "accepted", "warning", "note"]
_LEVELS = {logging.ERROR: "accepted", logging.WARNING: "warning", NOTE: "note"}


class _Causes(logging.Handler):
    """Faults and oddities, in the order of the check."""

    def __init__(self) -> None:
        super().__init__(NOTE)
        self.causes: dict[object, dict[str, Any]] = {}

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        key = text if record.msg == "%s" else record.msg
        self.add(key, _LEVELS.get(record.levelno, "warning"), text)

    def add(self, key: object, level: str, text: str) -> dict[str, Any]:
        """A new cause, or more of one that is there."""
        new: dict[str, Any] = {"level": level, "text": text, "more": [], "accept": []}
        cause = self.causes.setdefault((level, key), new)
        if cause is not new:
            cause["more"].append(text)
        return cause

    def add_fault(self, error: GstError) -> None:
        """An error, or each of several."""
        if isinstance(error, InputsError):
            for each in error.args[0]:
                self.add_fault(each)
            return
        text, key = str(error), object()
        head, *items = text.split("\n  - ")
        if head.endswith("the configuration cannot be used"):
            for item in items:
                self.add(object(), "error", item.partition("\n  See ")[0])
            return
        if isinstance(error, InputError):
            text, key = InputError.__str__(error), (error.problem, error.remedy)
        cause = self.add(key, "error", text)
        if isinstance(error, FaultError):
            names = [f"{error.name}:{patch}" for patch in error.patches]
            cause["accept"] += names or [error.name]

    def add_cure(self, cure: Cure, table: str | None) -> None:
        """To the cause that names its fault, or a key that it changes; or as one of its own."""
        cells = _cells_of(cure, table)
        fault = [cure.fault, *(f"{cure.fault}:{patch}" for patch in cells)]
        for cause in self.causes.values():
            names = any(f"{key} " in f"{cause['text']} " for key in cure.values)
            if names or not {*fault}.isdisjoint(cause["accept"]):
                break
        else:
            text = f"{cure.why[0].upper()}{cure.why[1:]}."
            cause = self.add(cure.why, "warning", text)
        former = cause.setdefault("cure", {"values": {}, "cells": {}})
        former["values"] |= cure.values
        former["cells"] |= cells
        former["button"] = cure.button


def _cells_of(cure: Cure, table: str | None) -> dict[str, dict[str, object]]:
    """The changes of a cure in each row of the patch table, by patch."""
    changed: dict[str, dict[str, object]] = {}
    cells = cure.cells
    if cells is not None and table is not None:

        def noted(row: Mapping[str, str]) -> dict[str, object]:
            if new := cells(row):
                changed[row["patch"]] = {**new}
            return {}

        with_cells(text_of(Path(table)), noted)
    return changed


def main(path: Path) -> None:
    """Print the causes of a study, the digest of the checked files, and a summary of the run."""
    causes, digest = _Causes(), digest_of(path)
    logging.basicConfig(handlers=[causes], level=NOTE)
    cures: list[Cure] = []
    walk, summary = Walk(path, cures), io.StringIO()
    try:
        with contextlib.redirect_stdout(summary):
            walk.run()
    except GstError as error:
        causes.add_fault(error)
    for cure in cures:
        causes.add_cure(cure, walk.config.get("patches"))
    listed = sorted(
        causes.causes.values(), key=lambda cause: _ORDER.index(cause["level"])
    )
    check = {"causes": listed, "digest": digest, "summary": summary.getvalue()}
    print(json.dumps(check))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
