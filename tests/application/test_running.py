"""What surrounds a run: a study is laid out, refused, ended."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest
from folders import fill
from shell import command

import gst
from gst.run import running
from gst.run.logs import PLAN
from gst.run.owned import LOCK, NO_RUN, RESULTS, locked
from gst.run.running import lay_out
from gst.run.scheduler import end
from gstlib.errors import InputError


def test_a_study_is_laid_out_once_and_like_a_shipped_one(tmp_path):
    made = lay_out(tmp_path, "m12")
    names = ["README.md", "m12.yaml", "patches_m12.tsv", "published_m12.csv"]
    assert sorted(file.name for file in made) == names
    for file in made:
        assert file.read_bytes() == (gst.ROOT / file.relative_to(tmp_path)).read_bytes()
    made[1].unlink()
    made[2].write_text("of mine")
    with pytest.raises(InputError, match=r"patches_m12\.tsv"):
        lay_out(tmp_path, "m12")
    assert not made[1].exists()


CONFIGS = {
    "mine.yaml": "title: mine\n",
    "bad.yaml": "results: 5\n",
    "table.yaml": "patches: table.tsv\n",
    "table.tsv": "patch\n5\n",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with the shipped configs and some that cannot be used."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(gst.ROOT / "config", tmp_path / "config")
    fill(tmp_path, CONFIGS)
    return tmp_path


@pytest.fixture
def asked(monkeypatch):
    """What Snakemake is asked, in place of running it: words and options."""
    asked = []
    monkeypatch.setattr(
        running, "_snakemake", lambda *words, **how: asked.append((words, how))
    )
    return asked


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ("mine.yaml --profile mine", "no folder"),
        ("mine.yaml --profile slurm", "no sbatch on this machine"),
        ("mine.yaml --config=a", "--config=a would make"),
        ("mine.yaml --cores 0", "0 cores run no step"),
        ("mine.yaml -c 0", "0 cores run no step"),
        ("mine.yaml -n --jobs=0", "0 cores run no step"),
        ("mine.yaml -d/tmp", "-d/tmp would make"),
        ("mine.yaml --trust-io", "--trust-io would make"),
        ("bad.yaml", "'results' is 5"),
        ("table.yaml --plan", "table.tsv: missing columns ['x_mm'"),
    ],
)
def test_a_study_that_cannot_begin_leaves_nothing(folder, words, problem, monkeypatch):
    monkeypatch.setattr("gst.run.running.shutil.which", lambda _: None)
    assert problem in command(f"study {words}").stderr
    assert {file.name for file in folder.iterdir()} == {"config", *CONFIGS}


def test_the_end_of_a_run_waits_for_no_lock_that_it_interrupted():
    """Snakemake's own handler of SIGTERM does, in the thread that may hold the lock."""
    asked = threading.Event()
    scheduler = SimpleNamespace(
        _lock=threading.Lock(), _open_jobs=SimpleNamespace(release=asked.set)
    )
    with scheduler._lock:
        end(scheduler, signal.SIGTERM, None)
        assert not asked.is_set()
    assert asked.wait(60)
    assert scheduler._user_kill == "graceful"


def test_the_folder_of_a_study_is_on_no_path_of_modules(monkeypatch):
    """An entry without a name would put it on that of the processes that are started."""
    started = {}

    def popen(_words, **options):
        started.update(options["env"])
        return nullcontext(SimpleNamespace(returncode=0, terminate=None))

    monkeypatch.setattr(subprocess, "Popen", popen)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([":", "/source"]))
    running._snakemake(environment={})
    assert started["PYTHONPATH"] == "/source"
    assert started["PYTHONSAFEPATH"] == "1"


def test_one_run_at_a_time_writes_into_a_folder(folder):
    results = folder / "results"
    results.mkdir()
    with subprocess.Popen(["true"]) as dead:
        pass
    here = socket.gethostname()
    holders = {
        f"{dead.pid}\n{here}\n": None,
        "12\nelsewhere\n": "started on elsewhere may still be at work",
        f"{os.getpid()}\n{here}\n": f"kill {os.getpid()}",
    }
    for holder, refusal in holders.items():
        (results / LOCK).write_text(holder)
        refused = pytest.raises(InputError, match=refusal) if refusal else nullcontext()
        with refused, locked(results):
            pass
        assert (results / LOCK).exists() == bool(refusal)
    (results / LOCK).unlink()
    around = os.environ | {RESULTS: str(results.resolve())}
    with subprocess.Popen(["cat"], stdin=subprocess.PIPE, env=around) as job:
        assert f"kill {job.pid}" in command("study mine.yaml").stderr
        job.communicate()


@pytest.mark.usefixtures("asked")
def test_the_page_is_named_from_where_the_user_stands(folder, monkeypatch):
    for each in ("break_in", "other_files"):
        monkeypatch.setattr(running, each, lambda *_: None)
    (folder / "mine.yaml").rename(folder / "study.yaml")
    for start, page in ((folder, "results"), (folder.parent, f"{folder.name}/results")):
        monkeypatch.chdir(start)
        assert f"Open {page}/index.html in" in command("study", folder).stdout


def test_a_profile_is_named_from_where_the_user_stands(folder, monkeypatch, asked):
    """The study is in a folder that `gst new` made; an editor has marked its encoding."""
    study, here = folder / "study.yaml", folder / "home"
    study.write_text("\ufeff# Made by `gst new`\ntitle: mine\n")
    shutil.copytree(gst.ROOT / "profiles/default", here / "profiles/mine")
    monkeypatch.chdir(here)
    command("study ../study.yaml --plan --profile ./profiles/mine")
    assert here / "profiles/mine" in asked[0][0]
    assert Path.cwd() == folder


@pytest.mark.parametrize("option", ["-n", "-np", "-nq", "-pn", "--dry", "--dryrun"])
@pytest.mark.usefixtures("folder")
def test_a_dry_run_of_snakemake_is_a_plan(option, asked):
    assert "Done" not in command(f"study mine.yaml {option}").stdout
    assert asked[0][1] == {"environment": {PLAN: "1"}}


@pytest.mark.parametrize(
    ("options", "code"),
    [("--summary", NO_RUN), ("--touch", NO_RUN), ("", 0), ("gone.txt", 1)],
)
def test_what_is_asked_for_beside_a_run_is_not_called_done(
    folder, monkeypatch, options, code
):
    (folder / "Snakefile").write_text("rule all:\n    output: touch('a.txt')\n")
    (folder / "a.txt").touch()
    words = f"{sys.executable} -m gst.run.scheduler --cores 1 {options}"
    around = os.environ | {RESULTS: "results"}
    assert subprocess.call(words.split(), env=around) == code
    monkeypatch.setattr(running, "_snakemake", lambda *_, **__: NO_RUN)
    done = command("study mine.yaml")
    assert (done.exit_code, done.stdout) == (0, "")


@pytest.mark.parametrize("name", [".snakemake", ".snakemake/log"])
def test_snakemake_writes_through_no_link(folder, name):
    (folder / "elsewhere").mkdir()
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).symlink_to(folder / "elsewhere")
    assert "is a link" in command("study mine.yaml").stderr
    assert not any((folder / "elsewhere").iterdir())
