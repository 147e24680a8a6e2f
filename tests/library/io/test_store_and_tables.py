"""Files between the stages: the same bytes for the same content, and damage is noticed."""

import fcntl
import time

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scan_files import refused

from gstlib.errors import InputError
from gstlib.io.store import Stored, read_dataset, write_dataset
from gstlib.io.tables import printed, read_table, write_table
from gstlib.surfaces.grid import make_surface


def dataset():
    heights = np.random.default_rng(1).normal(size=(64, 48))
    return make_surface(heights, (0.1, 0.2)).to_dataset(name="height")


@pytest.fixture
def path(tmp_path):
    """A file of the dataset."""
    write_dataset(tmp_path / "a.h5", dataset())
    return tmp_path / "a.h5"


def test_same_content_same_bytes_whenever_written(path):
    time.sleep(1.1)  # the clock's seconds move on
    write_dataset(path.with_name("b.h5"), dataset())
    assert path.read_bytes() == path.with_name("b.h5").read_bytes()


def test_units_are_required(tmp_path):
    bare = dataset()
    del bare.height.attrs["units"]
    with pytest.raises(ValueError, match="'height' lacks units"):
        write_dataset(tmp_path / "a.h5", bare)
    assert list(tmp_path.iterdir()) == []


def test_datasets_by_name_are_read_when_they_are_looked_up_and_only_then(path):
    write_dataset(path, dataset().assign(gap=dataset().height))
    stored = Stored({"missing": path.with_name("b.h5"), "a": path}, ["height"])
    assert list(stored) == ["missing", "a"]
    assert "missing" in stored
    assert list(stored["a"]) == ["height"]


def test_unreadable_files_are_named(path):
    for content in (b"no HDF5", path.read_bytes()[:9000]):
        path.write_bytes(content)
        refused(path, "Delete it", read_dataset)


def test_a_file_that_cannot_be_opened_is_not_to_be_deleted(path):
    """It is whole: another program holds it, or it lies elsewhere."""
    with path.open("rb+") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        refused(path, "HDF5_USE_FILE_LOCKING", read_dataset)
    for read in (read_dataset, read_table):
        with pytest.raises(InputError) as caught:
            read(path.with_name("missing"))
        assert "Delete" not in caught.value.remedy


def test_a_flipped_bit_in_an_array_is_noticed(path):
    with h5py.File(path) as file:
        chunks = [variable.id.get_chunk_info(0) for variable in file.values()]
    assert len(chunks) == 3  # y, x, height
    whole = path.read_bytes()
    for chunk in chunks:
        for at in (0, chunk.size // 2, chunk.size - 5):
            content = bytearray(whole)
            content[chunk.byte_offset + at] ^= 1
            path.write_bytes(content)
            refused(path, "Delete it", read_dataset)


def test_xarray_reads_what_was_written_and_it_is_read_as_xarray_does(tmp_path):
    """Masks, texts, counts, a dimension without coordinates, attributes of each kind."""
    named = {"units": "1", "long_name": "n"}
    kinds = xr.Dataset(
        {
            "mask": (("patch", "y"), [[True, False, True]], named),
            "word": (("k",), ["loss", "gain"], named),
            "count": (("patch",), [3], named | {"sides": [1.0, 2.0]}),
            "ratio": ((), np.float32(1.5), named | {"file": "1_T0.plu"}),
            "gap": (("y",), [1.0, np.nan, 3.0], named),
            "none": (("i",), np.zeros(0), named),
        },
        {"patch": ["01"], "y": [0.5, 1.5, 2.5]},
    )
    kinds = kinds.assign_attrs(steps=10, title="t")
    path = tmp_path / "a.h5"
    write_dataset(path, kinds)
    expected, fields = xr.load_dataset(path, engine="h5netcdf"), read_dataset(path)
    xr.testing.assert_identical(expected, kinds)
    xr.testing.assert_identical(fields, kinds)
    assert dict(fields.dtypes) == dict(expected.dtypes)
    xr.testing.assert_identical(read_dataset(path, ["word"]), kinds[["word"]])


# --- Tables -------------------------------------------------------------------------------------


def test_table_digits_and_words(tmp_path):
    table = pd.DataFrame(
        {
            "patch": ["01", "2"],
            "value": [1 / 3, -0.0],
            "large": [123456.0, np.inf],
            "tiny": [1.23456789e-12, np.nan],
            "count": [3, 400000],
            "in_study": [True, False],
            "instrument": ["=1+1", "a=1"],  # of which spreadsheets find no formula
        }
    )
    write_table(tmp_path / "t.csv", table)
    assert (tmp_path / "t.csv").read_text() == (
        "patch,value,large,tiny,count,in_study,instrument\n"
        "01,0.33333,1.2346e+05,1.2346e-12,3,yes,'=1+1\n"
        "2,0,inf,,400000,no,a=1\n"
    )
    read = read_table(tmp_path / "t.csv", ["patch", "count"])
    assert list(read.patch) == ["01", "2"]
    assert read.in_study.tolist() == [True, False]
    lacking = {"read": read_table, "columns": ["patch", "pressure_MPa", "x_mm"]}
    refused(tmp_path / "t.csv", r"lacks pressure_MPa, x_mm\. Delete it", **lacking)


@pytest.mark.parametrize("content", [b"", b"a,b\n1,2\n3,4,5\n", b"\xff\xfe\x00"])
def test_unreadable_tables_are_named(write, content):
    refused(write("t.csv", content), "Delete it", read_table)


@given(st.integers(10_000, 99_999), st.sampled_from([0.3, 0.5, 0.6, 0.25, 1.5]))
def test_a_tie_is_printed_alike_whatever_its_last_bits(digits, factor):
    """0.3 times 35.885 is a tie; sums come to it from either side."""
    value = digits / 1000 * factor
    for side in (-1e-12, 1e-12):
        assert printed(value * (1 + side)) == printed(value)
