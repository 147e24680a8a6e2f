"""Intermediate files that are no longer what a job wrote."""

import os
from collections.abc import Callable
from pathlib import Path

import h5py
from report import Count
from study import Study, missing_or_differing


def cut_off(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def zeroed(path: Path) -> None:
    path.write_bytes(bytes(path.stat().st_size))


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def flipped(path: Path) -> None:
    """One bit in the middle of the largest array."""
    with h5py.File(path) as file:
        largest = max(file.values(), key=lambda variable: variable.id.get_storage_size())
        chunk = largest.id.get_chunk_info(largest.id.get_num_chunks() // 2)
    content = bytearray(path.read_bytes())
    content[chunk.byte_offset + chunk.size // 2] ^= 1
    path.write_bytes(content)


def column_lost(path: Path) -> None:
    """The column of the pressures, or else the second one."""
    lines = [line.split(",") for line in path.read_text().splitlines()]
    names = lines[0]
    at = names.index("pressure_MPa") if "pressure_MPa" in names else 1
    path.write_text("".join(",".join(row[:at] + row[at + 1 :]) + "\n" for row in lines))


def rows_lost(path: Path) -> None:
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[: len(lines) // 2]))


CASES: list[tuple[str, Callable[[Path], None], list[str]]] = [
    (
        "HDF5 cut off",
        cut_off,
        ["surfaces/7_T0.h5", "microscale/7.h5"],
    ),
    ("HDF5 full of zeros", zeroed, ["registered/7.h5"]),
    ("HDF5 empty", emptied, ["microscale/16.h5"]),
    (
        "HDF5 with one bit flipped in an array",
        flipped,
        ["macroscale/contact.h5", "microscale/7.h5", "hardness/7.h5"],
    ),
    ("table empty", emptied, ["tables/patch_pressures.csv", "tables/microscale_summary.csv"]),
    (
        "table without a column",
        column_lost,
        ["tables/patch_pressures.csv", "tables/truth.csv", "tables/validation_gains.csv"],
    ),
    ("table cut off between two rows", rows_lost, ["tables/patch_pressures.csv"]),
    ("scan or mesh cut off", cut_off, ["specimen/scans/7_T0.plu", "specimen/mesh.stl"]),
]


def try_damage(folder: Path, finished: Study, reference: dict[str, bytes]) -> list[Count]:
    """Damage a file of a finished study, and run it again.

    Survived: the file is made anew by itself; or an error names it and says what to do, and once it
    is deleted (a scan or mesh of the generated specimen, too) the study ends with the same results.
    """
    counts = []
    for number, (name, damage, files) in enumerate(CASES):
        count = Count(name)
        for file in files:
            place = folder / f"damage{number}-{file.replace('/', '-')}"
            study = Study(place).copy_from(finished)
            damage(study.results / file)
            print(f"  {file}:", flush=True)
            count.add(_run_on(study, file, reference))
        counts.append(count)
    counts.append(Count("HDF5 damaged without a new date, and nothing else to do"))
    study = Study(folder / "unnoticed").copy_from(finished)
    path = study.results / "microscale/7.h5"
    dates = path.stat()
    zeroed(path)
    os.utime(path, ns=(dates.st_atime_ns, dates.st_mtime_ns))
    counts[-1].add(_run_on(study, "microscale/7.h5", reference))
    return counts


def _run_on(study: Study, file: str, reference: dict[str, bytes]) -> str:
    done, said = study.make_as_told()
    if done:
        amiss = missing_or_differing(study.files(), reference)
        return f"not noticed; {amiss}" if amiss else ""
    # Of what a job has made: delete it; of a scan or a mesh, which users bring: copy it again.
    remedies = ("Delete it", "Export or copy")
    errors = [
        line for line in said.splitlines() if file in line and any(r in line for r in remedies)
    ]
    if not errors or "Traceback" in said:
        study.tell(said)
        return "no clear error"
    print(f"    {errors[0].strip()[:150]}", flush=True)
    (study.results / file).unlink()
    done, said = study.make_as_told()
    amiss = missing_or_differing(study.files(), reference) if done else "did not end"
    if amiss:
        study.tell(said)
    return f"not mended by deleting the file: {amiss}" if amiss else ""
