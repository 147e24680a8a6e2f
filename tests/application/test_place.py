"""The server of `gst place`: whom it answers, what it writes, and what it shows."""

import http.client
import io
import json
import os
import signal
import stat
import subprocess
import sys
import threading
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh
import yaml
from click.testing import CliRunner
from gst.check.matching import Match
from gst.cli import main
from gst.config.reading import read_config
from gst.run.chain import PAGE, Step, given_to, write_record
from gst.setup.place import PlaceServer
from gst.setup.place_matching import Found, _laid_alike, seen_in
from gst.setup.place_scans import picture_of
from gst.setup.place_state import digest_of
from gstlib.errors import InputError
from gstlib.io.plu import write_plu
from gstlib.surfaces.footprints import PatchPosition, outline
from gstlib.surfaces.frames import Frame
from matplotlib.image import imread
from scan_files import write_plu_at
from scipy.ndimage import gaussian_filter
from stones import TURN, rough_stone, taken

SPACING = 0.0133  # mm
POINTS = 64
SIZE = SPACING * POINTS
CONFIG = f"""\
# mine
title: a stone
results: results
patches: patches.tsv
inputs: {{mesh: stone.ply, mesh_unit: mm, scan_folder: scans}}
square:
  size_mm: 5.0
  points_mm: TODO
load: {{force_N: 550}}  # the paper's
scans:
  size_mm: {SIZE:.4f}
  mould: {{invert: false, flip: null}}
"""
TABLE = "# by hand\npatch\tnote\tx_mm\ty_mm\tt0\nA\tdull\tTODO\tTODO\ta.plu\nB\t\t1,5\t2\tb.plu\n"
POINTS_MM = [[0, 0, 10], [5, 0, 10], [0, 5, 10]]


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study in the working folder, beside a file that is none of its own."""
    folder = tmp_path / "study"
    (folder / "scans").mkdir(parents=True)
    (folder / "results").mkdir()
    (tmp_path / "secret").write_text("secret")
    (folder / "results/index.html").write_text("<title>result</title>")
    (folder / "results/link").symlink_to(tmp_path / "secret")
    (folder / "study.yaml").write_text(CONFIG)
    (folder / "patches.tsv").write_text(TABLE)
    trimesh.creation.icosphere(subdivisions=2, radius=10.0).export(folder / "stone.ply")
    ground = 0.02 * gaussian_filter(np.random.default_rng(1).normal(size=(POINTS, POINTS)), 2)
    for name in ("a", "b"):
        write_plu(folder / f"scans/{name}.plu", ground, SPACING)
    monkeypatch.chdir(folder)
    return folder


@contextmanager
def served():
    with PlaceServer(Path("study.yaml")) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def server(study):
    with served() as server:
        yield server


def ask(server, path, sent=None, method=None, token=None, **headers):
    """The status of an answer, and its content."""
    link = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=600)
    body = sent if sent is None or isinstance(sent, str) else json.dumps(sent)
    given = {"Content-Type": "application/json"} if sent is not None else {}
    given |= {name.replace("_", "-"): value for name, value in headers.items()}
    place = f"/{server.token if token is None else token}/{path}"
    link.request(method or ("GET" if sent is None else "POST"), place, body, given)
    answer = link.getresponse()
    content = answer.read()
    link.close()
    is_json = answer.headers["Content-Type"] == "application/json"
    return answer.status, json.loads(content) if is_json else content


def save(server, path, sent, digest=None):
    """The answer to a page that shows the files as they are, or those of a former digest."""
    digest = digest_of(server.config) if digest is None else digest
    return ask(server, path, sent, Study_Digest=digest)


def saved(server, path, sent):
    """The answer to what is saved."""
    status, answer = save(server, path, sent)
    assert status == 200
    return answer


def configure(old, new):
    """Write the config with a part replaced."""
    Path("study.yaml").write_text(CONFIG.replace(old, new))


def written():
    """The config as it is on the disk."""
    return yaml.safe_load(Path("study.yaml").read_text())


def row(patch, x, y, turn=0, grade=None):
    columns = ("patch", "x_mm", "y_mm", "rotation_deg", "wear_grade")
    return dict(zip(columns, (patch, x, y, turn, grade), strict=True))


def places(*rows, points=None, size=5.0):
    return {"square": {"points_mm": points, "size_mm": size}, "patches": rows}


BOTH = row("A", 1, 1), row("B", 2, 2)
REFUSED = {
    "no token": ("state", None, {"token": ""}, 403),
    "another token": ("state", None, {"token": "x" * 32}, 403),
    "a foreign name": ("state", None, {"Host": "evil.example"}, 403),
    "a foreign page": ("state", None, {"Origin": "http://evil.example"}, 403),
    "a foreign page that writes": ("answers", {}, {"Origin": "null"}, 403),
    "an unknown route": ("files", None, {}, 404),
    "a route with another method": ("answers", None, {}, 404),
    "a way up": ("results/../study.yaml", None, {}, 403),
    "a hidden way up": ("results/%2e%2e/%2e%2e/secret", None, {}, 403),
    "a folder beside it that begins like it": ("results/../results-old/a", None, {}, 403),
    "a link that leads out": ("results/link", None, {}, 403),
    "a NUL": ("results/a%00", None, {}, 404),
    "a NUL in a value": ("answers", {"scans.unit": "\0"}, {}, 422),
    "a scan by its path": ("scan/../../secret", None, {}, 404),
    "a scan beyond the table": ("scan/2", None, {}, 422),
    "a command of another name": ("start/clean", {}, {}, 404),
    "a form": ("answers", "a=1", {"Content_Type": "text/plain"}, 415),
    "an upload": ("answers", {}, {"Content_Length": "3000000"}, 413),
    "JSON without end": ("answers", "[" * 100_000, {}, 400),
    "a key that names a file": ("answers", {"inputs.mesh": "/etc/passwd"}, {}, 400),
    "a value that cannot be meant": ("answers", {"load.force_N": -1}, {}, 422),
    "no number": ("answers", '{"load.force_N": NaN}', {}, 400),
    "too large a number": ("answers", '{"load.force_N": 1e999}', {}, 422),
    "places without a square": ("places", {"patches": []}, {}, 400),
    "a place that is text": ("places", places(row("A", "1", 1)), {}, 400),
    "two points": ("places", places(*BOTH, points=POINTS_MM[:2]), {}, 422),
    "a patch less": ("places", places(BOTH[0]), {}, 422),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(server, study, case):
    path, sent, options, expected = REFUSED[case]
    digest = digest_of(server.config)
    status, content = ask(server, path, sent, **options, Study_Digest=digest)
    assert status == expected
    assert set(content) == {"error"}
    assert "secret" not in content["error"].replace(str(study.parent), "")
    assert (study / "study.yaml").read_text() == CONFIG
    assert (study / "patches.tsv").read_text() == TABLE
    assert sorted(path.name for path in study.iterdir()) == [
        *(".snakemake", "patches.tsv", "results", "scans", "stone.ply", "study.yaml")
    ]


def test_scans_and_results_outside_their_folders_are_refused(server, study):
    (study / "scans/c.plu").symlink_to(study.parent / "secret")
    (study / "patches.tsv").write_text(TABLE.replace("b.plu", "c.plu"))
    status, content = ask(server, "scan/1")
    assert status == 422
    assert "lies outside" in content["error"]
    configure("results: results", "results: ..")
    assert ask(server, "results/secret")[0] == 403


def test_its_files_are_answered_and_ask_for_nothing_else(server):
    for name in ("", "place.js", "place.css", "page.css", "viewer.js", "square.js", "three.js"):
        status, content = ask(server, name)
        assert status == 200
        if name != "three.js":
            assert b"http://" not in content.replace(b"http://www.w3.org/2000/svg", b"")
    assert ask(server, "results/index.html") == (200, b"<title>result</title>")
    assert ask(server, "stone")[1]["bounds"] == [[-10] * 3, [10] * 3]
    said = {"records": [], "running": False, "code": None, "changed": False}
    assert ask(server, "said/study")[1] == said


def test_places_are_written_and_the_rest_stays(server, study):
    state = ask(server, "state")[1]
    assert state["square"] == {"points_mm": None, "size_mm": 5.0}
    assert state["patch_size_mm"] == pytest.approx(SIZE, abs=1e-4)
    assert state["patches"] == [row("A", None, None), row("B", 1.5, 2.0)]
    sent = places(row("A", 1.23456, 0, -7.5), row("B", 1.5, None), points=POINTS_MM)
    saved(server, "places", sent)
    text = (study / "study.yaml").read_text()
    assert text == CONFIG.replace("TODO", str(POINTS_MM))
    assert (study / "patches.tsv").read_text() == (
        "# by hand\npatch\tnote\tx_mm\ty_mm\tt0\trotation_deg\n"
        "A\tdull\t1,235\t0\ta.plu\t-7,5\nB\t\t1,5\tTODO\tb.plu\t0\n"
    )
    # undone, also the turn
    saved(server, "places", places(*state["patches"]))
    assert (study / "study.yaml").read_text() == CONFIG
    assert ask(server, "state")[1] == state | {"digest": digest_of(server.config)}


def test_answers_are_written_and_comments_stay(server, study):
    unknown = {"counterface.radius_mm": 274, "uncertainty.radius_log_sd": 0.98}
    more = {"load.at_mm": [1.5, 2]}, {"material.contact_modulus_MPa": None}
    for sent in ({"load.force_N": 30}, unknown, {"scans.mould.flip": "x"}, *more):
        digest = ask(server, "state")[1]["digest"]
        status, answer = save(server, "answers", sent, digest)
        assert (status, answer["kept"]) == (200, None)
        assert answer["digest"] == digest_of(server.config) != digest
        assert sent.items() <= ask(server, "state")[1]["answers"].items()
    text = (study / "study.yaml").read_text()
    assert "load: {force_N: 30, at_mm: [1.5, 2]}  # the paper's" in text
    assert yaml.safe_load(text)["counterface"] == {"radius_mm": 274}


def test_a_force_takes_the_place_of_a_pressure(server, study):
    configure("force_N: 550", "pressure_MPa: 22")
    saved(server, "answers", {"load.force_N": 100})
    assert written()["load"] == {"pressure_MPa": None, "force_N": 100}


def test_places_of_a_tool_without_scans_make_a_table(server, study):
    (study / "patches.tsv").unlink()
    configure("patches.tsv", "null")
    saved(server, "places", places(row("1", 1, 2, grade=0), row("2", 3, 4)))
    table = pd.read_csv("patches.csv", sep=";", dtype=str, keep_default_na=False)
    assert table.to_numpy().tolist() == [["1", "1", "2", "0"], ["2", "3", "4", ""]]
    assert written()["patches"] == "patches.csv"
    sent = places(row("2", 3, 4, grade=3), row("7", 1, 1, grade=1))
    saved(server, "places", sent)
    assert ask(server, "state")[1]["patches"] == list(sent["patches"])
    saved(server, "places", places())
    assert not Path("patches.csv").exists()
    assert ask(server, "state")[1]["patches"] == []


def test_a_scan_that_is_asked_for_is_named(server, study):
    (study / "patches.tsv").write_text(TABLE.replace("\tb.plu", "\tTODO b.plu"))
    state = ask(server, "state")[1]
    assert state["asked"] == [{"patch": "B", "column": "t0", "likely": "b.plu"}]
    assert state["files"] == ["a.plu", "b.plu"]
    named = {"patch": "B", "column": "t0", "name": "b.plu"}
    for other in ({"patch": "A"}, {"column": "note"}, {"name": "../../secret"}, {"name": "c.plu"}):
        assert save(server, "file", named | other)[0] == 422
    saved(server, "file", named)
    assert (study / "patches.tsv").read_text() == TABLE
    assert ask(server, "state")[1]["asked"] == []


GRADED = "patch;x_mm;y_mm;wear_grade;note\n1;1;2;0;dull\n2;3;4;;\n"


@pytest.fixture
def graded(study):
    """The study as one of a tool without scans, whose wear was graded by hand."""
    config = CONFIG.replace("patches.tsv", "patches.csv").replace(", scan_folder: scans", "")
    (study / "study.yaml").write_text(config)
    (study / "patches.tsv").unlink()
    (study / "patches.csv").write_text(GRADED)
    return study


def files_in(folder):
    """The content of every file in a folder, except hidden ones; the target of a link."""
    return {
        path.name: os.readlink(path) if path.is_symlink() else path.read_bytes()
        for path in folder.iterdir()
        if path.name[0] != "." and not path.is_dir()
    }


EDITS = {
    "the config": lambda: Path("study.yaml").write_text(CONFIG + "# edited\n"),
    "a config that is damaged": lambda: Path("study.yaml").write_text("{"),
    "no config": lambda: Path("study.yaml").unlink(),
    "the table": lambda: Path("patches.tsv").write_text(TABLE.replace("dull", "bright")),
    "no table": lambda: Path("patches.tsv").unlink(),
}
SAVES = {
    "answers": {"load.force_N": 100},
    "answers/again": {"load.force_N": 100},
    "places": places(*BOTH),
    "file": {"patch": "B", "column": "t0", "name": "a.plu"},
    "start/fix": {},
}


@pytest.mark.parametrize("edited", EDITS)
def test_a_page_of_former_files_changes_nothing(server, study, edited):
    digest = ask(server, "state")[1]["digest"]
    EDITS[edited]()
    before = files_in(study)
    for path, sent in SAVES.items():
        status, content = save(server, path, sent, digest)
        assert status == 409
        assert "reload" in content["error"]
        assert ask(server, path, sent)[0] == 409  # a page that knows no digest
    assert files_in(study) == before
    assert not any(Path(".snakemake").glob("place_*"))


def test_one_of_many_saves_at_once_is_written(server):
    digest, forces = ask(server, "state")[1]["digest"], range(1, 25)
    with ThreadPoolExecutor(8) as threads:
        saves = (
            threads.submit(save, server, "answers", {"load.force_N": force}, digest)
            for force in forces
        )
        statuses = [one.result()[0] for one in [*saves]]
    assert sorted(statuses) == [200] + [409] * 23
    assert written()["load"]["force_N"] == forces[statuses.index(200)]


def test_nothing_is_saved_while_cures_are_written(server, study, monkeypatch):
    monkeypatch.setattr(server.commands["fix"], "is_running", lambda: True)
    assert save(server, "answers", {"load.force_N": 100})[0] == 409
    assert (study / "study.yaml").read_text() == CONFIG


@pytest.mark.parametrize(
    "left", [(), (row("2", 3, 4),), (row("1", 1, 2), row("2", 3, 4)), (row("7", 1, 2, grade=0),)]
)
def test_a_table_is_kept_before_a_part_of_it_is_removed(server, graded, left):
    (graded / "patches.csv.bak").write_text("mine")
    (graded / "patches.csv.bak2").symlink_to(graded / "none")
    os.chmod(graded / "patches.csv", 0o600)
    assert saved(server, "places", places(*left))["kept"] == "patches.csv.bak3"
    kept = graded / "patches.csv.bak3"
    assert kept.read_text() == GRADED
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600
    assert (graded / "patches.csv.bak").read_text() == "mine"
    assert not (graded / "none").exists()
    assert (graded / "patches.csv").exists() == bool(left)


def test_files_that_are_links_are_not_changed(server, study):
    target = study.parent / "secret"
    for name, text in (("study.yaml", CONFIG), ("patches.tsv", TABLE)):
        target.write_text(text)
        file = study / name
        file.unlink()
        file.symlink_to(target)
        for path in ("answers", "places"):
            assert save(server, path, SAVES[path])[0] == 422
        assert target.read_text() == text
        assert file.is_symlink()
        file.unlink()
        file.write_text(text)
    configure("patches.tsv", "../secret")
    assert save(server, "places", places(*BOTH))[0] == 422
    assert target.read_text() == TABLE


def test_a_new_table_does_not_take_the_place_of_a_link(server, study):
    configure("patches.tsv", "null")
    (study / "patches.csv").symlink_to(study / "none")
    assert save(server, "places", places(row("1", 1, 2, grade=0)))[0] == 422
    assert (study / "patches.csv").is_symlink()


@pytest.mark.parametrize(("name", "kind"), [("check", "symlink_to"), ("fix", "hardlink_to")])
def test_what_a_command_says_is_written_through_no_link(server, study, name, kind):
    target = study.parent / "secret"
    for ending in ("log", "pid"):
        getattr(study / f".snakemake/place_{name}.{ending}", kind)(target)
    saved(server, f"start/{name}", {})
    server.commands[name]._own.wait()
    assert target.read_text() == "secret"
    assert "ERROR" in (study / f".snakemake/place_{name}.log").read_text()


@pytest.mark.parametrize(
    "line", ["square: null", "results: 0", "patches: [a]", "inputs: 5", "inputs: {}", "scans: [1]"]
)
def test_a_config_of_wrong_types_is_refused_in_a_sentence(server, study, line):
    config = yaml.safe_load(CONFIG) | yaml.safe_load(line)
    (study / "study.yaml").write_text(yaml.safe_dump(config))
    for name in ("state", "stone", "scan/0", "result", "results/index.html"):
        status, content = ask(server, name)
        assert status == 422
        assert f"'{line.partition(':')[0]}" in content["error"]


def test_a_pipe_in_place_of_a_number_stops_no_answer(server, study):
    os.mkfifo(study / ".snakemake/place_check.pid")
    assert ask(server, "said/check")[0] == 200


def test_a_copy_is_kept_before_a_value_of_the_config_goes(server, study):
    kept = saved(server, "answers", {"load.force_N": None})["kept"]
    assert (study / kept).read_text() == CONFIG


def test_a_folder_has_one_server(server, study):
    with pytest.raises(InputError):  # else the command would serve, and not return
        PlaceServer(Path("study.yaml"))
    result = CliRunner().invoke(main, ["place", str(study), "--no-browser"])
    assert result.exit_code == 2
    assert len(result.stderr.splitlines()) == 1
    assert f"process {os.getpid()}" in result.stderr
    saved(server, "answers", {"load.force_N": 100})


def unusable(kind):
    """Put something in the place of the lock, or of its folder."""
    lock, other = Path(".snakemake/place.lock"), Path("../other").resolve()
    if kind == "a linked folder":
        other.mkdir()
        lock.parent.symlink_to(other)
        return
    lock.parent.mkdir()
    if kind == "another host":
        lock.write_text("elsewhere 17\n")
    elif kind == "a pipe":
        os.mkfifo(lock)
    else:
        other.touch()  # so that nothing in it keeps it from being used
        getattr(lock, kind)(other)


@pytest.mark.parametrize(
    "kind", ["another host", "symlink_to", "hardlink_to", "a pipe", "a linked folder"]
)
def test_a_lock_that_cannot_be_taken_is_refused(study, kind):
    unusable(kind)
    with pytest.raises(InputError, match=r"Remove|remove|Put a folder"):
        PlaceServer(Path("study.yaml"))
    other = study.parent / "other"
    assert not list(other.glob("*"))
    assert not other.is_file() or other.read_text() == ""


@contextmanager
def started(study, tmp_path):
    """`gst place` in a process of its own, and the address that its browser was given."""
    given = tmp_path / "given"
    script = tmp_path / "browser"
    script.write_text(f'#!/bin/sh\nprintf %s "$1" > {given}.part; mv {given}.part {given}\n')
    script.chmod(0o700)
    around = os.environ | {"BROWSER": f"{script} %s"}
    command = [sys.executable, "-m", "gst", "place", str(study)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=around) as process:
        try:
            url = next(line.strip() for line in process.stdout if line.startswith("http"))
            yield process, url, given
        finally:
            process.kill()


def wait_for(file):
    for _ in range(600):
        if file.exists():
            return file.read_text()
        threading.Event().wait(0.05)
    raise AssertionError(f"there is no {file}")


def test_the_token_is_given_to_the_browser_in_a_private_file(study, tmp_path):
    with started(study, tmp_path) as (_, url, given):
        address = wait_for(given)
        assert url.split("/")[-2] not in address
        file = Path(address.removeprefix("file://"))
        assert f"url={url}" in file.read_text()
        modes = [stat.S_IMODE(path.stat().st_mode) for path in (file, file.parent)]
        assert modes == [0o600, 0o700]
        urllib.request.urlopen(url).close()
        assert not file.parent.exists()


def test_a_server_whose_terminal_is_closed_leaves_no_token_and_no_lock(study, tmp_path):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # these tests may run under nohup
    with started(study, tmp_path) as (process, _, given):
        file = Path(wait_for(given).removeprefix("file://"))
        assert file.exists()
        process.send_signal(signal.SIGHUP)
        process.wait()
        assert not file.parent.exists()
        assert (study / ".snakemake/place.lock").read_text() == ""


def test_a_killed_server_leaves_its_folder_to_the_next(study, tmp_path):
    with started(study, tmp_path) as (process, _, given):
        wait_for(given)  # while the browser is started, its process has the lock, too
        lock = (study / ".snakemake/place.lock").read_text()
        assert lock.split()[1] == str(process.pid)
        process.kill()
    with served() as server:
        assert ask(server, "state")[0] == 200


def test_scans_move_together_if_each_has_a_place_from_the_stage(server, study):
    assert ask(server, "stage") == (200, {"all": False})
    for name, place in (("a", (0.01, 0.02)), ("b", (0.9, 0.02))):
        write_plu_at(study / f"scans/{name}.plu", np.eye(POINTS), SPACING, place)
    assert ask(server, "stage") == (200, {"all": True})


FOUND = "3 of 4 are found; each says how well it fits. The others stay where they were."


@pytest.mark.parametrize(("flip", "stated"), [("x", "null"), ("y", "null"), ("null", "y")])
def test_scans_find_their_exact_places_near_those_by_hand(server, study, flip, stated):
    heights = rough_stone(study / "stone.ply")
    right = {"A": (9.0, 13.0), "B": (11.0, 12.0), "C": (10.0, 10.5), "D": (12.0, 10.0)}
    for patch, centre in right.items():
        scan = taken(heights, centre, 8.0, SIZE, SPACING)
        if patch == "D":  # smooth
            scan = 1e-4 * np.random.default_rng(2).normal(size=scan.shape)
        scan = {"null": scan, "x": scan[:, ::-1], "y": scan[::-1]}[flip]
        write_plu(study / f"scans/{patch}.plu", scan, SPACING)
    corners = np.array([[8.0, 8.0, 0, 1], [13.0, 8.0, 0, 1], [8.0, 13.0, 0, 1]]) @ TURN.T
    config = CONFIG.replace("flip: null", f"flip: {stated}")
    (study / "study.yaml").write_text(config.replace("TODO", str(corners[:, :3].tolist())))
    off = zip(right.items(), [(0.4, -0.3), (-0.2, 0.5), (0.1, 0.3), (0, 0)], strict=True)
    lines = [f"{p}\t{x - 8 + dx}\t{y - 8 + dy}\t{p}.plu\n" for (p, (y, x)), (dy, dx) in off]
    (study / "patches.tsv").write_text("patch\tx_mm\ty_mm\tt0\n" + "".join(lines))
    status, found = ask(server, "find", {})
    assert (status, found["all"]) == (200, FOUND)
    assert "not found" in found["said"]["D"]
    for place in found["places"]:
        expected = np.subtract(right[place["patch"]], 8.0)
        assert [place["y_mm"], place["x_mm"]] == pytest.approx(expected, abs=0.06)
        assert place["rotation_deg"] == pytest.approx(8, abs=3)
    saved(server, "answers", found["answers"])
    assert found["answers"].pop("uncertainty.placement_um") > 0
    assert found["answers"] == (
        {"scans.mould.flip": yaml.safe_load(flip)} if flip != stated else {}
    )
    (study / "study.yaml").write_text(CONFIG)
    assert "neither an overview" in ask(server, "find", {})[1]["error"]


@pytest.mark.parametrize("odd", ["mirrored", "inverted"])
def test_a_scan_that_is_laid_otherwise_than_most_is_not_found(odd):
    match = Match(PatchPosition(1.0, 2.0), False, False, 0.9, 0.1, np.eye(3), found=True)
    laid = _laid_alike({"A": match, "B": match, "C": replace(match, **{odd: True})})
    assert [each.found for each in laid.values()] == [True, True, False]


def test_what_is_found_on_one_square_lies_there_on_another():
    turned = Frame((1.0, 2.0, 3.0), (0.0, 0.6, 0.8), (1.0, 0.0, 0.0))
    square = Frame((1.0, 0.5, 2.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    match = Match(PatchPosition(1.0, 2.0, 150.0), False, False, 0.9, 0.1, np.eye(3), True)
    found = Found(turned, None, {"A": match, "B": replace(match, found=False)})
    seen = seen_in(square, found)
    assert list(seen) == ["A"]
    assert -180 <= seen["A"].rotation_deg < 180
    ours, theirs = (
        outline(place, SIZE) @ frame.axes[:2] + frame.origin
        for frame, place in ((square, seen["A"]), (turned, match.place))
    )
    np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_a_result_of_other_settings_is_said_to_be(server, study):
    results = Path("results")
    given = {"steps": {}, "config": read_config(Path("study.yaml"))}
    step = Step(PAGE, given, [], [results / "index.html"])
    write_record(results, step, given_to(results, step), {})
    assert ask(server, "result") == (200, {"page": "results/index.html", "problem": None})
    saved(server, "answers", {"load.force_N": 100.0})
    status, found = ask(server, "result")
    assert (status, found["page"]) == (200, "results/index.html")
    assert "made with another config" in found["problem"]


def picture(heights, invert="false", flip="null"):
    write_plu("scans/a.plu", heights, SPACING)
    configure("invert: false, flip: null", f"invert: {invert}, flip: {flip}")
    return imread(io.BytesIO(picture_of(Path("study.yaml"), 0)))[..., 0]


def test_a_picture_is_lit_from_above_left_with_y_up(study):
    """As the stone beside it is; a mould of the stone looks as the stone does."""
    y, x = np.mgrid[-1 : 1 : POINTS * 1j, -1 : 1 : POINTS * 1j]
    heights = 0.05 * np.exp(-((x - 0.4) ** 2 + (y - 0.2) ** 2) / 0.02)  # a hill, right and up
    shown = picture(heights)
    row, column = (int(POINTS * (1 - at) / 2) for at in (0.2, -0.4))
    assert shown[row - 3, column - 3] > shown[row + 3, column + 3] + 0.5
    assert np.ptp(shown[POINTS // 2 :, : POINTS // 2]) < 0.1  # nothing left and down
    as_mould = picture(-np.fliplr(heights), "true", "x")
    np.testing.assert_allclose(as_mould, shown, atol=0.02)
