"""An `.x3p` in the form in which SurfaceTopography reads it, whatever program wrote it.

ISO 25178-72 (once ISO 5436-2) asks for a zip file with ``main.xml`` and the binary heights that it
names. Programs zip the folder around them, list the heights in ``main.xml``, or store steps.
"""

import datetime
import hashlib
import io
import logging
import math
import re
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gstlib.errors import InputError
from gstlib.io.containers import read_member

__all__ = ["plain_x3p"]

_log = logging.getLogger(__name__)

# Bytes of a height of each data type: whole steps, and floating-point numbers.
_STEPS = {"I": 2, "L": 4}
_NUMBERS = {"F": 4, "D": 8}
_REVISION = "ISO5436 - 2000"
_POINTS, _VALID = "bindata/data.bin", "bindata/valid.bin"
_EXPORT_AGAIN = (
    "Export the scan again, as a surface with its increments, or as .sur or .plux."
)


def plain_x3p(path: Path) -> io.BytesIO:
    """The zip file with an index and heights as the first revision of the standard has them.

    Raises
    ------
    InputError
        It has no index or two, or it does not contain a surface. Its heights or the mask of
        measured points are missing, or their size differs from the header.
    """
    plain = io.BytesIO()
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(plain, "w") as copy:
        members = _members(path, archive)
        root = ElementTree.fromstring(read_member(path, archive, members["main.xml"]))
        for element in root.iter():
            element.tag = element.tag.rpartition("}")[
                2
            ]  # some put all names into a namespace
            element.text = (element.text or "").strip()
        _make_plain(path, root)
        for name, content in _contents(path, root, archive, members).items():
            copy.writestr(name, content)
        copy.writestr("main.xml", ElementTree.tostring(root, "utf-8"))
    plain.seek(0)
    return plain


def _members(path: Path, archive: zipfile.ZipFile) -> dict[str, str]:
    """Names of the files beside the index, whatever their case, slashes and the folder around."""
    files = [one.filename for one in archive.infolist() if not one.is_dir()]
    names = {_plain_name(name): name for name in files}
    indices = [name for name in names if name.rpartition("/")[2] == "main.xml"]
    outermost = min((name.count("/") for name in indices), default=0)
    indices = [name for name in indices if name.count("/") == outermost]
    if len(indices) != 1:
        problem = f"holds {len(indices)} files main.xml, but an .x3p has one"
        raise InputError(path, problem, _EXPORT_AGAIN)
    folder = indices[0].removesuffix("main.xml")
    inside = [name for name in names if name.startswith(folder)]
    return {name.removeprefix(folder): names[name] for name in inside}


def _plain_name(name: str) -> str:
    with_slashes = name.replace("\\", "/")
    return re.sub(r"^(\./|/)+", "", with_slashes).lower()


def _make_plain(path: Path, root: ElementTree.Element) -> None:
    """Write the index as SurfaceTopography expects it, if it describes a surface."""
    kind = root.findtext("Record1/FeatureType", "").upper()
    if kind != "SUR":
        raise InputError(
            path, f"contains a feature {kind!r}, not a surface", _EXPORT_AGAIN
        )
    for where in ("Record1/FeatureType", ".//AxisType", ".//DataType"):
        for element in root.findall(where):
            element.text = str(element.text).upper()
    for axis in "XYZ":
        _check_axis(path, root, axis)
    # whether heights are steps or numbers, they are offset + increment × the stored value
    height_type = _element(root, "Record1/Axes/CZ/AxisType")
    if height_type.text == "I":
        height_type.text = "A"
    _element(root, "Record1/Revision").text = _REVISION
    for record in root.findall("Record2"):
        for date in record.findall("Date"):
            if not _is_date(str(date.text)):
                record.remove(date)


def _check_axis(path: Path, root: ElementTree.Element, name: str) -> None:
    """Refuse an axis without a scale, and leave out empty entries."""
    axis = _element(root, f"Record1/Axes/C{name}")
    for part in ("Increment", "Offset"):
        for element in axis.findall(part):
            if not element.text:
                axis.remove(element)
            elif not _is_number(element.text, positive=part == "Increment"):
                problem = f"the {part} of its {name.lower()} axis is {element.text!r}"
                raise InputError(path, problem, _EXPORT_AGAIN)
    needs_scale = name != "Z" or axis.findtext("DataType") in _STEPS
    if needs_scale and axis.find("Increment") is None:
        problem = f"its {name.lower()} axis has no Increment"
        raise InputError(path, problem, _EXPORT_AGAIN)


def _contents(
    path: Path,
    root: ElementTree.Element,
    archive: zipfile.ZipFile,
    members: dict[str, str],
) -> dict[str, bytes | memoryview]:
    """Heights, and the mask of measured points, if any, by their plain names."""
    record = _element(root, "Record3")
    nx, ny = (record.findtext(f"MatrixDimension/Size{axis}", "") for axis in "XY")
    count = int(nx) * int(ny)
    height_type = _element(root, "Record1/Axes/CZ/DataType")
    listed = record.find("DataList")
    if listed is not None and not record.findtext("DataLink/PointDataLink"):
        heights = _listed(path, listed)
        height_type.text = "D"
        for former in (*record.findall("DataLink"), listed):
            record.remove(former)
        link = ElementTree.SubElement(record, "DataLink")
        ElementTree.SubElement(link, "PointDataLink").text = _POINTS
        _check_bytes(path, heights.nbytes, count * heights.itemsize, "heights")
        return {_POINTS: heights.data}
    link = _element(record, "DataLink")
    sizes = {
        _POINTS: count * (_STEPS | _NUMBERS)[str(height_type.text)],
        _VALID: (count + 7) // 8,
    }
    contents: dict[str, bytes | memoryview] = {}
    for name, tag, what in (
        (_POINTS, "PointData", "heights"),
        (_VALID, "ValidPoints", "mask of measured points"),
    ):
        target = link.find(f"{tag}Link")
        if target is not None and target.text:
            if (own := members.get(_plain_name(target.text))) is None:
                problem = f"its main.xml names {target.text}, which is not in it"
                raise InputError(path, problem, _EXPORT_AGAIN)
            contents[name] = read_member(path, archive, own)
            _check_bytes(path, len(contents[name]), sizes[name], what)
            stated = link.findtext(f"MD5Checksum{tag}", "")
            _mind_sum(path, contents[name], stated, what)
            target.text = name
        elif target is not None:
            link.remove(target)
    return contents


def _listed(path: Path, listed: ElementTree.Element) -> np.ndarray:
    """Heights in the index itself, NaN if empty."""
    texts = [datum.text or "nan" for datum in listed.findall("Datum")]
    try:
        return np.array(texts, dtype="<f8")
    except ValueError as error:
        problem = f"a height that its main.xml lists is not a number ({error})"
        raise InputError(path, problem, _EXPORT_AGAIN) from error


def _check_bytes(path: Path, size: int, announced: int, what: str) -> None:
    if size != announced:
        problem = f"its {what} take {size} bytes, but {announced} are announced: it is damaged"
        raise InputError(path, problem, "Copy the file, or export the scan, again.")


def _mind_sum(path: Path, content: bytes | memoryview, stated: str, what: str) -> None:
    """Warn if the MD5 sum of a member differs from the index. Zeros mean a missing sum."""
    own = hashlib.md5(content, usedforsecurity=False).hexdigest()
    stated = stated.lower()
    is_sum = re.fullmatch("[0-9a-f]{32}", stated) and stated.strip("0")
    if is_sum and stated != own:
        _log.warning(
            "%s: its %s do not have the MD5 sum in its main.xml, so they may be damaged. "
            "Compare the file with the original one",
            path,
            what,
        )


def _element(parent: ElementTree.Element, where: str) -> ElementTree.Element:
    if (element := parent.find(where)) is None:
        raise ValueError(f"its main.xml has no {where}")
    return element


def _is_number(text: str, *, positive: bool) -> bool:
    try:
        number = float(text)
    except ValueError:
        return False
    return math.isfinite(number) and (number > 0 or not positive)


def _is_date(text: str) -> bool:
    """Whether a date follows the standard. The month of other dates would be a guess."""
    try:
        return bool(datetime.datetime.fromisoformat(text))
    except ValueError:
        return False
