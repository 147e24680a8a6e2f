import time

import h5py
import numpy as np
import pandas as pd
import pytest

from gstlib.errors import InputError
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.surface import make_surface


def dataset():
    heights = np.random.default_rng(1).normal(size=(64, 48))
    return make_surface(heights, (0.1, 0.2)).to_dataset(name="height")


def test_round_trip(tmp_path):
    write_dataset(tmp_path / "a.h5", dataset(), {"target_pressure_MPa": 22.0})
    read = read_dataset(tmp_path / "a.h5")
    assert read.height.equals(dataset().height)
    assert read.attrs["target_pressure_MPa"] == 22.0
    assert read.y.attrs["spacing"] == 0.1


def test_same_content_same_bytes_whenever_written(tmp_path):
    write_dataset(tmp_path / "a.h5", dataset())
    time.sleep(1.1)  # the clock's seconds move on
    write_dataset(tmp_path / "b.h5", dataset())
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_h5py_sees_names_and_units(tmp_path):
    write_dataset(tmp_path / "a.h5", dataset())
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["height"].shape == (64, 48)
        assert file["height"].attrs["units"] == "mm"
        assert file["height"].dims[0][0].name == "/y"


def test_units_are_required(tmp_path):
    bare = dataset()
    del bare.height.attrs["units"]
    with pytest.raises(ValueError, match="'height' lacks units"):
        write_dataset(tmp_path / "a.h5", bare)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    write_dataset(tmp_path / "a.h5", dataset())
    before = (tmp_path / "a.h5").read_bytes()
    monkeypatch.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        write_dataset(tmp_path / "a.h5", dataset() * 2, {})
    assert [file.name for file in tmp_path.iterdir()] == ["a.h5"]
    assert (tmp_path / "a.h5").read_bytes() == before


@pytest.mark.parametrize("content", [b"", b"not HDF5 at all"])
def test_unreadable_files_are_named(tmp_path, content):
    (tmp_path / "a.h5").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.h5.*Delete it"):
        read_dataset(tmp_path / "a.h5")


def test_table_digits_and_words(tmp_path):
    table = pd.DataFrame(
        {
            "patch": ["01", "2"],
            "value": [1 / 3, -0.0],
            "tiny": [1.23456789e-12, np.nan],
            "count": [3, 400000],
            "in_study": [True, False],
        }
    )
    write_table(tmp_path / "t.csv", table)
    assert (tmp_path / "t.csv").read_text() == (
        "patch,value,tiny,count,in_study\n01,0.33333,1.2346e-12,3,yes\n2,0,,400000,no\n"
    )
    read = read_table(tmp_path / "t.csv")
    assert list(read.patch) == ["01", "2"]
    assert read.in_study.tolist() == [True, False]
