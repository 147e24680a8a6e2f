"""HDF5 between the stages: complete or absent, and the same bytes for the same content.

The files are netCDF, as xarray writes it, and `xarray.open_dataset` reads them. xarray takes 40 ms
to open a file and 60 ms to write it, however small it is. This module takes a quarter of the time,
and a study reads and writes some 700 files. Every array has HDF5's own checksum (the fletcher32
filter): reading a damaged file gives an error, not wrong numbers.
"""

import io
import itertools
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.io.containers import check_hdf5
from gstlib.io.files import cannot_read, check_regular, write_whole

__all__ = ["Stored", "read_attributes", "read_dataset", "write_dataset"]

_log = logging.getLogger(__name__)

# Below this many values compression only adds overhead.
_COMPRESS_FROM = 1024
# Marks of netCDF for dimensions and missing values in HDF5. Older files have all of these.
_OF_THE_FORMAT = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "_FillValue"}
_OF_THE_FORMAT |= {"_Netcdf4Coordinates", "_Netcdf4Dimid", "_NCProperties"}
# Letters of a field's texts, each as long as the longest: there are names and words.
_MOST_LETTERS = 1 << 24
_NO_COORDINATES = "This is a netCDF dimension but not a netCDF variable."


def write_dataset(
    path: str | Path, dataset: xr.Dataset, attrs: Mapping[str, object] | None = None
) -> None:
    """Write `dataset` to `path`, and replace an old file once the new file is complete.

    Every data variable must carry ``units`` and ``long_name``. `attrs` are added to the attributes
    of the dataset (see `gst.run.provenance`). Raises as `gstlib.io.files.write_whole`.
    """
    for name, variable in dataset.data_vars.items():
        missing = {"units", "long_name"} - variable.attrs.keys()
        if missing:
            raise ValueError(f"variable '{name}' lacks {', '.join(sorted(missing))}")
    # In memory first: HDF5 does not recover from a disk that fills up under it.
    content = io.BytesIO()
    with h5py.File(content, "w", track_order=True) as file:
        file.attrs.update(dataset.attrs | dict(attrs or {}))
        for dim, size in dataset.sizes.items():
            if dim not in dataset.variables:
                bare = file.create_dataset(dim, size, ">f4")
                bare.make_scale(f"{_NO_COORDINATES}{size:10d}")
        for name, field in dataset.variables.items():
            _write_field(file, str(name), field)
        for name, field in dataset.variables.items():
            for axis, dim in enumerate(field.dims):
                if dim != name:
                    file[name].dims[axis].attach_scale(file[dim])
    write_whole(path, content.getbuffer())


def _write_field(file: h5py.File, name: str, variable: xr.Variable) -> None:
    """Write a field without its dimensions. A coordinate becomes a dimension."""
    values, attrs = variable.values, dict(variable.attrs)
    if values.dtype.kind == "b":  # as xarray writes them
        values = values.astype(np.int8)
        attrs["dtype"] = "bool"
    elif values.dtype.kind not in "iuf":
        values = values.astype(h5py.string_dtype())
    storage = _storage(values)
    field = file.create_dataset(name, data=values, track_order=True, **storage)
    field.attrs.update(attrs)
    if variable.dims == (name,):
        field.make_scale(name)


def _storage(values: np.ndarray) -> dict[str, object]:
    """Options of a stored array: a checksum, and compression if values repeat.

    Values of masks repeat, as do pressures, which are zero nearly everywhere. Heights are not
    compressed. Half of their digits are noise, and packing them took a tenth of a study's time to
    save a third of its disk.
    """
    is_text = values.dtype.kind == "O"
    if is_text or not values.size or not values.shape:
        return {}
    flat = values.reshape(-1)
    repeats = np.count_nonzero(flat[1:] == flat[:-1])
    is_repetitive = flat.size >= _COMPRESS_FROM and 2 * repeats >= flat.size - 1
    # Level 1 writes twice as fast as 4, and packs zeros as well.
    compression = 1 if is_repetitive else None
    return {"fletcher32": True, "chunks": values.shape, "compression": compression}


def read_dataset(path: str | Path, only: Iterable[str] | None = None) -> xr.Dataset:
    """Read a file of `write_dataset`, or `only` some of its variables, into memory.

    Raises
    ------
    InputError
        The file is missing, damaged or no HDF5 file, or lacks a variable. It links to other files,
        or declares more than it can contain.

    Examples
    --------
    >>> import gstlib, pathlib, tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name) / "surface.h5"
    >>> surface = gstlib.make_surface(np.ones((3, 4)), 0.5, long_name="height")
    >>> gstlib.io.store.write_dataset(path, surface.to_dataset(name="height"))
    >>> gstlib.read_dataset(path).height.sum().item(), dict(gstlib.read_dataset(path).sizes)
    (12.0, {'y': 3, 'x': 4})
    """
    try:
        check_regular(path)
        with h5py.File(path) as file:
            check_hdf5(path, file)
            wanted = file if only is None else only
            dims_of = {name: _dimensions(file[name]) for name in wanted}
            dims = set(itertools.chain.from_iterable(dims_of.values()))
            # their coordinates, too
            dims_of |= {name: [name] for name in file if name in dims - dims_of.keys()}
            variables = {
                name: _variable(file[name], own)
                for name, own in dims_of.items()
                if not _is_bare(file[name])
            }
            coords = {
                name: variables.pop(name) for name in list(variables) if name in dims
            }
            return xr.Dataset(variables, coords, _attributes(file))
    except (InputError, MemoryError):  # the latter is not the file's fault
        raise
    except Exception as error:  # a damaged file makes HDF5 fail in any of its own ways
        raise cannot_read(path, "HDF5", error) from error


def read_attributes(path: str | Path) -> dict[str, object]:
    """The attributes of a file, without its fields. See `read_dataset` for errors."""
    return read_dataset(path, only=()).attrs


def _dimensions(field: h5py.Dataset) -> list[str]:
    """Names of a field's dimensions. A coordinate is its own dimension."""
    scales = [field] if field.shape else []
    if (
        "DIMENSION_LIST" in field.attrs
    ):  # HDF5's own reader of it trusts it, and may crash
        references = field.attrs["DIMENSION_LIST"]
        scales = [field.file[reference[0]] for reference in references]
    return [Path(scale.name).name for scale in scales]


def _is_bare(field: h5py.Dataset) -> bool:
    """Whether a field is nothing but the length of a dimension."""
    return field.attrs.get("NAME", b"").startswith(_NO_COORDINATES.encode())


def _variable(field: h5py.Dataset, dims: list[str]) -> xr.Variable:
    attrs = _attributes(field)
    is_text = h5py.check_string_dtype(field.dtype)
    values = _texts(field) if is_text else field[()]
    if attrs.pop("dtype", "") == "bool":  # HDF5 knows none: they are stored as integers
        values = values.astype(bool)
    return xr.Variable(dims, values, attrs)


def _texts(field: h5py.Dataset) -> np.ndarray:
    """The texts of a field, read one by one, because several may be the same long one."""
    texts = np.empty(field.shape, object)
    longest = 0
    for place in np.ndindex(field.shape):
        texts[place] = field.asstr()[place]
        longest = max(longest, len(texts[place]))
        if longest * texts.size > _MOST_LETTERS:
            raise ValueError(f"the texts of {field.name} are too long")
    return texts.astype(str)


def _attributes(place: h5py.Dataset | h5py.File) -> dict[str, object]:
    """The attributes of the dataset, not of the format, with single numbers as scalars."""
    names = [name for name in place.attrs if name not in _OF_THE_FORMAT]
    attrs = {name: place.attrs[name] for name in names}
    for name, value in attrs.items():
        if np.shape(value) == (1,):
            attrs[name] = value[0]
    return attrs


class Stored(Mapping):
    """Datasets by name, each read from its file when it is looked up.

    The data that a stage processes patch by patch would fill the memory if it were read at once.

    Parameters
    ----------
    files : mapping to path
        By name, such as a patch's, or by several names.
    only : iterable of str, optional
        Variables to read. The default is all.
    then : callable, optional
        Converts each dataset to the looked-up value.
    """

    def __init__(
        self,
        files: Mapping[Any, str | Path],
        only: Iterable[str] | None = None,
        then: Callable[[xr.Dataset], Any] = lambda dataset: dataset,
    ):
        self._files = dict(files)
        self._only = None if only is None else list(only)
        self._then = then

    def __getitem__(self, name: Any) -> Any:
        _log.info("%s: %s", name, self._files[name])
        return self._then(read_dataset(self._files[name], self._only))

    def __contains__(self, name: object) -> bool:
        return name in self._files  # a Mapping's own would read the file

    def __iter__(self) -> Iterator[Any]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)
