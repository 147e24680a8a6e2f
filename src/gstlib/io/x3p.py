"""Height maps in `.x3p` (ISO 25178-72, once ISO 5436-2), whatever program wrote them.

The standard asks for a zip file with ``main.xml`` and the binary heights that it names. Programs
zip the folder around them, list the heights in ``main.xml``, or store steps. SurfaceTopography
reads the first revision of the standard only, and takes seconds to import.
"""

import contextlib
import datetime
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gstlib.io.containers import plain_zip
from gstlib.io.files import UnreadableError
from gstlib.io.stage import RawMap, stage_attrs

__all__ = ["read_x3p"]

# Heights of each data type: whole steps, and floating-point numbers.
_STEPS = {"I": "<i2", "L": "<i4"}
_NUMBERS = {"F": "<f4", "D": "<f8"}
# A rotation matrix that differs less from the identity is rounded.
_UNTURNED = 1e-6
_EXPORT_AGAIN = (
    "Export the scan again, as a surface with its increments, or as .sur or .plux."
)


def read_x3p(path: Path) -> RawMap:
    """Read a height map, as a reader of `gstlib.io.scans`.

    Raises
    ------
    InputError
        It is no whole zip file, or has no index or two. It does not contain a surface, or an axis
        has no scale.
    ValueError, KeyError
        The index lacks an entry, or a member that it names is missing or of another size.
    """
    with zipfile.ZipFile(plain_zip(path)) as archive:
        names = {_plain_name(name): name for name in archive.namelist()}
        indices = [name for name in names if name.rpartition("/")[2] == "main.xml"]
        if len(indices) != 1:
            raise UnreadableError(
                f"holds {len(indices)} files main.xml, but an .x3p has one",
                _EXPORT_AGAIN,
            )
        folder = indices[0].removesuffix("main.xml")

        def read(name: str) -> bytes:
            return archive.read(names[folder + _plain_name(name)])

        root = _index(read("main.xml"))
        kind = _text(root, "Record1/FeatureType").upper()
        if kind != "SUR":
            raise UnreadableError(
                f"contains a feature {kind!r}, not a surface", _EXPORT_AGAIN
            )
        ny, nx = (int(_text(root, f"Record3/MatrixDimension/Size{a}")) for a in "YX")
        # for a stack of maps, this fails
        stored = _stored(root, read).reshape(ny, nx)
        is_measured = _mask(root, read, ny * nx).reshape(ny, nx)
        _refuse_rotation(root)
    dx, x = _scale(root, "X")
    dy, y = _scale(root, "Y")
    step, lowest = _scale(root, "Z")
    heights = np.where(is_measured, stored * step + lowest, np.nan)
    return heights, (dy, dx), 1e3, _instrument(root) | stage_attrs(x, y, 1e3)


def _plain_name(name: str) -> str:
    """The name of a file in a zip file, whatever its case and slashes."""
    with_slashes = name.replace("\\", "/")
    return re.sub(r"^(\./|/)+", "", with_slashes).lower()


def _index(content: bytes) -> ElementTree.Element:
    """The index, without the namespace into which some programs put all names."""
    root = ElementTree.fromstring(content)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        element.text = (element.text or "").strip()
    return root


def _text(root: ElementTree.Element, where: str) -> str:
    if (text := root.findtext(where)) is None:
        raise ValueError(f"its main.xml has no {where}")
    return text


def _scale(root: ElementTree.Element, axis: str) -> tuple[float, float]:
    """Increment and offset of an axis (m): a value is the offset plus the increment times it."""
    where = f"Record1/Axes/C{axis}"
    # only heights that are floating-point numbers need no increment
    is_number = axis == "Z" and _text(root, f"{where}/DataType").upper() in _NUMBERS
    increment = float(root.findtext(f"{where}/Increment") or is_number)
    if not increment > 0:
        raise UnreadableError(
            f"the increment of its {axis.lower()} axis is {increment}", _EXPORT_AGAIN
        )
    return increment, float(root.findtext(f"{where}/Offset") or 0)


def _refuse_rotation(root: ElementTree.Element) -> None:
    """Refuse a rotation or reflection of the axes, which no instrument is known to write."""
    for cell in root.findall("Record1/Axes/Rotation/*"):
        expected = float(cell.tag in ("r11", "r22", "r33"))
        if abs(float(cell.text or 0) - expected) > _UNTURNED:
            raise UnreadableError(
                "rotates or mirrors its axes (Rotation in its main.xml)",
                "Export it again without a rotation.",
            )


def _stored(root: ElementTree.Element, read: Callable[[str], bytes]) -> np.ndarray:
    """The stored heights of all points, in steps or m."""
    listed = root.find("Record3/DataList")
    if listed is None or root.findtext("Record3/DataLink/PointDataLink"):
        content = read(_text(root, "Record3/DataLink/PointDataLink"))
        data_type = _text(root, "Record1/Axes/CZ/DataType").upper()
        return np.frombuffer(content, (_STEPS | _NUMBERS)[data_type])
    return np.array([cell.text or "nan" for cell in listed.findall("Datum")], float)


def _mask(
    root: ElementTree.Element, read: Callable[[str], bytes], count: int
) -> np.ndarray:
    """Whether each of the points (count,) is measured, in one bit each."""
    name = root.findtext("Record3/DataLink/ValidPointsLink")
    if not name:
        return np.ones(count, bool)
    octets = np.frombuffer(read(name), "u1").reshape((count + 7) // 8)
    return np.unpackbits(octets, count=count, bitorder="little").astype(bool)


def _instrument(root: ElementTree.Element) -> dict[str, str]:
    """The instrument and the time. The month of dates that do not follow ISO 8601 is a guess."""
    model, maker = (
        root.findtext(f"Record2/Instrument/{tag}", "").replace("unknown", "")
        for tag in ("Model", "Manufacturer")
    )
    attrs = {"instrument": model or maker, "vendor": maker}
    with contextlib.suppress(ValueError):
        date = datetime.datetime.fromisoformat(root.findtext("Record2/Date", ""))
        attrs["acquired"] = str(date)
    return {name: text for name, text in attrs.items() if text}
