"""Writes result files that are whole or absent, even if the program is killed while writing.

A file is written next to its final place under a hidden name (``.NAME.PID.part``), which nothing
reads, and renamed once all of it is on the disk.
"""

import errno
import glob
import os
import tempfile
from pathlib import Path

from gstlib.errors import OutputError

__all__ = ["cannot_write", "check_writable", "write_whole"]

_IN_WORDS = {
    errno.ENOSPC: ("the disk is full", "Make room on it"),
    errno.EDQUOT: ("your disk quota is used up", "Make room"),
    errno.EROFS: (
        "the disk is read-only",
        "Mount it for writing, or set `results` in the config",
    ),
    errno.EACCES: ("permission denied", "Ask for it, or set `results` in the config"),
}


def cannot_write(path: str | Path, error: OSError) -> OutputError:
    """The `OutputError` for an `error` in writing `path`."""
    unknown = error.strerror or str(error), "Mend that"
    reason, remedy = _IN_WORDS.get(error.errno or 0, unknown)
    return OutputError(
        path, f"cannot be written: {reason}", f"{remedy}, then run the study again."
    )


def check_writable(folder: str | Path) -> None:
    """Make `folder` if it does not exist, and try to make a file in it.

    Raises
    ------
    OutputError
        No file can be made there.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise cannot_write(folder, error) from error


def write_whole(path: str | Path, content: bytes | memoryview) -> None:
    """Write `content` to `path`; an old file is replaced once the new one is whole.

    The file's folder is made if it does not exist, and remains of a killed attempt are removed.

    Raises
    ------
    OutputError
        The disk is full or read-only, or the file cannot be written for another reason.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for left in path.parent.glob(f".{glob.escape(path.name)}.*.part"):
            left.unlink(missing_ok=True)
        try:
            with temporary.open("wb") as file:
                file.write(content)
                file.flush()
                # otherwise a power cut could leave the name with no content
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise cannot_write(path, error) from error
