"""One log for a job of the workflow: its file and the screen, uncaught errors included."""

import logging
import os
import sys
import traceback
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from gstlib.errors import GstError
from gstlib.io.files import cannot_write

__all__ = ["FILE_ONLY", "job_log", "patch_by_patch"]

# Environment variable, set by who shows what is in the log (the workflow's display of progress): a
# job then says nothing twice. If its log cannot be written, it speaks all the same.
FILE_ONLY = "GSTLIB_LOG_FILE_ONLY"

Value = TypeVar("Value")


class _LogFile(logging.FileHandler):
    """A log that may become impossible to write, as on a full disk.

    That is told by the error that ends the job, not by each line that finds no room.
    """

    written = True

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        self.written = False

    def close(self) -> None:
        with suppress(OSError):  # what could not be written before cannot be now
            super().close()


@contextmanager
def job_log(path: str | Path) -> Iterator[logging.Logger]:
    """Log to `path` and to stderr (see `FILE_ONLY`) while the block runs.

    An error that is meant for the user (`GstError`) ends the process with exit code 1 and its
    message; anything else is a fault of the program and keeps its traceback.
    """
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        to_file = _LogFile(path, mode="w", encoding="utf-8")
    except OSError as error:
        raise SystemExit(f"\nERROR: {cannot_write(path, error)}\n") from None
    log = logging.getLogger("gstlib")
    log.setLevel(logging.INFO)
    file_only = FILE_ONLY in os.environ
    to_file.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
    to_screen = logging.StreamHandler(sys.stderr)
    to_screen.setLevel(logging.CRITICAL if file_only else logging.WARNING)
    to_screen.setFormatter(logging.Formatter("%(levelname)s: %(message)s"))
    handlers = [to_file, to_screen]
    for handler in handlers:
        log.addHandler(handler)
    show_warning = warnings.showwarning
    warnings.showwarning = lambda message, category, *_: log.warning(
        "%s: %s", category.__name__, message
    )
    try:
        yield log
    except GstError as error:
        to_screen.setLevel(logging.CRITICAL)
        log.error("%s", error)
        if not file_only or not to_file.written:
            print(f"\nERROR: {error}\n", file=sys.stderr)
        raise SystemExit(1) from None
    except Exception:
        log.exception("unexpected error: this is a fault of the program, please report it")
        if file_only and not to_file.written:
            traceback.print_exc()
        raise SystemExit(1) from None
    finally:
        warnings.showwarning = show_warning
        for handler in handlers:
            log.removeHandler(handler)
            handler.close()


def patch_by_patch(patches: Mapping[str, Value]) -> Iterator[tuple[str, Value]]:
    """The items of a mapping, each named in the log at its turn: how far a job of many patches is.

    Parameters
    ----------
    patches : mapping
        What there is of each patch.
    """
    for number, (patch, value) in enumerate(patches.items(), start=1):
        logging.getLogger("gstlib").info("patch %s, %d of %d", patch, number, len(patches))
        yield patch, value
