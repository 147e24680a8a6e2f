"""One log for a job of the workflow: its file and the screen, uncaught errors included."""

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gstlib.errors import GstError
from gstlib.io.files import cannot_write

__all__ = ["job_log"]


@contextmanager
def job_log(path: str | Path) -> Iterator[logging.Logger]:
    """Log to `path` and to stderr while the block runs.

    An error that is meant for the user (`GstError`) ends the
    process with exit code 1 and its one-line message; anything else is a fault of the program
    and keeps its traceback.
    """
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        to_file = logging.FileHandler(path, mode="w", encoding="utf-8")
    except OSError as error:
        raise SystemExit(f"\nERROR: {cannot_write(path, error)}\n") from None
    # a full disk is told by the error that ends the job, not by each line that finds no room
    to_file.handleError = lambda record: None
    log = logging.getLogger("gstlib")
    log.setLevel(logging.INFO)
    to_file.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
    to_screen = logging.StreamHandler(sys.stderr)
    to_screen.setLevel(logging.WARNING)
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
        print(f"\nERROR: {error}\n", file=sys.stderr)
        raise SystemExit(1) from None
    except Exception:
        log.exception("unexpected error: this is a fault of the program, please report it")
        raise SystemExit(1) from None
    finally:
        warnings.showwarning = show_warning
        for handler in handlers:
            log.removeHandler(handler)
            with suppress(OSError):
                handler.close()
