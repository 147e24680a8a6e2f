"""Files that are not too large to read, and result files that are whole or absent.

A file is written next to its final path under a hidden name (``.NAME.PID.part``). It is renamed
once it is completely on the disk. Links to files and modes are kept.
"""

import contextlib
import errno
import glob
import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from gstlib.errors import InputError, OutputError

__all__ = [
    "LARGEST_TABLE",
    "UnreadableError",
    "cannot_read",
    "cannot_write",
    "check_input",
    "check_regular",
    "check_size",
    "check_writable",
    "megabytes",
    "naming",
    "sha256",
    "write_whole",
]

# Bytes that are read of one file: a stone of twenty million triangles. Tables and configs are far
# smaller. A larger file is damaged, or made to fill the memory.
_LARGEST = 1 << 30
LARGEST_TABLE = 1_000_000

_IN_WORDS = {
    errno.ENOSPC: ("the disk is full", "Make room on it"),
    errno.EDQUOT: ("your disk quota is used up", "Make room"),
    errno.EROFS: (
        "the disk is read-only",
        "Mount it for writing, or set `results` in the config",
    ),
    errno.EACCES: ("permission denied", "Ask for it, or set `results` in the config"),
}


class UnreadableError(InputError):
    """A problem of a file, from a function that is not told its name (see `naming`)."""

    def __init__(self, problem: str, remedy: str):
        super().__init__("the file", problem, remedy)


@contextlib.contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """Add the name of a file to what makes it unreadable.

    Raises
    ------
    InputError
    """
    try:
        yield
    except UnreadableError as error:
        raise InputError(path, error.problem, error.remedy) from error


def check_regular(path: str | Path) -> int:
    """The bytes of a file; refuse a folder, a device, or a pipe without a writer.

    Raises
    ------
    InputError
    """
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode):
        raise InputError(
            path,
            "is a folder, a pipe or a device, not a file",
            "Correct its path, or put the file there.",
        )
    return status.st_size


def check_size(path: str | Path, largest: int = _LARGEST) -> None:
    """Refuse a file of more than `largest` bytes, or a path that is not a file, before reading.

    Raises
    ------
    InputError
    """
    size = check_regular(path)
    if size > largest:
        raise InputError(
            path,
            f"has {megabytes(size)} MB, and at most {megabytes(largest)} MB are read",
            "Export it again, smaller: this is more than any stone, scan or table needs.",
        )


def check_input(path: Path, remedy: str) -> None:
    """Refuse a file of the user that does not exist, is empty, or is too large.

    Raises
    ------
    UnreadableError, InputError
    """
    if path.is_dir():
        raise UnreadableError("is a folder", "Give the path of one file in it.")
    if not path.is_file():
        raise UnreadableError("no such file", remedy)
    if path.stat().st_size == 0:
        raise UnreadableError("the file is empty", "Copy it, or export it, again.")
    check_size(path)


def megabytes(size: int) -> str:
    """A number of bytes in MB, in words."""
    return f"{round(size / 1e6, 2):g}"


def sha256(path: str | Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def cannot_write(path: str | Path, error: OSError) -> OutputError:
    """The `OutputError` for an `error` in writing `path`."""
    unknown = error.strerror or str(error), "Correct that"
    reason, remedy = _IN_WORDS.get(error.errno or 0, unknown)
    return OutputError(
        path, f"cannot be written: {reason}", f"{remedy}, then run the study again."
    )


def cannot_read(path: str | Path, kind: str, error: Exception) -> InputError:
    """The `InputError` for an `error` in reading a result that should be of a `kind`.

    Only a damaged file has to be deleted. Errors of the operating system have a number.
    """
    number = getattr(error, "errno", None)
    if "lock file" in str(error):
        problem = "cannot be locked: another program writes it, or its disk does not support locks"
        remedy = (
            "If no other program uses it, run `export HDF5_USE_FILE_LOCKING=FALSE` first "
            "(docs/how-to/cluster.md)."
        )
    elif number == errno.ENOENT:
        problem = "no such file"
        remedy = (
            "Run the study again. If another node of a cluster wrote the file, raise latency-wait "
            "in the profile (docs/how-to/cluster.md)."
        )
    elif number is not None:
        problem = f"cannot be opened: {os.strerror(number)}"
        remedy = "Make it readable, or check the disk, then run the study again."
    else:
        problem = f"cannot be read as {kind} ({' '.join(str(error).split())})"
        remedy = "Delete it and run the study again."
    return InputError(path, problem, remedy)


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
    """Write `content` to `path`, and replace an old file once the new file is complete.

    If `path` is a link, the file that it leads to is replaced. The new file has the mode of the old
    one. The file's folder is made if it does not exist, and remains of a killed attempt go.

    Raises
    ------
    OutputError
        The disk is full or read-only, or the file cannot be written for another reason.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        for left in target.parent.glob(f".{glob.escape(target.name)}.*.part"):
            left.unlink(missing_ok=True)
        try:
            with temporary.open("wb") as file:
                # there may be no old file, or a disk without modes
                with contextlib.suppress(OSError):
                    shutil.copymode(target, temporary)
                file.write(content)
                file.flush()
                # otherwise a power cut could leave the name with no content
                os.fsync(file.fileno())
            os.replace(temporary, target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise cannot_write(path, error) from error
