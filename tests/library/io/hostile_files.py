"""Files made to break what reads them: each number makes one, always the same.

Run as a script with a kind, a folder and how many to make, it reads them one after the other, and
prints of each its name, what came of it and the seconds, and in the end the largest memory (MB).
"""

import io
import json
import os
import random
import re
import resource
import struct
import sys
import time
import zipfile
from datetime import date
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import trimesh
from gst.config.patches import read_patches
from gstlib.errors import InputError
from gstlib.io.meshes import is_mesh, read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.store import read_dataset
from scan_files import FORMATS, zipped

_ODD = [
    "",
    "-1",
    "0",
    "A0",
    "XFD1048576",
    "ZZZ99999999999",
    "1e999",
    "NaN",
    "9" * 5000,
    "\u0660",
    "s",
]
_ODD += [
    "b",
    "d",
    "e",
    "inlineStr",
    "str",
    "n",
    "999999",
    "../../etc/passwd",
    "rId9",
    "&#1;",
    "#N/A",
]
_MANY = [
    "<row/>",
    "<c/>",
    '<row><c r="XFD1"/></row>',
    "<si/>",
    "<xf/>",
    "<font/>",
    "<a>",
    "<a b=''/>",
]
_MANY += ['<row r="1"><c r="A1"><v>1</v></c></row>', "<vertex x='0' y='0' z='0'/>", "<item/>"]
_BOMB = "<!DOCTYPE a [<!ENTITY b0 'aaaaaaaaaa'>{}]>".format(
    "".join(f"<!ENTITY b{n} '{10 * f'&b{n - 1};'}'>" for n in range(1, 9))
)


def _workbook():
    book = openpyxl.Workbook()
    book.active.append(["patch", "x_mm", "y_mm", "t0", "note"])
    for n in range(1, 7):
        book.active.append([n, 0.7 * n, 1.5, f"{n}_T0.plu", date(2024, 5, n)])
    book.active["E3"], book.active["E4"] = "=1+1", "#N/A"
    book.create_sheet("notes")["C3"] = "a note"
    return _saved(book.save)


def _saved(save):
    content = io.BytesIO()
    save(content)
    return content.getvalue()


@cache
def _sound(folder):
    """A sound file of each format that holds files or a header in JSON, by its ending."""
    heights = 1e-3 * np.random.default_rng(1).normal(size=(40, 50))
    files = {"xlsx": _workbook()}
    for sample in ("plux", "x3p"):
        path = folder / "sound"
        FORMATS[sample].write(path, heights, (1e-3, 1e-3))
        files[sample] = path.read_bytes()
    ball = trimesh.creation.icosphere(3, radius=20)
    files |= {kind: ball.export(file_type=kind) for kind in ("glb", "3mf")}
    return files | {"npz": _saved(lambda file: np.savez_compressed(file, height=heights))}


def _hdf5(file, change):
    with h5py.File(file, "w") as root:
        root.create_dataset("height", data=np.zeros((40, 50)), chunks=(40, 50), compression=1)
        change(root)


def _external(root):
    root.create_dataset("e", (100,), "u1", external=[("/etc/hostname", 0, 100)])


def _virtual(root):
    layout = h5py.VirtualLayout((100,), "f8")
    layout[:] = h5py.VirtualSource("/tmp/other.h5", "height", (100,))
    root.create_virtual_dataset("v", layout)


def _long_texts(root):
    texts = root.create_dataset("a", (100_000,), h5py.string_dtype())
    texts[:10] = "x" * 500_000


def _attributes(root):
    root.attrs["a"] = np.array(["x" * 100_000] * 1000, h5py.string_dtype())


def _references(root):
    root["r"] = np.array([root["height"].ref] * 9, h5py.ref_dtype)
    root["height"].attrs["DIMENSION_LIST"] = np.array([root.ref] * 2, h5py.ref_dtype)


def _filtered(root):
    root.create_dataset("f", data=np.zeros(1000), chunks=(1000,), scaleoffset=3)


HDF5 = {
    "external storage": _external,
    "virtual": _virtual,
    "external link": lambda root: root.update(l=h5py.ExternalLink("/tmp/other.h5", "height")),
    "soft link": lambda root: root.update(l=h5py.SoftLink("/height")),
    "loop": lambda root: root.create_group("g").update(again=root),
    "huge": lambda root: root.create_dataset("huge", (10**6, 10**6), "f8", chunks=(100, 100)),
    "huge chunk": lambda root: root.create_dataset(
        "chunk", (1, 1), "f8", maxshape=(None, None), chunks=(20_000, 20_000)
    ),
    "zeros": lambda root: root.create_dataset("z", data=np.zeros(4_000_000), compression=1),
    "texts": _long_texts,
    "attributes": _attributes,
    "references": _references,
    "filter": _filtered,
    "group": lambda root: root.create_group("g").create_dataset("x", data=1),
    "many": lambda root: [root.create_dataset(f"d{n}", data=n) for n in range(3000)],
    "type": lambda root: root.update(t=np.dtype("f8")),
}


def _text_changed(rng, text):
    """XML or JSON with odd values, very many elements, deep nesting or an entity."""
    text = text.decode("utf-8", "replace")
    quotes = [n for n, letter in enumerate(text) if letter == '"']
    closing = [n for n, letter in enumerate(text) if letter == ">"] or [0]
    at = rng.choice(closing) + 1
    action = rng.randrange(8)
    if action < 2 and len(quotes) > 1:
        start = rng.randrange(len(quotes) - 1)
        text = text[: quotes[start] + 1] + rng.choice(_ODD) + text[quotes[start + 1] :]
    elif action == 2:
        text = text[:at] + rng.choice(_MANY) * rng.choice([10, 30_000, 300_000]) + text[at:]
    elif action == 3:
        text = text[:at] + "<a>" * 100_000 + "</a>" * 100_000 + text[at:]
    elif action == 4:
        text = f"<?xml version='1.0'?>{_BOMB}{text[text.find('<', 5) :].replace('>', '>&b8;', 2)}"
    elif action == 5:
        text = text.replace("<v>", f"<v>{rng.choice(_ODD)}", rng.choice([1, 100]))
    elif action == 6:
        row = f'<row r="{rng.choice([9, 10**6, 10**12])}"><c r="XFD1048576"><v>1</v></c></row>'
        text = text.replace("</sheetData>", f"{row}</sheetData>")
    else:
        text = text[: rng.randrange(len(text) + 1)]
    return text.encode()


def _zip_changed(rng, content):
    """A member changed, lost, exchanged or packed otherwise, or headers that lie."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name, other = rng.choice([*members]), rng.choice([*members])
    action = rng.randrange(8)
    if action < 3:
        members[name] = _text_changed(rng, members[name])
    elif action == 3:
        del members[name]
    elif action == 4:
        members[name] = members[other] if name != other else b""
    elif action == 5:
        members |= {f"{name}/{n}": b"" for n in range(2000)}
    elif action == 6:
        return zipped(members, rng.choice([zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]))
    else:
        members[name] += bytes(40_000_000)
    content = zipped(members)
    if action == 7:
        content = bytearray(content)
        at = content.rindex(b"PK\1\2" if rng.random() < 0.5 else name.encode())
        directory = content.index(b"PK\1\2")
        for at in (
            at for at in range(directory, len(content)) if content[at : at + 4] == b"PK\1\2"
        ):
            struct.pack_into("<I", content, at + 24, rng.choice([0, 100, 10_000, 2**31]))
    return bytes(content)


def _header_changed(rng, content):
    """A GLB with another header."""
    end = 20 + int.from_bytes(content[12:16], "little")
    header = json.loads(content[20:end])
    action = rng.randrange(5)
    if action == 0:  # as many paths as 2 to the power of 40
        header["nodes"] = [{"children": [n + 1, n + 1], "mesh": 0} for n in range(40)] + [
            {"mesh": 0}
        ]
    elif action == 1:
        header["nodes"] = [{"children": [1]}, {"children": [0], "mesh": 0}]
    elif action == 2:
        part = rng.choice(header["accessors"] + header["bufferViews"])
        part[rng.choice([*part])] = rng.choice([-1, 2**31, 10**30, None, "a", [], 1.5])
    elif action == 3:
        header["extras"] = [[]] * 190_000
    text = json.dumps(header).encode() if action < 4 else b"[" * 190_000
    sizes = struct.pack("<4sIII", b"glTF", 2, 20 + len(text) + len(content) - end, len(text))
    return sizes + b"JSON" + text + content[end:]


def make(kind, number, folder):
    """Make file `number`, workbooks or containers, and return its path."""
    rng = random.Random(f"{kind} {number}")
    sound = _sound(folder)
    ending = "xlsx" if kind == "workbooks" else rng.choice([e for e in sound if e != "xlsx"])
    path = folder / f"{number}.{ending}"
    if kind == "containers" and number < 2 * len(HDF5):
        path = folder / f"{number}.{'h5' if number % 2 else 'result'}"
        path.write_bytes(_saved(lambda file: _hdf5(file, [*HDF5.values()][number // 2])))
        return path
    change = _header_changed if ending == "glb" else _zip_changed
    path.write_bytes(change(rng, sound[ending]))
    return path


def _read(path):
    if path.suffix == ".xlsx":
        return read_patches(path, size_mm=5.0, patch_size_mm=0.85)
    if path.suffix == ".result":
        return read_dataset(path)
    return read_mesh(path) if is_mesh(path) else read_scan(path, unit="um", spacing_um=1.0)


def main(kind, folder, count):
    for number in range(int(count)):
        path = make(kind, number, Path(folder))
        before = time.process_time()
        try:
            _read(path)
            result = "read"
        except InputError as error:
            lines = str(error).splitlines()
            is_list = all(line.startswith("  ") for line in lines[1:])
            is_short = len(str(error)) < 10_000 and is_list and path.name in lines[0]
            result = "refused" if is_short else f"badly refused: {str(error)[:300]!r}"
        except BaseException as error:
            result = f"{type(error).__name__}: {error}"
        print(path.name, result, f"{time.process_time() - before:.2f}", sep="\t", flush=True)
        path.unlink()
    print("MB", _peak_memory_mb())


def _peak_memory_mb():
    """Of this program alone: Linux counts that of the starting process in `ru_maxrss`, too."""
    status = Path("/proc/self/status")
    if not status.is_file():  # macOS counts in bytes
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1_000_000
    return int(re.findall(r"VmHWM:\s+(\d+)", status.read_text())[0]) // 1000


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    main(*sys.argv[1:])
