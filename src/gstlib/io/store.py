"""HDF5 between the stages: complete or absent, and the same bytes for the same content.

Files are written through xarray's h5netcdf engine, so xarray, h5py, h5dump and MATLAB open them.
Nothing in them depends on the clock.
"""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import xarray as xr

from gstlib.errors import InputError

__all__ = ["read_attributes", "read_dataset", "write_dataset"]

# Below this many values compression only adds overhead.
_COMPRESS_FROM = 1024


def write_dataset(
    path: str | Path, dataset: xr.Dataset, attrs: Mapping[str, object] | None = None
) -> None:
    """Write `dataset` to `path`, replacing what is there only once the new file is whole.

    Parameters
    ----------
    path : str or Path
        Target file; its folder is made if need be.
    dataset : xarray.Dataset
        Every data variable must carry ``units`` and ``long_name``.
    attrs : mapping, optional
        Attributes of the file, added to those of the dataset (see `gstlib.provenance`).
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    for name, variable in dataset.data_vars.items():
        missing = {"units", "long_name"} - set(variable.attrs)
        if missing:
            raise ValueError(f"variable '{name}' lacks {', '.join(sorted(missing))}")
    encoding = {
        name: {"zlib": True, "complevel": 4, "shuffle": True}
        for name, variable in dataset.data_vars.items()
        if variable.size >= _COMPRESS_FROM and variable.dtype.kind in "fiub"
    }
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        dataset.assign_attrs(attrs or {}).to_netcdf(
            temporary, engine="h5netcdf", format="NETCDF4", encoding=encoding
        )
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read_dataset(path: str | Path, only: Iterable[str] | None = None) -> xr.Dataset:
    """Read a file, or some of its variables, into memory and close it.

    Parameters
    ----------
    path : str or Path
        A file of `write_dataset`.
    only : iterable of str, optional
        Variables to read; all by default.

    Raises
    ------
    InputError
        The file is missing or is not a readable HDF5 file, or lacks a variable.
    """
    try:
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            return (dataset if only is None else dataset[list(only)]).load()
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            path, f"cannot be read as HDF5 ({error})", "Delete it and run the study again."
        ) from error


def read_attributes(path: str | Path) -> dict[str, object]:
    """The attributes of a file, without its fields; raises as `read_dataset`."""
    return read_dataset(path, only=()).attrs
