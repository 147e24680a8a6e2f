"""What each step of a study made: SHA-256 of its files, and which files are no longer the same.

A step writes its record beside its log, as ``sha256sum --check`` reads it. Of a file in two records
the newer counts: other batches of patches make the same files. Whoever says that a study is
complete, or packs it, compares.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from gstlib.errors import InputError
from gstlib.io.files import sha256, write_whole

__all__ = ["check_made", "read_records", "record_made", "record_of", "records_in"]

_ENDING = ".sha256"
_SEPARATOR = "  "  # as sha256sum writes it
_FOLDER = "# "
# Files up to this size (bytes) are always compared, larger ones if their date is later.
_SMALL = 1 << 20


class Made(NamedTuple):
    """A file as its step made it.

    Attributes
    ----------
    digest : str
    output : Path
        What the step made: the file, or the folder that it lies in.
    recorded_ns : int
        When.
    """

    digest: str
    output: Path
    recorded_ns: int


def record_of(log: str | Path) -> Path:
    """The record of a step with this log."""
    return Path(log).with_suffix(_ENDING)


def record_made(outputs: Iterable[Path], record: Path) -> None:
    """Record the outputs of a step, files or folders, by their paths as the step has them."""
    lines = []
    for output in outputs:
        files = [output]
        if output.is_dir():
            lines.append(f"{_FOLDER}{output}")
            files = sorted(file for file in output.rglob("[!.]*") if file.is_file())
        lines += [f"{sha256(file)}{_SEPARATOR}{file}" for file in files]
    write_whole(record, "".join(f"{line}\n" for line in lines).encode())


def records_in(results: Path) -> list[Path]:
    """The records of all steps of a study."""
    return list(results.glob(f"logs/**/*{_ENDING}"))


def read_records(records: Iterable[Path]) -> dict[Path, Made]:
    """Every file that steps made, by its path."""
    made: dict[Path, Made] = {}
    dated = sorted((record.stat().st_mtime_ns, record) for record in records)
    for recorded_ns, record in dated:
        folders: list[Path] = []
        for line in record.read_text(encoding="utf-8").splitlines():
            if line.startswith(_FOLDER):
                folders.append(Path(line.removeprefix(_FOLDER)))
                continue
            digest, _, name = line.partition(_SEPARATOR)
            file = Path(name)
            output = next((folder for folder in folders if folder in file.parents), file)
            made[file] = Made(digest, output, recorded_ns)
    return made


def check_made(made: Mapping[Path, Made], *, thoroughly: bool = False) -> None:
    """Refuse files that are no longer what their steps made.

    A file above a megabyte whose date is not later than its record counts as the same, unless
    `thoroughly`; a missing file is no concern of this.

    Raises
    ------
    InputError
    """
    changed = []
    for file, (digest, _, recorded_ns) in made.items():
        if not file.is_file():
            continue
        stat = file.stat()
        seen = thoroughly or stat.st_size <= _SMALL or stat.st_mtime_ns > recorded_ns
        if seen and sha256(file) != digest:
            changed.append(str(file))
    if changed:
        others = f" and {len(changed) - 1} others" if len(changed) > 1 else ""
        raise InputError(
            changed[0],
            f"is not as its step made it{others and ','}{others}: cut, or edited",
            "Delete it and run the study again; keep what you edited elsewhere.",
        )
