"""Which patches share a job: each keeps its batch when others come or go."""

import pytest
from gst.run.batches import files_of, share_out
from hypothesis import given
from hypothesis import strategies as st

IDS = st.lists(st.text("0123456789ABEN", min_size=1), unique=True, min_size=1, max_size=80)


def batch_of(batches):
    return {patch: batch for batch, members in batches.items() for patch in members}


@given(ids=IDS, per_job=st.sampled_from([None, 1, 4, 20]))
def test_every_patch_is_in_one_batch_in_its_order(ids, per_job):
    batches = share_out(ids, per_job)
    assert sorted(patch for members in batches.values() for patch in members) == sorted(ids)
    for members in batches.values():
        assert members
        assert members == sorted(members, key=ids.index)


@pytest.mark.parametrize("count", [5, 16, 25, 51, 400])
def test_a_patch_that_comes_or_goes_moves_no_other(count):
    ids = [str(number) for number in range(1, count + 1)]
    before = batch_of(share_out(ids))
    assert batch_of(share_out([*ids, "new"])) | before == batch_of(share_out([*ids, "new"]))
    assert batch_of(share_out(ids[1:])).items() <= before.items()


@pytest.mark.parametrize(
    ("count", "batches"), [(1, 1), (13, 1), (14, 2), (25, 2), (50, 4), (320, 16), (2500, 16)]
)
def test_batches_are_few_and_reasonably_even(count, batches):
    sizes = [len(members) for members in share_out([str(n + 1) for n in range(count)]).values()]
    assert len(sizes) == batches
    assert max(sizes) <= 1.5 * count / batches


def test_a_file_is_found_by_its_patch_and_no_other_is_taken_for_it(tmp_path):
    files = {"7": "change/1/7.h5", "E1": "surfaces/T0/2/E1_T0.h5", "8": "surfaces/T0/2/8_T0.h5"}
    files = {patch: tmp_path / name for patch, name in files.items()}
    others = (
        "change/1/7_T0.h5",
        "change/1/7 (copy).h5",
        "surfaces/T0/2/E1.h5",
        "surfaces/T0/2/E1_T1.h5",
    )
    for file in [*files.values(), *(tmp_path / name for name in others)]:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    folders = [files["7"].parent, files["8"].parent]
    assert list(files_of(folders, ["E1", "7", "gone"]).items()) == [
        ("E1", files["E1"]),
        ("7", files["7"]),
    ]
    assert files_of(folders[0], ["7", "8"]) == {"7": files["7"]}
