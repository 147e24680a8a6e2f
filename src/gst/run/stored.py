"""Read the files of other jobs in scripts: one file, or the files of patches one by one."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd
import xarray as xr

from gst.run.batches import files_of
from gstlib.contact import Contact
from gstlib.io.store import Stored, read_dataset
from gstlib.io.tables import read_table

# Of a height change, what wear is fitted to and scored by.
_CHANGE = "change", "loss", "level_of_detection"


def dataset_of(file: Path | list) -> xr.Dataset | None:
    """The dataset in a file; None for ``[]``, a file that the study does not have."""
    return read_dataset(file) if isinstance(file, Path) else None


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


def contact_of(file: Path) -> Contact:
    """The contact in a file."""
    return Contact.from_dataset(read_dataset(file))


def contacts_of(
    folders: Path | Iterable[Path], patches: Iterable[str]
) -> Mapping[str, Contact]:
    """The contacts of patches in the folders of their batches, each read when it is looked up."""
    return Stored(files_of(folders, patches), then=Contact.from_dataset)


def changes_of(
    folders: Path | Iterable[Path], patches: Iterable[str]
) -> Mapping[str, xr.Dataset]:
    """The height changes of patches, likewise."""
    return Stored(files_of(folders, patches), _CHANGE)
