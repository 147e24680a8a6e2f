"""The server of `gst place`: whom it answers, what it writes, and what it shows."""

import http.client
import io
import json
import logging
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from os import environ
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from folders import fill, snapshot
from matplotlib.image import imread
from stones import TURN, rough_stone, taken

from gst.check.fixing import Cure
from gst.setup.place import PlaceServer
from gst.setup.place_check import _Causes
from gst.setup.place_scans import picture_of
from gst.setup.place_state import digest_of
from gstlib.errors import FaultError, InputError
from gstlib.io.plu import write_plu

STUDY, PATCHES = Path("study.yaml"), Path("patches.tsv")
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
TABLE = "# by hand\npatch\tnote\tx_mm\ty_mm\tt0\nA\tdull\tTODO\tTODO\ta.plu\nB\t\t1,50\t2\tb.plu\n"
POINTS_MM = [[0, 0, 10], [5, 0, 10], [0, 5, 10]]


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study in the working folder, beside a file that is none of its own."""
    folder = tmp_path / "study"
    files = {
        "study.yaml": CONFIG,
        "patches.tsv": TABLE,
        "results/index.html": "<title>result</title>",
        "results/tables/a b.csv": "1",
        "../secret": "secret",
    }
    fill(folder, files)
    (folder / "results/link").symlink_to(tmp_path / "secret")
    trimesh.creation.icosphere(subdivisions=2, radius=10.0).export(folder / "stone.ply")
    ground = 1e-3 * np.random.default_rng(1).normal(size=(POINTS, POINTS))
    for name in ("a", "b"):
        write_plu(folder / f"scans/{name}.plu", ground, SPACING)
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def server(study):
    with PlaceServer(STUDY) as server:
        serve = partial(server.serve_forever, poll_interval=0.01)
        thread = threading.Thread(target=serve)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def ask(server, path, sent=None, headers=None, token=None):
    """The status of an answer, and its content."""
    link = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=600)
    body = sent if sent is None or isinstance(sent, str) else json.dumps(sent)
    address = f"/{server.token if token is None else token}/{path}"
    headers = {"Content-Type": "application/json"} | (headers or {})
    link.request("GET" if sent is None else "POST", address, body, headers)
    answer = link.getresponse()
    content = answer.read()
    link.close()
    is_json = answer.headers["Content-Type"] == "application/json"
    return answer.status, json.loads(content) if is_json else content


def save(server, path, sent, digest=None):
    """The answer to a page that shows the files as they are, or those of a former digest."""
    digest = digest_of(server.config) if digest is None else digest
    return ask(server, path, sent, {"Study-Digest": digest})


def saved(server, path, sent):
    """The answer to what is saved."""
    status, answer = save(server, path, sent)
    assert status == 200
    return answer


def state_of(server):
    return ask(server, "state")[1]


def configure(old, new):
    """Write the config with a part replaced."""
    STUDY.write_text(CONFIG.replace(old, new))


def written():
    """The config as it is on the disk."""
    return yaml.safe_load(STUDY.read_text())


def row(patch, x, y, turn=0, grade=None):
    columns = ("patch", "x_mm", "y_mm", "rotation_deg", "wear_grade")
    return dict(zip(columns, (patch, x, y, turn, grade), strict=True))


def places(*rows, points=None, size=5.0):
    return {"square": {"points_mm": points, "size_mm": size}, "patches": rows}


BOTH = row("A", 1, 1), row("B", 2, 2)
# How each request is answered: the status, the path, and what is sent, if it is.
REFUSED = {
    "a foreign name": (403, "state", None, {"Host": "evil.example"}),
    "a foreign page": (403, "state", None, {"Origin": "http://evil.example"}),
    "a way up": (403, "results/../study.yaml"),
    "a link that leads out": (403, "results/link"),
    "a folder without a slash": (404, "results/tables"),
    "a scan by its path": (404, "scan/../../secret"),
    "a scan to write": (422, "file", '{"patch": "B", "column": "t0", "name": "/x"}'),
    "an upload": (413, "answers", "{}", {"Content-Length": "3000000"}),
    "a key that names a file": (422, "answers", '{"inputs.mesh": "/etc/passwd"}'),
    "a value that cannot be meant": (422, "answers", '{"load.force_N": -1}'),
    "no JSON": (400, "answers", "{"),
    "a patch less": (422, "places", places(BOTH[0])),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(server, study, case):
    expected, path, sent, headers = (*REFUSED[case], None, None)[:4]
    before = snapshot(study)
    headers = {"Study-Digest": digest_of(server.config)} | (headers or {})
    status, content = ask(server, path, sent, headers)
    assert status == expected
    assert set(content) == {"error"}
    assert "secret" not in content["error"].replace(str(study.parent), "")
    assert snapshot(study) == before
    assert ask(server, path, sent, headers, token="")[0] == 403


def test_files_and_folders_of_the_results_are_shown(server):
    content = ask(server, "results/tables/")[1].decode()
    assert re.findall('href="(.*?)"', content) == ["a%20b.csv"]
    assert ask(server, "results/tables/a%20b.csv") == (200, b"1")
    assert ask(server, "results/") == (200, b"<title>result</title>")


def test_scans_and_results_outside_their_folders_are_refused(server, study):
    (study / "scans/c.plu").symlink_to(study.parent / "secret")
    PATCHES.write_text(TABLE.replace("b.plu", "c.plu"))
    assert ask(server, "scan/1")[0] == 422
    configure("results: results", "results: ..")
    assert ask(server, "results/secret")[0] == 403


def test_places_are_written_and_the_rest_stays(server):
    state = state_of(server)
    assert state["square"] == {"points_mm": None, "size_mm": 5.0}
    assert state["patches"] == [row("A", None, None), row("B", 1.5, 2.0)]
    rows = row("A", 1.23456, 0, -7.5), row("B", 1.5, None)
    saved(server, "places", places(*rows, points=POINTS_MM))
    assert STUDY.read_text() == CONFIG.replace("TODO", str(POINTS_MM))
    assert PATCHES.read_text() == (
        "# by hand\npatch\tnote\tx_mm\ty_mm\tt0\trotation_deg\n"
        "A\tdull\t1,235\t0\ta.plu\t-7,5\nB\t\t1,50\tTODO\tb.plu\t0\n"
    )
    # undone, also the turn
    saved(server, "places", places(*state["patches"]))
    assert STUDY.read_text() == CONFIG
    assert state_of(server) == state | {"digest": digest_of(server.config)}
    # the face keeps its ratio to the square
    assert state["face_mm"] == 15.0
    saved(server, "places", places(*state["patches"], size=10.0))
    assert written()["square"]["size_mm"] == 10.0
    assert written()["macroscale"]["face_mm"] == 30.0


def test_rows_of_one_name_are_not_taken_for_each_other(server):
    twice = TABLE.replace("\nB\t", "\nA\t")
    assert twice != TABLE
    PATCHES.write_text(twice)
    assert save(server, "places", places(BOTH[0], row("A", 2, 2)))[0] == 422
    assert PATCHES.read_text() == twice


def test_answers_are_written_and_comments_stay(server):
    for sent in (
        {"load.force_N": 30},
        {"counterface.radius_mm": 274},
        {"load.at_mm": [1.5, 2]},
    ):
        assert saved(server, "answers", sent)["kept"] is None
        assert sent.items() <= state_of(server)["answers"].items()
    text = STUDY.read_text()
    assert "load: {force_N: 30, at_mm: [1.5, 2]}  # the paper's" in text
    # a copy is kept before a value goes
    kept = saved(server, "answers", {"load.force_N": None})["kept"]
    assert Path(kept).read_text() == text


def test_places_of_a_tool_without_scans_make_a_table(server, study):
    """Of which a copy is kept before a part is removed."""
    configure("patches.tsv", "null")
    saved(server, "places", places(row("1", 1, 2, grade=0), row("2", 3, 4)))
    table, text = study / "patches.csv", "patch;x_mm;y_mm;wear_grade\n1;1;2;0\n2;3;4;\n"
    assert table.read_text() == text
    assert written()["patches"] == "patches.csv"
    (study / "patches.csv.bak").symlink_to(study / "none")
    table.chmod(0o600)
    rows = [row("2", 3, 4, grade=3), row("7", 1, 1, grade=1)]
    kept = Path(saved(server, "places", places(*rows))["kept"])
    assert kept.read_text() == text
    assert [file.stat().st_mode & 0o777 for file in (table, kept)] == 2 * [0o600]
    assert not (study / "none").exists()
    assert state_of(server)["patches"] == rows
    assert saved(server, "places", places())["kept"]
    assert not table.exists()
    assert state_of(server)["patches"] == []


SAVES = {
    "answers": '{"load.force_N": 100}',
    "places": places(*BOTH),
    "file": '{"patch": "B", "column": "t0", "name": "a.plu"}',
    "cure": "0",
}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("study.yaml", CONFIG + "# edited\n"),
        ("study.yaml", None),
        ("patches.tsv", TABLE.replace("dull", "bright")),
    ],
)
def test_a_page_of_former_files_changes_nothing(server, study, name, text):
    digest = state_of(server)["digest"]
    (study / name).unlink()
    if text:
        (study / name).write_text(text)
    before = snapshot(study)
    for path, sent in SAVES.items():
        assert save(server, path, sent, digest)[0] == 409
        assert ask(server, path, sent)[0] == 409  # a page that knows no digest
    assert snapshot(study) == before


def test_one_of_many_saves_at_once_is_written(server):
    digest = digest_of(server.config)
    sent = [{"load.force_N": force} for force in range(1, 17)]
    with ThreadPoolExecutor(8) as threads:
        answers = threads.map(lambda one: save(server, "answers", one, digest), sent)
        statuses = [status for status, _ in answers]
    assert sorted(statuses) == [200] + [409] * 15
    with pytest.raises(InputError):  # nor has a folder two servers
        PlaceServer(STUDY)
    assert written()["load"]["force_N"] == 1 + statuses.index(200)


@pytest.mark.parametrize(
    ("name", "path"), [("study.yaml", "answers"), ("patches.tsv", "places")]
)
def test_files_that_are_links_are_not_changed(server, study, name, path):
    file, target = study / name, study.parent / "secret"
    text = file.read_text()
    file.rename(target)
    file.symlink_to(target)
    assert save(server, path, SAVES[path])[0] == 422
    assert (target.read_text(), file.is_symlink()) == (text, True)


@pytest.mark.parametrize(
    ("name", "kind"), [("check", "symlink_to"), ("study", "hardlink_to")]
)
def test_what_a_command_says_is_written_through_no_link(server, study, name, kind):
    target = study.parent / "secret"
    for ending in ("log", "pid"):
        getattr(study / f".snakemake/place_{name}.{ending}", kind)(target)
    saved(server, f"start/{name}", {})
    server.commands[name]._own.wait()
    assert target.read_text() == "secret"
    assert "points_mm" in (study / f".snakemake/place_{name}.log").read_text()


def test_a_cause_is_told_once_with_its_consent_and_its_cure(study):
    causes, remedy = _Causes(), "Turn it."
    log = logging.Logger("of the test")
    log.addHandler(causes)
    for pair in ("AB", "BC"):
        log.warning("patches %s and %s overlap", *pair)
    log.warning("set macroscale.face_mm to 14.4")
    for patch in "AB":
        causes.add_fault(FaultError("placement", patch, "is turned", remedy, [patch]))
    Path("patches.csv").write_text("patch;x_mm\nA;1\nB;2\n")
    turn = {"B": {"rotation_deg": "90"}}
    cures = (
        Cure("B", {}, lambda row: turn.get(row["patch"], {}), "Turn", "placement"),
        Cure("it is thin", {"macroscale.face_mm": 14.4}),
    )
    for cure in cures:
        causes.add_cure(cure, "patches.csv")
    overlaps, face, turned = causes.causes.values()
    assert [len(each["more"]) for each in (overlaps, turned)] == [1, 1]
    assert turned["accept"] == ["placement:A", "placement:B"]
    assert turned["cure"] == {"values": {}, "cells": turn, "button": "Turn"}
    assert face["cure"]["values"] == {"macroscale.face_mm": 14.4}
    assert "cure" not in overlaps


def test_what_cures_a_cause_is_written_while_the_check_holds(server):
    """Other cures and consent leave it valid, another answer does not."""
    cures = [
        {"values": {"macroscale.face_mm": 14.4}, "cells": {}, "button": "Use 14.4"},
        {"values": {}, "cells": {"B": {"x_mm": "2.5"}}, "button": "Move"},
    ]
    causes = [{"level": "warning", "text": "", "cure": cure} for cure in cures]
    check = {"causes": causes, "digest": digest_of(server.config), "summary": ""}
    warning = "UserWarning: of another package\n"
    Path(".snakemake/place_check.log").write_text(warning + json.dumps(check))
    assert ask(server, "report/check")[1]["changed"] is False
    saved(server, "cure", 0)
    assert written()["macroscale"] == {"face_mm": 14.4}
    saved(server, "answers", {"accept": ["overlap:B"]})
    assert Path(saved(server, "cure", 1)["kept"]).read_text() == TABLE
    assert "B\t\t2,5\t2" in PATCHES.read_text()
    assert ask(server, "report/check")[1]["changed"] is True
    saved(server, "answers", {"load.force_N": 100})
    saved(server, "answers", {"accept": []})
    for number in (0, 2):
        assert save(server, "cure", number)[0] == 422


@pytest.mark.parametrize(("name", "other"), [("check", "study"), ("study", "check")])
def test_nothing_changes_while_the_files_are_read(
    server, study, name, other, monkeypatch
):
    monkeypatch.setattr(server.commands[name], "is_running", lambda: True)
    before = snapshot(study)
    for path, sent in SAVES.items():
        assert save(server, path, sent)[0] == 423
    assert ask(server, f"start/{other}", {})[0] == 423
    assert snapshot(study) == before


@pytest.mark.parametrize("linked", ["place.lock", ""])
def test_a_lock_behind_a_link_is_refused(study, linked):
    target = study.parent / "other"
    target.mkdir()
    link = study / ".snakemake" / linked
    link.parent.mkdir(exist_ok=True)
    link.symlink_to(target / linked)
    with pytest.raises(InputError):
        PlaceServer(STUDY)
    assert [*target.iterdir()] == []


def test_the_browser_gets_the_token_in_a_private_file_that_goes(server, monkeypatch):
    addresses = []
    monkeypatch.setattr("webbrowser.open", addresses.append)
    server.open_browser()
    (address,) = addresses
    assert server.token not in address
    file = Path(address.removeprefix("file://"))
    assert f"url={server.url}" in file.read_text()
    assert file.stat().st_mode & 0o777 == 0o600
    assert ask(server, "")[0] == 200
    assert not file.exists()


def test_a_server_whose_terminal_is_closed_leaves_no_token_and_no_lock(study):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # these tests may run under nohup
    command = [sys.executable, "-m", "gst", "place", str(study)]
    around = environ | {"BROWSER": "true"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=around) as process:
        while not any(file.stat().st_size for file in study.glob(".snakemake/*.html")):
            time.sleep(0.05)
        process.send_signal(signal.SIGHUP)
    assert [path.name for path in study.glob(".snakemake/place*")] == ["place.lock"]
    PlaceServer(STUDY).server_close()


def test_scans_find_their_exact_places_near_those_by_hand(server):
    """All are as in a mirror."""
    heights = rough_stone("stone.ply")
    right = {"A": (9.0, 13.0), "B": (11.0, 12.0), "C": (10.0, 10.5)}
    table = "patch\tx_mm\ty_mm\tt0\n"
    for patch, (y, x) in right.items():
        scan = taken(heights, (y, x), 8.0, SIZE, SPACING)
        write_plu(f"scans/{patch}.plu", scan[::-1], SPACING)
        table += f"{patch}\t{x - 7.7}\t{y - 8.4}\t{patch}.plu\n"
    PATCHES.write_text(table)
    assert "neither an overview" in ask(server, "find", {})[1]["error"]
    corners = [[8, 8, 0, 1], [13, 8, 0, 1], [8, 13, 0, 1]] @ TURN.T
    configure("TODO", str(corners[:, :3].tolist()))
    status, answer = ask(server, "find", {})
    assert (status, len(answer["places"])) == (200, 3)
    for place in answer["places"]:
        expected = np.subtract(right[place["patch"]], 8.0)
        assert [place["y_mm"], place["x_mm"]] == pytest.approx(expected, abs=0.06)
        assert place["rotation_deg"] == pytest.approx(8, abs=3)
    assert answer["answers"].pop("uncertainty.placement_um") > 0
    assert answer["answers"] == {"scans.mould.flip": "y"}


def picture(heights):
    write_plu("scans/a.plu", heights, SPACING)
    return imread(io.BytesIO(picture_of(STUDY, 0)))[..., 0]


def test_a_picture_is_lit_from_above_left_with_y_up(study):
    """As the stone beside it is; a mould of the stone looks as the stone does."""
    y, x = np.mgrid[-1 : 1 : POINTS * 1j, -1 : 1 : POINTS * 1j]
    heights = 0.05 * np.exp(
        -((x - 0.4) ** 2 + (y - 0.2) ** 2) / 0.02
    )  # a hill, right and up
    shown = picture(heights)
    row, column = int(0.4 * POINTS), int(0.7 * POINTS)
    assert shown[row - 3, column - 3] > shown[row + 3, column + 3] + 0.5
    configure("invert: false, flip: null", "invert: true, flip: x")
    np.testing.assert_allclose(picture(-np.fliplr(heights)), shown, atol=0.02)
