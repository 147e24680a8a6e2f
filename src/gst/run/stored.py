"""The files between the jobs of a study: scripts read those of other jobs, and write their own."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd
import xarray as xr

from gstlib import __version__
from gstlib.io.store import Stored, read_dataset, write_dataset
from gstlib.io.tables import read_table

# Of the prepared scans, whose folders have these names.
_EPOCHS = "T0", "T1", "repeat"
# Of a height change, what wear is fitted to and scored by.
_CHANGE = "change", "loss", "level_of_detection"


def dataset_of(
    file: Path | list, only: Iterable[str] | None = None
) -> xr.Dataset | None:
    """The dataset in a file, or some of it; None for ``[]``: the study does not have the file."""
    return read_dataset(file, only) if isinstance(file, Path) else None


def face_of(file: Path) -> xr.Dataset:
    """The pressed face: heights, the active tool over them, and the side of the square."""
    return read_dataset(file, only=["height", "counterface", "size_mm"])


def active_tool_of(file: Path | list) -> xr.DataArray | None:
    """The heights of an active tool that is a mesh, likewise; None without one."""
    mesh = dataset_of(file)
    return None if mesh is None else mesh.face


def table_of(file: Path | list) -> pd.DataFrame | None:
    """The table in a file, likewise."""
    return read_table(file) if isinstance(file, Path) else None


def files_of(folders: Path | Iterable[Path], patches: Iterable[str]) -> dict[str, Path]:
    """The files of the patches in the folders of their batches, by patch, where there is one.

    A file has the name of its patch. In the folder of an epoch ``_`` and the epoch follow, which no
    id has. Any other file in a folder is somebody else's.
    """
    folders = [folders] if isinstance(folders, Path) else [*folders]
    return {
        patch: file
        for patch in patches
        for folder in folders
        if (file := folder / f"{patch}{_epoch_of(folder)}.h5").is_file()
    }


def _epoch_of(folder: Path) -> str:
    """What follows the patch's id in the names of the files in a folder."""
    epoch = folder.parent.name
    return f"_{epoch}" if epoch in _EPOCHS else ""


def files_by_epoch(
    folders: Mapping[str, Iterable[Path]], patches: Iterable[str]
) -> dict[tuple[str, str], Path]:
    """The files of the patches by patch and epoch; `folders` are those of each epoch's batches."""
    by_epoch = {epoch: files_of(places, patches) for epoch, places in folders.items()}
    return {
        (patch, epoch): files[patch]
        for patch in patches
        for epoch, files in by_epoch.items()
        if patch in files
    }


def scans_of(
    folders: Path | Iterable[Path],
    patches: Iterable[str],
    only: Iterable[str] = ("height",),
) -> Mapping[str, xr.Dataset]:
    """The clean scans of patches in the folders of batches, each read when it is looked up."""
    return Stored(files_of(folders, patches), only)


def changes_of(
    folders: Path | Iterable[Path],
    patches: Iterable[str],
    only: Iterable[str] = _CHANGE,
) -> Mapping[str, xr.Dataset]:
    """The height changes of patches, likewise."""
    return Stored(files_of(folders, patches), only)


def write_result(file: Path, dataset: xr.Dataset, step: str) -> None:
    """Write a result with the version and its step, whose record contains the rest."""
    origin = {"step": step, "gstlib_version": __version__}
    write_dataset(file, dataset, origin)
