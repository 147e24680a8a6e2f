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
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from gst.check.checking import Walk
from gst.check.fixing import Cure
from gst.config.edited import text_of, with_cells
from gst.setup.place_state import digest_of
from gstlib.errors import NOTE, FaultError, GstError, InputError, InputsError

_LEVELS = {logging.ERROR: "accepted", logging.WARNING: "warning", NOTE: "note"}


class _Causes(logging.Handler):
    """Faults and oddities, in the order of the check."""

    def __init__(self) -> None:
        super().__init__(NOTE)
        self.causes: dict[object, dict[str, Any]] = {}

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        key = record.msg if record.msg != "%s" else text
        self.add(key, _LEVELS.get(record.levelno, "warning"), text)

    def add(self, key: object, level: str, text: str) -> dict[str, Any]:
        """A new cause, or more of one that is there."""
        if (cause := self.causes.get((level, key))) is not None:
            cause["more"].append(text)
            return cause
        new: dict[str, Any] = {"level": level, "text": text, "more": [], "accept": []}
        return self.causes.setdefault((level, key), new)

    def add_fault(self, error: GstError) -> None:
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
    if cure.cells is None or table is None:
        return changed
    cells = cure.cells

    def noted(row: Any) -> dict[str, object]:
        if new := cells(row):
            changed[row["patch"]] = {**new}
        return {}

    with_cells(text_of(Path(table)), noted)
    return changed


def _each(errors: Iterable[GstError]) -> Iterator[GstError]:
    for error in errors:
        if isinstance(error, InputsError):
            yield from _each(error.args[0])
        else:
            yield error


def causes_of(path: Path) -> dict[str, Any]:
    """The causes of a study, the digest of the checked files, and a summary of the run."""
    handler, digest = _Causes(), digest_of(path)
    cures: list[Cure] = []
    root = logging.getLogger()
    former = root.level
    root.addHandler(handler)
    root.setLevel(NOTE)
    walk = Walk(path, cures)
    summary = io.StringIO()
    try:
        with contextlib.redirect_stdout(summary):
            walk.run()
    except GstError as error:
        for each in _each([error]):
            handler.add_fault(each)
    finally:
        root.removeHandler(handler)
        root.setLevel(former)
    for cure in cures:
        handler.add_cure(cure, walk.config.get("patches"))
    order = ["error", "accepted", "warning", "note"]
    causes = sorted(
        handler.causes.values(), key=lambda each: order.index(each["level"])
    )
    return {"causes": causes, "digest": digest, "summary": summary.getvalue()}


if __name__ == "__main__":
    print(json.dumps(causes_of(Path(sys.argv[1]))))
