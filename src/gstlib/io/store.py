"""HDF5 between the stages: complete or absent, and the same bytes for the same content.

xarray's h5netcdf engine writes them. Every array has HDF5's own checksum (the fletcher32 filter):
reading a damaged file gives an error, not wrong numbers.
"""

import io
import logging
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import xarray as xr

from gstlib.errors import InputError
from gstlib.io.files import write_whole

__all__ = ["Stored", "read_attributes", "read_dataset", "write_dataset"]

_log = logging.getLogger(__name__)

# Below this many values, compression only adds overhead.
_COMPRESS_FROM = 1024


def write_dataset(
    path: str | Path, dataset: xr.Dataset, attrs: Mapping[str, object] | None = None
) -> None:
    """Write `dataset` to `path`; an old file is replaced once the new one is whole.

    Every data variable must carry ``units`` and ``long_name``. `attrs` are added to the attributes
    of the dataset (see `gst.provenance`). Errors as in `gstlib.io.files.write_whole`.
    """
    for name, variable in dataset.data_vars.items():
        if missing := {"units", "long_name"} - set(variable.attrs):
            raise ValueError(f"variable '{name}' lacks {', '.join(sorted(missing))}")
    # In memory first: HDF5 does not recover from a disk that fills up under it.
    content = io.BytesIO()
    dataset.assign_attrs(attrs or {}).to_netcdf(
        content,
        engine="h5netcdf",
        format="NETCDF4",
        encoding={name: _encoding(variable) for name, variable in dataset.variables.items()},
    )
    write_whole(path, content.getbuffer())


def _encoding(variable: xr.Variable) -> dict[str, object]:
    """How a variable is stored: with a checksum, and masks and constants compressed.

    Other heights and pressures are stored as they are: half of their digits are noise, and packing
    them took a tenth of a study's time to save a third of its disk.
    """
    if not variable.shape or not variable.size or variable.dtype.kind not in "fiub":
        return {}
    varies = variable.dtype.kind == "f" and variable.values.min() != variable.values.max()
    if variable.size < _COMPRESS_FROM or varies:
        return {"fletcher32": True, "chunksizes": variable.shape}
    return {"fletcher32": True, "zlib": True, "complevel": 4, "shuffle": True}


def read_dataset(path: str | Path, only: Iterable[str] | None = None) -> xr.Dataset:
    """Read a file, or `only` some of its variables, into memory and close it.

    Raises
    ------
    InputError
        The file is missing, damaged or not HDF5, or lacks a variable.
    """
    try:
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            return (dataset if only is None else dataset[list(only)]).load()
    except MemoryError:  # not the file's fault
        raise
    except Exception as error:  # a damaged file can make HDF5 fail in many ways
        raise InputError(
            path, f"cannot be read as HDF5 ({error})", "Delete it and run the study again."
        ) from error


def read_attributes(path: str | Path) -> dict[str, object]:
    """The attributes of a file, without its fields; errors as in `read_dataset`."""
    return read_dataset(path, only=()).attrs


class Stored(Mapping):
    """Datasets by name, each read from its file when it is looked up.

    What a stage goes through patch by patch would fill the memory if all of it were read at once.

    Parameters
    ----------
    files : mapping of str to path
    only : iterable of str, optional
        Variables to read; all by default.
    """

    def __init__(self, files: Mapping[str, str | Path], only: Iterable[str] | None = None):
        self._files, self._only = dict(files), None if only is None else list(only)

    def __getitem__(self, name: str) -> xr.Dataset:
        _log.info("%s: %s", name, self._files[name])
        return read_dataset(self._files[name], self._only)

    def __contains__(self, name: object) -> bool:
        return name in self._files  # a Mapping's own would read the file

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)
