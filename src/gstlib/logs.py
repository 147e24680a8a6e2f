"""One log for a job of the workflow: its file and the screen, uncaught errors included."""

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gstlib.errors import GstError

__all__ = ["job_log"]


@contextmanager
def job_log(path: str | Path) -> Iterator[logging.Logger]:
    """Log to `path` and to stderr while the block runs.

    An error that is meant for the user (`GstError`) ends the
    process with exit code 1 and its one-line message; anything else is a fault of the program
    and keeps its traceback.
    """
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    log = logging.getLogger("gstlib")
    log.setLevel(logging.INFO)
    to_file = logging.FileHandler(path, mode="w", encoding="utf-8")
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
            handler.close()
