import fcntl
import time

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from gstlib.errors import InputError
from gstlib.io import store
from gstlib.io.store import Stored, read_dataset, write_dataset
from gstlib.io.tables import printed, read_table, write_table
from gstlib.surfaces.grid import make_surface
from hypothesis import given
from hypothesis import strategies as st


def dataset():
    heights = np.random.default_rng(1).normal(size=(64, 48))
    return make_surface(heights, (0.1, 0.2)).to_dataset(name="height")


def test_same_content_same_bytes_whenever_written(tmp_path):
    write_dataset(tmp_path / "a.h5", dataset())
    time.sleep(1.1)  # the clock's seconds move on
    write_dataset(tmp_path / "b.h5", dataset())
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


@pytest.mark.parametrize("name", ["units", "long_name"])
def test_units_and_long_names_are_required(tmp_path, name):
    bare = dataset()
    del bare.height.attrs[name]
    with pytest.raises(ValueError, match=f"'height' lacks {name}"):
        write_dataset(tmp_path / "a.h5", bare)
    assert list(tmp_path.iterdir()) == []


def test_a_field_of_repeated_values_is_stored_small_and_comes_back_exactly(tmp_path):
    """So that a face which is a flat, no surroundings, or a few points in contact cost no disk."""
    heights = dataset().height
    few = np.where(heights > np.quantile(heights, 0.995), heights, 0.0)
    for values in (np.zeros(heights.shape), np.full(heights.shape, 0.1), few):
        flat = heights.copy(data=values).to_dataset()
        write_dataset(tmp_path / "flat.h5", flat)
        xr.testing.assert_identical(read_dataset(tmp_path / "flat.h5"), flat)
        with h5py.File(tmp_path / "flat.h5") as file:
            assert file["height"].id.get_storage_size() < heights.nbytes / 50


def test_datasets_by_name_are_read_when_they_are_looked_up_and_only_then(tmp_path, monkeypatch):
    read, whole = [], store.read_dataset
    monkeypatch.setattr(store, "read_dataset", lambda *of: read.append(of[0].stem) or whole(*of))
    files = {patch: tmp_path / f"{patch}.h5" for patch in ("b", "a")}
    for file in files.values():
        write_dataset(file, dataset().assign(gap=dataset().height))
    stored = Stored(files, ["height"])
    assert (list(stored), len(stored), "a" in stored) == (["b", "a"], 2, True)
    assert read == []
    assert list(stored["a"]) == ["height"]
    assert read == ["a"]
    assert len(list(stored.values())) == 2
    assert read == ["a", "b", "a"]  # nothing is kept
    with pytest.raises(KeyError):
        stored["c"]


@pytest.mark.parametrize("content", [b"", b"not HDF5 at all", bytes(4000), None])
def test_unreadable_files_are_named(tmp_path, content):
    path = tmp_path / "a.h5"
    if content is None:  # cut off
        write_dataset(path, dataset())
        content = path.read_bytes()[: path.stat().st_size // 2]
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.h5.*Delete it"):
        read_dataset(path)


def test_a_file_that_cannot_be_opened_is_not_to_be_deleted(tmp_path):
    """It is whole: another program holds it, or it lies elsewhere."""
    path, missing = tmp_path / "a.h5", tmp_path / "b.h5"
    write_dataset(path, dataset())
    with path.open("rb+") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="HDF5_USE_FILE_LOCKING"):
            read_dataset(path)
    for read, file in ((read_dataset, missing), (read_table, missing), (read_dataset, tmp_path)):
        with pytest.raises(InputError) as refused:
            read(file)
        assert "Delete" not in refused.value.remedy


def test_a_flipped_bit_in_an_array_is_noticed(tmp_path):
    """In a large array, which is compressed, and in small ones, which are not."""
    path = tmp_path / "a.h5"
    write_dataset(path, dataset())
    whole = path.read_bytes()
    with h5py.File(path) as file:
        chunks = [
            variable.id.get_chunk_info(number)
            for variable in file.values()
            for number in range(variable.id.get_num_chunks())
        ]
    assert len(chunks) >= 3  # y, x, height
    for chunk in chunks:
        for at in (0, chunk.size // 2, chunk.size - 5):
            content = bytearray(whole)
            content[chunk.byte_offset + at] ^= 1
            flipped = tmp_path / f"{chunk.byte_offset + at}.h5"
            flipped.write_bytes(content)
            with pytest.raises(InputError, match=rf"{flipped.name}.*Delete it"):
                read_dataset(flipped)


def test_xarray_reads_what_was_written_and_it_is_read_as_xarray_does(tmp_path):
    """Masks, texts, counts, a dimension without coordinates, attributes of each kind."""
    named = {"units": "1", "long_name": "n"}
    kinds = xr.Dataset(
        {
            "mask": (("patch", "y"), [[True, False, True]], named),
            "word": (("k",), ["loss", "gain"], named),
            "count": (("patch",), [3], named | {"step": 0.5, "sides": [1.0, 2.0]}),
            "ratio": ((), np.float32(1.5), named | {"file": "1_T0.plu"}),
            "gap": (("y",), [1.0, np.nan, 3.0], named),
            "none": (("i",), np.zeros(0), named),
        },
        {"patch": ["01"], "y": ("y", [0.5, 1.5, 2.5], {"spacing": 1.0})},
    )
    attrs = {"steps": 10, "axis": [0.0, 0.0, 1.0], "title": "t"}
    write_dataset(tmp_path / "a.h5", kinds, attrs)
    kinds = kinds.assign_attrs(attrs)
    with xr.open_dataset(tmp_path / "a.h5", engine="h5netcdf") as opened:
        for only in (None, ["mask"], ["word", "ratio"], []):
            expected = opened.load() if only is None else opened[only].load()
            found = read_dataset(tmp_path / "a.h5", only)
            xr.testing.assert_identical(found, expected)
            xr.testing.assert_identical(found, kinds if only is None else kinds[only])
            assert dict(found.dtypes) == dict(expected.dtypes)
            assert list(found) == list(expected)


def test_table_digits_and_words(tmp_path):
    table = pd.DataFrame(
        {
            "patch": ["01", "2"],
            "value": [1 / 3, -0.0],
            "large": [123456.0, np.inf],
            "tiny": [1.23456789e-12, np.nan],
            "count": [3, 400000],
            "in_study": [True, False],
        }
    )
    write_table(tmp_path / "t.csv", table)
    assert (tmp_path / "t.csv").read_text() == (
        "patch,value,large,tiny,count,in_study\n"
        "01,0.33333,1.2346e+05,1.2346e-12,3,yes\n2,0,inf,,400000,no\n"
    )
    read = read_table(tmp_path / "t.csv")
    assert list(read.patch) == ["01", "2"]
    assert read.in_study.tolist() == [True, False]


def test_spreadsheets_find_no_formula(tmp_path):
    words = ["=1+1", "+a", "-a", "@a", "a=1"]
    write_table(tmp_path / "a.csv", pd.DataFrame({"instrument": words, "loss": -1.0}))
    assert list(read_table(tmp_path / "a.csv").instrument) == ["'=1+1", "'+a", "'-a", "'@a", "a=1"]
    assert (read_table(tmp_path / "a.csv").loss == -1).all()


@pytest.mark.parametrize("content", [b"", b"a,b\n1,2\n3,4,5\n", b"\xff\xfe\x00"])
def test_unreadable_tables_are_named(tmp_path, content):
    (tmp_path / "t.csv").write_bytes(content)
    with pytest.raises(InputError, match=r"t\.csv.*Delete it"):
        read_table(tmp_path / "t.csv")


def test_a_missing_column_is_named(tmp_path):
    write_table(tmp_path / "t.csv", pd.DataFrame({"patch": ["1"], "force_N": [2.0]}))
    assert len(read_table(tmp_path / "t.csv", ["patch", "force_N"])) == 1
    with pytest.raises(InputError, match=r"t\.csv: lacks pressure_MPa, x_mm\. Delete it"):
        read_table(tmp_path / "t.csv", ["patch", "pressure_MPa", "x_mm"])


@given(st.integers(10_000, 99_999), st.sampled_from([0.3, 0.5, 0.6, 0.25, 1.5]))
def test_a_tie_is_printed_alike_whatever_its_last_bits(digits, factor):
    """0.3 times 35.885 is a tie; sums come to it from either side."""
    value = digits / 1000 * factor
    assert printed(value * (1 - 1e-12)) == printed(value) == printed(value * (1 + 1e-12))
