"""Files that contain others, zip and HDF5: their headers are not trusted before they are read.

A header can state any size, and an array can be in another file. Zip files are copied into memory,
up to the size in their headers, so that other libraries read an honest copy. HDF5 files are refused
if they link to other files, or declare arrays larger than the file.
"""

import io
import math
import zipfile
from pathlib import Path

import h5py

from gstlib.errors import InputError
from gstlib.io.files import UnreadableError, check_regular, megabytes, naming

__all__ = ["check_hdf5", "check_unpacked_size", "plain_zip"]

# Bytes that are unpacked of one file: a map of 8000² points.
_LARGEST = 1 << 29
# Measured heights shrink by less than 4 when packed, meshes in XML by less than 10. A member that
# shrank by more than this is empty, unless it is small anyway.
_PACKED_AT_MOST, _SMALL = 20, 1 << 24
# Zeros in results shrink by 229, which is the most that the first level of deflate can do.
_ZEROS_AT_MOST = 300
# A workbook has some ten members, a result some ten arrays, and an instrument's file some hundred.
_MOST_MEMBERS = 1000
# Others unpack without a bound of the output. No format that is read here uses them.
_METHODS = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
_BLOCK = 1 << 20
# Bytes of XML, and elements and attributes in it: a stone of a million triangles.
_LONGEST_XML, _MOST_IN_XML = 1 << 26, 8_000_000
_LAYOUTS = h5py.h5d.COMPACT, h5py.h5d.CONTIGUOUS, h5py.h5d.CHUNKED
_COMPRESSIONS = h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_LZF
_FILTERS = {*_COMPRESSIONS, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
_COPY_AGAIN = "Copy the file, or export it, again."


def check_unpacked_size(packed: int, size: int) -> None:
    """Refuse a file of `packed` bytes that unpacks to too many bytes, or to many more than it has.

    Raises
    ------
    UnreadableError
    """
    largest = max(_SMALL, _PACKED_AT_MOST * packed)
    _refuse_above(packed, size, min(_LARGEST, largest))


def _refuse_above(packed: int, size: int, largest: int) -> None:
    if size > largest:
        raise UnreadableError(
            f"unpacks from {megabytes(packed)} to {megabytes(size)} MB",
            f"At most {megabytes(largest)} MB are read. Export it in another way.",
        )


def plain_zip(path: str | Path) -> io.BytesIO:
    """A copy of a zip file without compression, with the sizes of its members in its headers.

    Raises
    ------
    InputError
        It is damaged, or its members are too many, too large or otherwise packed.
    """
    plain = io.BytesIO()
    try:
        with naming(path), zipfile.ZipFile(path) as archive, open(path, "rb") as file:
            members = archive.infolist()
            if len(members) > _MOST_MEMBERS:
                raise ValueError(f"it has {len(members)} members")
            files = {one.filename: one for one in members if not one.is_dir()}
            unpacked = sum(one.file_size for one in files.values())
            check_unpacked_size(check_regular(path), unpacked)
            # some formats begin with a header of their own
            starts = [one.header_offset for one in members]
            plain.write(file.read(max(0, min(starts, default=0))))
            with zipfile.ZipFile(plain, "a") as copy:
                for name, member in files.items():
                    copy.writestr(name, _content(archive, member))
    except (InputError, MemoryError):
        raise
    except Exception as error:  # damaged archives fail in many ways
        reason = " ".join(str(error).split())
        raise InputError(
            path, f"is damaged: it is not a whole zip file ({reason:.200})", _COPY_AGAIN
        ) from error
    plain.seek(0)
    return plain


def _content(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """The content of a member of a zip file, unpacked no further than its header states."""
    if member.compress_type not in _METHODS:
        raise UnreadableError(
            f"{member.filename!r:.60} in it is packed by method {member.compress_type}, not by "
            "deflate",
            "Export it, or zip it, again.",
        )
    with archive.open(member) as packed:
        content = packed.read(member.file_size)
    start = content[:_BLOCK].replace(b"\0", b"")
    if start.lstrip(b"\xef\xbb\xbf\xfe\xff \r\n\t").startswith(b"<"):
        _check_xml(member.filename, content)
    return content


def _check_xml(name: str, content: bytes) -> None:
    """Refuse XML if a byte of it may take a hundred bytes of memory or more."""
    text = content.replace(b"\0", b"")  # of UTF-16
    count = text.count(b"<") + text.count(b"=")
    problem = None
    if len(content) > _LONGEST_XML:
        problem = (
            f"has {megabytes(len(content))} MB, and {megabytes(_LONGEST_XML)} are read"
        )
    elif count > _MOST_IN_XML:
        problem = f"has {count} elements and attributes, and {_MOST_IN_XML} are read"
    elif b"<!ENTITY" in text:
        problem = "defines entities, which may stand for any amount of text"
    if problem:
        raise UnreadableError(
            f"{name!r:.60} in it is XML that {problem}", "Export it otherwise."
        )


def check_hdf5(path: str | Path, file: h5py.File) -> None:
    """Refuse an HDF5 file that links to other files, or declares more than it can contain.

    Raises
    ------
    InputError
        It has links that are not hard, arrays that are stored elsewhere or by other filters, or
        more bytes or text than its contents could unpack to.
    """
    size = check_regular(path)
    arrays, texts, stored = 0, 0, 0
    with naming(path):
        for node in _nodes(file):
            texts += _texts_of(node)
            if isinstance(node, h5py.Dataset):
                _check_storage(node)
                values = max(node.size or 0, math.prod(node.chunks or ()))
                arrays += values * node.id.get_type().get_size()
                stored += node.id.get_storage_size()
        largest = max(min(_ZEROS_AT_MOST * size, _LARGEST), _PACKED_AT_MOST * size)
        _refuse_above(size, arrays, max(_SMALL, largest))
        # several of them may refer to the same text, which is in the rest of the file
        _refuse_above(size, texts * max(0, size - stored), _LARGEST)


def _nodes(file: h5py.File) -> list[h5py.Group | h5py.Dataset]:
    """A file and everything in it, each once."""
    names: list[str] = []

    def problem(name: str, link: object) -> str | None:
        names.append(name)
        if len(names) > _MOST_MEMBERS:
            return f"more than {_MOST_MEMBERS} groups and arrays"
        if not isinstance(link, h5py.HardLink):
            return f"a link ({name!r:.60}) that may lead to another file"
        return None

    # a result ends the visit, and an exception would be lost in HDF5
    if (content := file.visititems_links(problem)) is not None:
        raise _refused(content)
    nodes = [file]
    file.visititems(lambda name, node: nodes.append(node))
    return nodes


def _texts_of(node: h5py.Group | h5py.Dataset) -> int:
    """Number of texts and lists of any length in attributes, or in the cells of a table."""
    fields = [node.attrs.get_id(name) for name in node.attrs]
    if isinstance(node, h5py.Dataset) and not h5py.check_string_dtype(node.dtype):
        fields.append(node.id)  # texts are counted where they are read
    return sum(math.prod(each.shape or ()) for each in fields if each.dtype.hasobject)


def _check_storage(field: h5py.Dataset) -> None:
    """Refuse an array that is not stored in the file itself, or by other filters."""
    stored = field.id.get_create_plist()
    filters = [stored.get_filter(n)[0] for n in range(stored.get_nfilters())]
    problem = None
    if stored.get_layout() not in _LAYOUTS or stored.get_external_count():
        problem = "stored in other files"
    elif not _FILTERS.issuperset(filters) or sum(map(filters.count, _COMPRESSIONS)) > 1:
        problem = f"packed by the filters {filters}"
    if problem:
        raise _refused(f"an array ({field.name!r:.60}) that is {problem}")


def _refused(content: str) -> UnreadableError:
    return UnreadableError(
        f"holds {content}", "Save its arrays in one file, uncompressed or by gzip."
    )
