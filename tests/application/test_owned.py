"""Whose files lie in a folder of results, in folders made at random to mislead."""

import json
import os
import random
from contextlib import suppress

import pytest
import yaml

import gst
from gst.run.chain import Step
from gst.run.owned import (
    claim,
    claim_picture,
    claimed_by,
    refuse_foreign,
    removable,
    written_by,
)
from gst.run.running import remove_results

NAMES = [
    "figures",
    "tables",
    "logs",
    "wear",
    "1",
    "7.h5",
    "a.csv",
    "index.html",
    "note.txt",
]
NAMES += [".7.h5.12.part", ".a.csv.part", "write_page.json", ".snakemake_timestamp"]


def contents(folder):
    """What each file and link in a folder holds, by path."""
    paths = [path for path in folder.rglob("*") if path.is_symlink() or path.is_file()]
    return {
        path: os.readlink(path) if path.is_symlink() else path.read_bytes()
        for path in paths
    }


def plant(results, choose):
    """Files, folders and links at random, some of which point out of the results."""
    outside = results.parent / "outside"
    for number in range(choose.randrange(5, 25)):
        path = results.joinpath(*choose.choices(NAMES, k=choose.randrange(1, 4)))
        with suppress(OSError):  # a file lies where a folder would
            path.parent.mkdir(parents=True, exist_ok=True)
            if choose.random() < 0.2:
                path.symlink_to(
                    choose.choice([outside, outside / "7.h5", results / "figures"])
                )
            else:
                path.write_text(f"foreign {number}")


HOSTILE = "../outside/7.h5", ".", "", "a\0b", "figures"


def record(results, choose):
    """Records of steps that name some of what is there; the files that they may name."""
    there = [path for path in contents(results) if path.parent.name != "logs"]
    named = set()
    for step in range(choose.randrange(3)):
        names = choose.sample(
            [path.relative_to(results).as_posix() for path in there], 2
        )
        # a record that names something elsewhere counts for nothing but itself
        outputs = dict.fromkeys(
            [*names, *choose.choice([(), (), [choose.choice(HOSTILE)]])], "a1"
        )
        file = results / f"logs/step{step}.json"
        with suppress(OSError):
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps({"outputs": outputs}))
            named |= {file, *(results / name for name in {*outputs} - {*HOSTILE[:-1]})}
    return named


@pytest.mark.parametrize("seed", range(20))
def test_clean_and_a_refused_run_lose_nothing_that_no_record_names(
    seed, tmp_path, monkeypatch
):
    choose = random.Random(seed)
    monkeypatch.chdir(tmp_path)
    results, outside = tmp_path / "paper", tmp_path / "outside"
    for folder in (results, outside):
        folder.mkdir()
        (folder / "7.h5").write_text(folder.name)
    config = tmp_path / "study.yaml"
    table = str(gst.ROOT / "config/patches.tsv")
    config.write_text(yaml.safe_dump({"results": "paper", "patches": table}))
    plant(results, choose)
    before = contents(tmp_path)
    step = Step(
        "write_page", {}, [], [results / name for name in ("index.html", "wear/1")]
    )
    if any(os.path.lexists(path) for path in step.outputs if not path.is_dir()):
        with pytest.raises(SystemExit):
            refuse_foreign([step], results)
    assert contents(tmp_path) == before
    named = record(results, choose)
    before = contents(tmp_path)
    monkeypatch.setattr("builtins.input", lambda _: "y")
    remove_results(config)
    after = contents(tmp_path)
    gone = before.keys() - after.keys()
    assert {path: before[path] for path in before if path not in gone} == after
    assert {path for path in named if path.is_file() and path.resolve() == path} <= gone
    for path in gone - named:
        assert path.name.endswith(".part")
        assert path.parent in {each.parent for each in named}


def test_what_a_killed_run_left_is_the_study_s_own(tmp_path):
    """Of files that it listed before its first step. A new name in the list is checked again."""
    page, depth, late = (
        tmp_path / name for name in ("index.html", "wear/7.h5", "late.csv")
    )
    steps = [
        Step("write_page", {}, [], [page]),
        Step("predict", {}, [], [depth.parent]),
    ]
    claim(written_by(steps, tmp_path), tmp_path)
    depth.parent.mkdir()
    for file in (page, depth, late):
        file.write_text("")
    refuse_foreign(steps, tmp_path)
    with pytest.raises(SystemExit) as ended:
        refuse_foreign([*steps, Step("late", {}, [], [late])], tmp_path)
    assert ended.value.code == 2


def test_the_picture_of_a_check_takes_no_file_s_place(tmp_path):
    picture = claim_picture(tmp_path)
    picture.write_text("first")
    assert claim_picture(tmp_path) == picture
    picture.unlink()
    picture.symlink_to(tmp_path / "mine")
    assert claim_picture(tmp_path) is None
    (tmp_path / "other").mkdir()
    (tmp_path / "other/check.png").write_text("mine")
    assert claim_picture(tmp_path / "other") is None


def test_no_list_of_claims_leads_elsewhere(tmp_path):
    (tmp_path / "secret").write_text("index.html")
    (tmp_path / "results").mkdir()
    claims = tmp_path / "results/.gst_outputs"
    claims.symlink_to(tmp_path / "secret")
    assert claimed_by(tmp_path / "results") == set()


def test_links_are_neither_removed_nor_followed(tmp_path):
    """A record that somebody else wrote may name files beyond a link."""
    results, outside = tmp_path / "results", tmp_path / "outside"
    record = results / "logs/step.json"
    record.parent.mkdir(parents=True)
    outside.mkdir()
    (outside / "wear.csv").write_text("private")
    (results / "tables").symlink_to(outside)
    (results / "wear.csv").symlink_to(outside / "wear.csv")
    outputs = dict.fromkeys(["tables/wear.csv", "wear.csv"], 64 * "0")
    record.write_text(json.dumps({"outputs": outputs}))
    assert removable(results) == [record]
