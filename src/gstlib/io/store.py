"""HDF5 between the stages: complete or absent, and the same bytes for the same content.

xarray's h5netcdf engine writes them. Every array has HDF5's own checksum (the fletcher32 filter):
reading a damaged file gives an error, not wrong numbers.
"""

import io
from collections.abc import Iterable, Mapping
from pathlib import Path

import h5py
import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.io.files import write_whole

__all__ = ["read_attributes", "read_dataset", "write_dataset"]

# Below this many values compression only adds overhead.
_COMPRESS_FROM = 1024
# How netCDF, as xarray writes it, marks dimensions and missing values in HDF5.
_OF_THE_FORMAT = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "_FillValue"}
_OF_THE_FORMAT |= {"_Netcdf4Coordinates", "_Netcdf4Dimid", "_NCProperties"}
_NO_COORDINATES = b"This is a netCDF dimension but not a netCDF variable."


def write_dataset(
    path: str | Path, dataset: xr.Dataset, attrs: Mapping[str, object] | None = None
) -> None:
    """Write `dataset` to `path`; an old file is replaced once the new one is whole.

    Every data variable must carry ``units`` and ``long_name``. `attrs` are added to the attributes
    of the dataset (see `gst.provenance`). Raises as `gstlib.io.files.write_whole`.
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
    """How a variable is stored: with a checksum, and masks compressed.

    Heights and pressures are stored as they are: half of their digits are noise, and packing them
    took a tenth of a study's time to save a third of its disk.
    """
    if not variable.shape or not variable.size or variable.dtype.kind not in "fiub":
        return {}
    if variable.size < _COMPRESS_FROM or variable.dtype.kind == "f":
        return {"fletcher32": True, "chunksizes": variable.shape}
    return {"fletcher32": True, "zlib": True, "complevel": 4, "shuffle": True}


def read_dataset(path: str | Path, only: Iterable[str] | None = None) -> xr.Dataset:
    """Read a file of `write_dataset`, or `only` some of its variables, into memory.

    It is what `xarray.open_dataset` gives, which takes ten times as long to find its way through a
    file as to read it: 40 ms, 600 times in a study.

    Raises
    ------
    InputError
        The file is missing, damaged or no HDF5 file, or lacks a variable.
    """
    try:
        with h5py.File(path) as file:
            fields = {name: file[name] for name in (file if only is None else only)}
            dims = {dim for field in fields.values() for dim in _dimensions(field)}
            fields |= {name: file[name] for name in file if name in dims}
            found = {
                name: _variable(field)
                for name, field in fields.items()
                if not field.attrs.get("NAME", b"").startswith(_NO_COORDINATES)
            }
            coords = {name: found.pop(name) for name in list(found) if name in dims}
            return xr.Dataset(found, coords, _attributes(file))
    except MemoryError:  # not the file's fault
        raise
    except Exception as error:  # a damaged file makes HDF5 fail in any of its own ways
        raise InputError(
            path, f"cannot be read as HDF5 ({error})", "Delete it and run the study again."
        ) from error


def read_attributes(path: str | Path) -> dict[str, object]:
    """The attributes of a file, without its fields; raises as `read_dataset`."""
    return read_dataset(path, only=()).attrs


def _dimensions(field: h5py.Dataset) -> list[str]:
    """Names of a field's dimensions; a coordinate is its own."""
    if "DIMENSION_LIST" in field.attrs:
        return [Path(dimension[0].name).name for dimension in field.dims]
    return [Path(field.name).name] if field.shape else []


def _variable(field: h5py.Dataset) -> xr.Variable:
    values, attrs = field[()], _attributes(field)
    if h5py.check_string_dtype(field.dtype):
        values = field.asstr()[()].astype(str)
    if attrs.pop("dtype", "") == "bool":  # HDF5 knows none: they are stored as integers
        values = values.astype(bool)
    return xr.Variable(_dimensions(field), values, attrs)


def _attributes(place: h5py.Dataset | h5py.File) -> dict[str, object]:
    """The attributes that are the dataset's own, not the format's; a single number as such."""
    own = {name: place.attrs[name] for name in place.attrs if name not in _OF_THE_FORMAT}
    return {
        name: value[0] if np.shape(value) == (1,) else value for name, value in own.items()
    }
