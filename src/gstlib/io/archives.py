"""Checks of the ZIP archives that some formats of height maps are (.plux, .x3p, .vk6, .vk7).

Only the archive's own directory is read, and nothing is ever unpacked to disk. Python's zipfile
gives no more bytes of a member than the directory announces, so bounds on these bound the memory.
XML in the archives is read by SurfaceTopography through defusedxml, which refuses entities.
"""

import re
import zipfile
from pathlib import Path

from gstlib.errors import InputError
from gstlib.io.bounds import LARGEST_FILE, bounded

__all__ = ["is_archive", "size_unpacked"]

# A .plux has a dozen members, and a handful for each further layer.
_MOST_MEMBERS = 1000
# Measured files have XML of some kilobytes; as Python objects it grows about fiftyfold.
_LARGEST_XML = 8 << 20
_METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}

_ARCHIVES = {".plux", ".x3p", ".vk6", ".vk7"}
_AGAIN = "Export or copy the scan again."


def is_archive(path: Path) -> bool:
    """Whether the file is an archive, by its name or by its first bytes."""
    if path.suffix.lower() in _ARCHIVES:
        return True
    with path.open("rb") as file:
        return file.read(4) == b"PK\x03\x04"


def size_unpacked(path: Path) -> int:
    """Bytes of all members of an archive that may be read.

    Raises
    ------
    InputError
        The file is no archive, or damaged; or it has more than 1000 members, members of more than
        1 GiB in all, XML of more than 8 MiB, two members of one name, names that lead out of it,
        encrypted members or a compression other than deflate.
    """
    try:
        with bounded(path, path.stat().st_size), zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except InputError:
        raise
    except Exception as error:  # zipfile raises whatever its parsing raises
        raise InputError(
            path,
            f"is not a whole ZIP archive, as such scans are ({type(error).__name__}: {error})",
            _AGAIN,
        ) from error
    if len(members) > _MOST_MEMBERS:
        _refuse(path, f"its archive has {len(members)} members, {_MOST_MEMBERS} at most are read")
    names = [member.filename for member in members]
    if len(set(names)) < len(names):
        _refuse(path, "its archive has two members of one name")
    for member in members:
        _check_member(path, member)
    total = sum(member.file_size for member in members)
    if total > LARGEST_FILE:
        _refuse(path, f"unpacks to {total} bytes, {LARGEST_FILE} at most are read")
    return total


def _check_member(path: Path, member: zipfile.ZipInfo) -> None:
    name = member.filename.replace("\\", "/")
    if name.startswith("/") or re.match("[A-Za-z]:", name) or ".." in name.split("/"):
        _refuse(path, f"a member of its archive, {name!r}, leads out of it")
    if member.flag_bits & 1:
        _refuse(path, f"{name!r} in its archive is encrypted")
    if member.compress_type not in _METHODS:
        _refuse(path, f"{name!r} in its archive is packed in an unknown way")
    if name.lower().endswith((".xml", ".txt")) and member.file_size > _LARGEST_XML:
        _refuse(path, f"{name!r} in its archive has {member.file_size} bytes of text")


def _refuse(path: Path, problem: str) -> None:
    raise InputError(path, problem, f"No instrument writes such files. {_AGAIN}")
