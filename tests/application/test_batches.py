"""Which patches share a job: each keeps its batch when others come or go."""

import pytest
from folders import fill
from hypothesis import given
from hypothesis import strategies as st

from gst.run.batches import share_out
from gst.run.stored import files_of

IDS = st.lists(
    st.text("0123456789ABEN", min_size=1), unique=True, min_size=1, max_size=80
)


def batch_of(batches):
    return {patch: batch for batch, members in batches.items() for patch in members}


@given(ids=IDS, per_job=st.sampled_from([None, 1, 4, 20]))
def test_every_patch_is_in_one_batch_in_its_order(ids, per_job):
    batches = share_out(ids, per_job)
    assert sorted(batch_of(batches)) == sorted(ids)
    for members in batches.values():
        assert members
        assert members == sorted(members, key=ids.index)


@pytest.mark.parametrize("count", [5, 16, 51])
def test_a_patch_that_comes_or_goes_moves_no_other(count):
    """Only where the number of batches changes."""
    ids = [str(number) for number in range(1, count + 1)]
    fewer, before, more = (
        batch_of(share_out(each)).items() for each in (ids[1:], ids, [*ids, "new"])
    )
    assert fewer <= before <= more


def test_a_file_is_found_by_its_patch_and_no_other_is_taken_for_it(tmp_path):
    files = {"E1": "T0/2/E1_T0.h5", "7": "change/1/7.h5"}
    others = ["change/1/7_T0.h5", "T0/2/7.h5", "T0/2/E1_T1.h5"]
    fill(tmp_path, dict.fromkeys([*files.values(), *others], ""))
    folders = [tmp_path / "change/1", tmp_path / "T0/2"]
    found = files_of(folders, ["E1", "7", "8"])
    assert [*found.items()] == [(name, tmp_path / each) for name, each in files.items()]
