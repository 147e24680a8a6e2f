"""A command that cannot do what it is asked for says so in a line, with exit code 2."""

import os

import gst
import pytest
from click.testing import CliRunner
from gst.cli import main

LONG = "a" * 300
TOO_LONG = "File name too long"


def run(*arguments, said=""):
    return CliRunner().invoke(main, arguments, input=said)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["new", LONG], TOO_LONG),
        (["new", "here", "--like", "mine"], "'mine' is not one of"),
        (["check", "gone.yaml"], "gone.yaml: cannot be opened"),
        (["study", "gone.yaml"], "gone.yaml: cannot be opened"),
        (["clean", "gone.yaml"], "gone.yaml: cannot be opened"),
        (["clean", "full.yaml"], "Broken off"),
        (["inspect", LONG], TOO_LONG),
        (["inspect", "gone.plu"], "gone.plu: no such file"),
        (["inspect", "gone.txt", "--spacing-um", "0"], "not in the range"),
        (["inspect", b"a\xff.plu"], "no such file"),
        (["pick", LONG], TOO_LONG),
        (["diff", "full", "gone"], "gone: has no tables"),
        (["diff", "full", "full", "--tolerance", "-1"], "not in the range"),
        (["export", "full"], "holds no finished study"),
        (["package", "full"], "no finished study"),
        (["nothing"], "No such command"),
        ([], "Usage:"),
    ],
)
def test_what_cannot_be_done(tmp_path, monkeypatch, arguments, said):
    patches = gst.ROOT / "config/patches_tiny.tsv"
    (tmp_path / "full.yaml").write_text(f"results: full\npatches: {patches}\n")
    (tmp_path / "full/tables").mkdir(parents=True)
    (tmp_path / "full/tables/a.csv").write_text("patch,x\n1,2\n")
    monkeypatch.chdir(tmp_path)
    result = run(*map(os.fsdecode, arguments))
    assert result.exit_code == 2
    assert said in result.stderr
    assert (tmp_path / "full/tables/a.csv").exists()
