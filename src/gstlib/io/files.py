"""Result files are whole or absent, whatever ends the program while one is written.

A file is written beside its place, under a hidden name that nothing reads (``.NAME.PID.part``), and
takes its name once all of it is on the disk.
"""

import errno
import glob
import os
import tempfile
from pathlib import Path

from gstlib.errors import OutputError

__all__ = ["cannot_write", "check_writable", "write_whole"]

_REMEDIES = {
    errno.ENOSPC: ("the disk is full", "Make room on it, then run the study again."),
    errno.EDQUOT: ("your disk quota is used up", "Make room, then run the study again."),
    errno.EROFS: (
        "the disk is read-only",
        "Mount it for writing, or have the project, or its `results`, on another.",
    ),
    errno.EACCES: (
        "permission denied",
        "Ask for the right to write there, or set `results` in the config to another folder.",
    ),
}


def cannot_write(path: str | Path, error: OSError) -> OutputError:
    """The `OutputError` that tells the user of `error` at writing `path`."""
    reason, remedy = _REMEDIES.get(
        error.errno, (error.strerror or str(error), "Mend that, then run the study again.")
    )
    return OutputError(path, f"cannot be written: {reason}", remedy)


def check_writable(folder: str | Path) -> None:
    """Make `folder` if need be, and see that files can be made in it.

    Raises
    ------
    OutputError
        They cannot.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise cannot_write(folder, error) from error


def write_whole(path: str | Path, content: bytes) -> None:
    """Write `content` to `path`, replacing what is there only once the new file is whole.

    What a killed process left of an earlier attempt is removed.

    Parameters
    ----------
    path : str or Path
        Target file; its folder is made if need be.
    content : bytes-like
        All of the file.

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
                # else a power cut could leave the name with nothing behind it
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise cannot_write(path, error) from error
