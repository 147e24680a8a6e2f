"""Files of a user in a folder of results stay as they are."""

import pytest
from folders import fill

from gst.run.chain import Step
from gst.run.owned import claim, claim_picture, claimed_by, refuse_foreign, written_by


def test_what_a_killed_run_left_is_the_study_s_own(tmp_path):
    """Of files that it listed before its first step. A new name in the list is checked again."""
    page, wear, late = (tmp_path / name for name in ("index.html", "wear", "late.csv"))
    steps = [Step("write_page", {}, [], [page, wear])]
    claim(written_by(steps, tmp_path), tmp_path)
    fill(wear, dict.fromkeys((page, "7.h5", late), ""))
    refuse_foreign(steps, tmp_path)
    for output in (late, late / "1"):  # a file in the place of the folder
        with pytest.raises(SystemExit, match="2"):
            refuse_foreign([*steps, Step("late", {}, [], [output])], tmp_path)


def test_the_picture_of_a_check_takes_no_file_s_place(tmp_path):
    picture = claim_picture(tmp_path)
    picture.write_text("first")
    assert claim_picture(tmp_path) == picture
    picture.unlink()
    picture.symlink_to(tmp_path / "mine")
    assert claim_picture(tmp_path) is None
    fill(tmp_path, {"other/check.png": "mine"})
    assert claim_picture(tmp_path / "other") is None


def test_no_list_of_claims_leads_elsewhere(tmp_path):
    fill(tmp_path, {"secret": "index.html", "results/index.html": ""})
    (tmp_path / "results/.gst_outputs").symlink_to(tmp_path / "secret")
    assert claimed_by(tmp_path / "results") == set()
