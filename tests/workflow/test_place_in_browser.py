"""`gst place` in a browser: from files to a result, left and taken up again on the way."""

import json
import os
import signal
import subprocess
import time
from contextlib import contextmanager

import numpy as np
import pandas as pd
import pytest
import trimesh
import yaml

from gst.config.edited import with_values
from gst.config.patches import read_patches

from .conftest import GST, UNREADABLE, middle_of, opened, printed

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def folder(finished_tiny, tmp_path_factory):
    """What `gst new` makes of the specimen's files, as coarse as the tiny study."""
    folder = tmp_path_factory.mktemp("place") / "study"
    files = finished_tiny.results / "specimen"
    given = "--mesh", files / "mesh.stl", "--scans", files / "scans"
    assert "gst place" in printed(GST, "new", folder, *given)
    tiny = yaml.safe_load((finished_tiny.folder / finished_tiny.config).read_text())
    names = "macroscale", "microscale", "detection", "validation", "wear_steps"
    coarse = {name: tiny[name] for name in names}
    coarse |= {"reference_realisations": None, "use": None}  # what takes longest
    config = folder / "study.yaml"
    config.write_text(with_values(config.read_text(), coarse))
    table = folder / "patches.csv"  # as where names do not say it
    table.write_text(table.read_text().replace(";7_T1.plu", ";TODO 7_T1.plu"))
    return folder


@contextmanager
def placing(browser, folder, *options, complaints=()):
    """The page of a server of its own, to which a file leads unless there are options."""
    command = [GST, "place", folder, *options]
    around = os.environ | {"BROWSER": "echo %s"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=around
    ) as server:
        try:
            start = "http" if options else "file:"
            address = next(line for line in server.stdout if line.startswith(start))
            with opened(browser, address.strip(), (1366, 900), complaints) as page:
                yield page, server
        finally:
            server.terminate()
            server.wait()  # it may print until its end
    assert server.returncode in (0, -signal.SIGTERM)


def state_of(page):
    """The study as its files have it, once what was done is in them."""
    return page.evaluate("last.then(() => ask('state'))")


def answers_of(page):
    return state_of(page)["answers"]


def table_of(page):
    """Of each patch, its place, and its grade."""
    return pd.DataFrame(state_of(page)["patches"]).set_index("patch").astype(float)


def corners_of(page):
    """Three corners of the square, and unit vectors along its x and its y."""
    corners = np.array(state_of(page)["square"]["points_mm"])
    axes = corners[1:] - corners[0]
    return corners, axes / np.linalg.norm(axes, axis=1, keepdims=True)


def enter(page, place, value):
    page.fill(place, str(value))
    page.locator(place).dispatch_event("change")


def click_stone(page, right=0, up=0):
    """Click so many pixels from the middle of the view."""
    canvas = page.locator("canvas")
    box = canvas.bounding_box()
    middle = {"x": box["width"] / 2 + right, "y": box["height"] / 2 - up}
    canvas.click(position=middle)  # once it no longer moves


def seen_on_plan(page, x_mm, y_mm):
    """Where a point of the square of 5 mm is on the screen: the plan shows 6 mm."""
    box = page.locator("#plan").bounding_box()
    scale = min(box["width"], box["height"]) / 6
    x, y = middle_of(page.locator("#plan"))
    return x + scale * (x_mm - 2.5), y - scale * (y_mm - 2.5)


def drag(page, thing, right, up):
    x, y = middle_of(thing)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right, y - up, steps=3)
    page.mouse.up()


def say_what_was_scanned(page):
    page.select_option("#files select", "7_T1.plu")
    page.check("text=a mould of it")
    state = state_of(page)
    assert state["asked"] == []
    mould = {"scans.mould.invert": True, "scans.mould.flip": "x"}
    assert mould.items() <= state["answers"].items()


def lay_square(page):
    """By three corners, undone, by its middle, and turned."""
    page.check("text=click three corners")
    for right, up in (
        (-60, -60),
        (-60, 60),
        (60, -60),
    ):  # clockwise: x and y are exchanged
        click_stone(page, right, up)
    assert np.cross(*corners_of(page)[1])[2] > 0.9
    page.click("#undo")
    assert state_of(page)["square"]["points_mm"] is None
    page.check("text=click its middle")
    click_stone(page)
    enter(page, "#turn", 30)
    _, turned = corners_of(page)
    assert page.input_value("#turn") == "30"
    enter(page, "#turn", 0)
    corners, flat = corners_of(page)
    assert flat @ turned[0] == pytest.approx((np.cos(np.pi / 6), 0.5), abs=1e-3)
    middle = corners[1:].mean(axis=0)
    assert middle[:2] == pytest.approx([0, 0], abs=0.5)  # that of the stone's view
    assert np.cross(*flat)[2] > 0.9


def place_scans(page, wanted):
    """The first by hand, the others by numbers."""
    page.check("text=Place the scans")
    first, *others = wanted.index
    picture = page.get_by_alt_text(f"Scan of {first}", exact=True)
    right, down = np.subtract(
        seen_on_plan(page, *wanted.loc[first, ["x_mm", "y_mm"]]), middle_of(picture)
    )
    drag(page, picture, right, -down)
    for patch in others:
        for key in ("x_mm", "y_mm"):
            enter(page, f"#{key}-{patch}", wanted[key][patch])
    placed = table_of(page)
    assert placed[["x_mm", "y_mm"]].to_numpy() == pytest.approx(
        wanted.loc[placed.index, ["x_mm", "y_mm"]].to_numpy(), abs=0.03
    )
    return first


def turn_and_move(page, patch):
    """By handle, by keys, all together; undone step by step."""
    before = table_of(page)
    on_plan = page.locator(f"#plan [data-patch='{patch}']")
    half = on_plan.locator("rect").bounding_box()["height"] / 2
    drag(page, on_plan.locator(".handle"), -half, -half)  # from its top to its left
    assert table_of(page).rotation_deg[patch] == pytest.approx(90, abs=3)
    on_plan.focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Shift+ArrowUp")
    moved = table_of(page)
    assert moved.x_mm[patch] == pytest.approx(before.x_mm[patch] - 0.05)
    assert moved.y_mm[patch] == pytest.approx(before.y_mm[patch] + 0.005)
    page.check("#together")
    on_plan.focus()
    page.keyboard.press("ArrowLeft")
    page.click("#mirror")
    mirrored = table_of(page)
    assert mirrored.x_mm.to_numpy() == pytest.approx(5.05 - moved.x_mm.to_numpy())
    assert mirrored.rotation_deg.equals(-moved.rotation_deg)
    for _ in range(5):
        page.click("#undo")
    page.uncheck("#together")
    columns = ["x_mm", "y_mm", "rotation_deg"]
    assert table_of(page)[columns].equals(before[columns])


def say_how(page):
    page.click("text=2 How")
    assert page.locator("#how [type=radio]:checked").count() == 1  # of the mould
    assert page.input_value("#rock") == "?"
    page.check("text=with a hand: 100 N")
    page.check("text=not known: anything from 50 to 1500 mm")
    page.select_option("#rock", "73 0.25")
    page.select_option("#rock-2", label="another")
    page.fill("[data-key='material.young_2_MPa']", "88300")
    page.fill("[data-key='material.poisson_2']", "0.11")
    page.press("[data-key='material.poisson_2']", "Tab")
    answers = {"load.force_N": 100, "counterface.radius_mm": 274}
    answers |= {"uncertainty.radius_log_sd": 0.98, "material.young_1_MPa": 73000}
    answers |= {"material.poisson_1": 0.25, "material.young_2_MPa": 88300}
    assert answers.items() <= answers_of(page).items()
    page.click("text=1 Where")
    page.check("text=Set the load point")
    page.mouse.click(*seen_on_plan(page, 3.5, 3.5))
    assert answers_of(page)["load.at_mm"] == pytest.approx([3.5, 3.5], abs=0.03)
    page.click("#load-middle")
    assert answers_of(page)["load.at_mm"] is None


def wait_for(page, name):
    """Until a command has ended, whether or not the page then shows another step."""
    for button in "stop", "start":
        enabled = f"[data-{button}={name}]:not([disabled])"
        page.wait_for_selector(enabled, state="attached")


def open_result(page):
    """In its frame, with the folder of its tables, and by itself."""
    page.click("text=5 Result")
    answer = page.frame_locator("#answer")
    answer.locator("#patch-table").wait_for(state="attached")
    answer.locator("a[href='tables/']").click()
    answer.locator("a[href='wear.csv']").wait_for()
    with page.expect_popup() as popup:
        page.click("#open")
    popup.value.wait_for_selector("canvas", state="attached", timeout=0)
    popup.value.close()
    assert page.inner_text("#no-result") == ""


def test_the_five_steps(browser, folder, finished_tiny):
    places = finished_tiny.folder / "config/patches_tiny.tsv"
    wanted = read_patches(places, size_mm=5.0, patch_size_mm=0.85).set_index("patch")
    with placing(browser, folder) as (page, _):
        page.click("text=3 Check")
        page.click("[data-start=check]")
        wait_for(page, "check")
        assert "square.points_mm" in page.locator("#check .error").first.inner_text()
        page.click("text=1 Where")
        say_what_was_scanned(page)
        lay_square(page)
        first = place_scans(page, wanted)
        page.click("#exact")
        page.wait_for_selector("#status.wrong")
        assert "too coarse" in page.inner_text("#status")  # as the specimen's mesh is
        turn_and_move(page, first)
    text = (folder / "study.yaml").read_text()
    with placing(browser, folder) as (page, _):  # of another server, on another port
        page.click("text=1 Where")
        page.wait_for_selector("#plan")  # all scans are placed
        assert page.input_value("#size") == "5"
        assert (folder / "study.yaml").read_text() == text  # to look is not to change
        say_how(page)
        page.click("text=3 Check")
        page.wait_for_selector("#check .error")  # of before, and said to be so
        assert "changed" in page.locator("#check [role=status]").inner_text()
        page.click("text=2 How")
        page.reload()
        page.wait_for_selector("[name=against]:checked")
        assert page.is_checked("text=not known: anything from 50 to 1500 mm")
        page.click("text=3 Check")
        page.click("[data-start=check]")
        wait_for(page, "check")
        assert page.locator("#check .error").count() == 0
        assert page.locator("#check .note").count() > 0
        page.wait_for_selector("nav a.done[href='#check']")
        page.wait_for_selector("#check-picture")
        assert (
            page.evaluate("document.getElementById('check-picture').naturalWidth") > 500
        )
        page.click("text=5 Result")
        page.wait_for_selector("#no-result:not(:empty)")
        assert page.locator("#open").is_hidden()
        page.click("text=4 Run")
        page.click("[data-start=study]")
        page.wait_for_selector("#progress:not([hidden])", timeout=0)
        assert page.locator("[inert]").count() == 2  # nothing is edited meanwhile
        assert page.is_disabled("[data-start=check]")
    with placing(browser, folder) as (page, _):  # the study went on
        page.click("text=4 Run")
        wait_for(page, "study")
        assert "Done." in page.locator("#run .messages").inner_text()
        open_result(page)


# Values that no file contains.
USED = {
    "load.force_N": 550,
    "counterface.radius_mm": 200,
    "material.young_1_MPa": 19500,
    "material.young_2_MPa": 19500,
}


@pytest.fixture
def unscanned(tmp_path):
    """The study of a tool without scans."""
    stone = trimesh.creation.icosphere(subdivisions=5)
    stone.apply_transform(np.diag([20.0, 30.0, 10.0, 1.0]))
    stone.export(tmp_path / "stone.ply")
    folder = tmp_path / "study"
    printed(GST, "new", folder, "--mesh", tmp_path / "stone.ply")
    config = folder / "study.yaml"
    config.write_text(with_values(config.read_text(), USED))
    return folder


def test_a_stale_page_saves_nothing_and_shows_what_was_not_saved(browser, unscanned):
    table = unscanned / "patches.csv"
    with placing(browser, unscanned, complaints=["409 (Conflict)"]) as (page, _):
        click_stone(page)
        page.check("text=Grade positions")
        page.click("#add")
        page.evaluate("last")  # is saved, or refused
        edited = table.read_text() + "7;1;1;0\n"
        table.write_text(edited)
        page.click("#add")
        page.click("text=2 How")
        page.check("text=with a hand: 100 N")
        page.evaluate("last")  # is saved, or refused
        page.click("text=1 Where")
        assert "reload the page" in page.inner_text("#status")
        page.wait_for_selector("#places [aria-label='Remove 2']")
        assert page.is_checked("text=with a hand: 100 N")
        assert table.read_text() == edited
        assert answers_of(page)["load.force_N"] == 550
        page.reload()
        page.click("[aria-label='Remove 7']")
        page.evaluate("last")  # is saved, or refused
        assert "patches.csv.bak" in page.inner_text("#status")


def test_the_square_is_proposed_from_the_view_and_its_face_follows(browser, unscanned):
    """As wide as half the view, and at most 0.3 times the stone's thickness."""
    with placing(browser, unscanned) as (page, _):
        click_stone(page, right=-330)
        assert "Click the stone itself" in page.inner_text("#status")
        assert state_of(page)["square"]["points_mm"] is None
        page.click("#propose")
        assert state_of(page)["square"]["size_mm"] == pytest.approx(0.3 * 20, 0.05)
        page.focus("canvas")
        for _ in range(15):
            page.keyboard.press("+")
        page.click("#propose")
        state = state_of(page)
        side = state["square"]["size_mm"]
        assert side == pytest.approx(
            page.evaluate(
                "(() => { const box = document.querySelector('canvas').getBoundingClientRect();"
                "const [x, y] = [box.left + box.width / 2, box.top + box.height / 2];"
                "const [a, b] = [-1, 1].map((k) => viewer.pick(x + k * box.height / 4, y).point);"
                "return Math.hypot(...add(a, b, -1)); })()"
            ),
            rel=0.05,
        )
        assert state["face_mm"] == pytest.approx(3 * side, rel=0.01)
        page.check("text=Grade positions")
        page.mouse.click(*seen_on_plan(page, 2.5, 2.5 + 2.9))
        assert "outside the square" in page.inner_text("#status")
        assert page.locator("#places li").count() == 0
        page.check("text=Set the load point")
        page.fill("#load-x", "400")
        page.press("#load-x", "Tab")
        assert "must be on the face" in page.inner_text("#status")
        assert answers_of(page)["load.at_mm"] is None


def test_the_progress_is_the_steps_and_the_time_since_the_start(browser, unscanned):
    lines = ["29 steps to do.", "0:00:28  3 of 29 steps done", "0:01:07  Pressing"]
    report = {"running": True, "records": [{"text": line} for line in lines]}
    with placing(browser, unscanned) as (page, _):
        page.evaluate(
            "(report) => showProgress(report, document.querySelector('#run .messages'))",
            report,
        )
        page.click("text=4 Run")  # which was hidden meanwhile
        text = page.inner_text("#run [role=status]")
        assert text == "3 of 29 steps done 0:01:07 after the start."


def test_every_text_is_readable_and_every_control_has_a_name(browser, unscanned):
    with placing(browser, unscanned) as (page, _):
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            for step in ("where", "how", "check", "run", "result"):
                page.evaluate(f"go('{step}')")
                page.wait_for_selector(f"nav [href='#{step}'][aria-current]")
                assert page.evaluate(UNREADABLE) == []
        page.set_viewport_size({"width": 390, "height": 844})
        assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_each_cause_has_its_own_button(browser, unscanned):
    """The check's words are given here, as it takes a while."""
    points = [[-2.5, -2.5, 10.0], [2.5, -2.5, 10.0], [-2.5, 2.5, 10.0]]
    config = unscanned / "study.yaml"
    values = {"square.points_mm": points, "patches": "patches.csv"}
    config.write_text(with_values(config.read_text(), values))
    table = unscanned / "patches.csv"
    table.write_text("patch;x_mm;y_mm;wear_grade\n1;1;1;0\n2;1.2;1;\n")
    cure = {"values": {"macroscale.face_mm": 14.4}, "cells": {}}
    cure["button"] = "Use 14.4 mm"
    overlap = {"level": "error", "text": "half of patch 2 is that of patch 1"}
    thin = {"level": "warning", "text": "the stone is thin", "cure": cure}
    causes = [
        overlap | {"more": [], "accept": ["overlap:2"]},
        thin | {"more": ["as patch 7 says"], "accept": []},
    ]
    with placing(browser, unscanned) as (page, _):
        digest = page.evaluate("state.digest")
        report = {"causes": causes, "digest": digest, "summary": "as it is"}
        (unscanned / ".snakemake/place_check.log").write_text(json.dumps(report))
        page.reload()
        page.wait_for_selector("canvas", state="attached")  # read last
        page.click("text=3 Check")
        page.wait_for_selector("nav a.wrong")
        assert "1 fault" in page.inner_text("nav a[href='#check']")
        assert page.locator("#causes li").count() == 2
        page.click("#causes .error >> text=Show")
        assert page.locator("#plan .pointed").count() == 2
        page.click("text=3 Check")
        page.click("text=Use 14.4 mm")
        page.click("#causes >> text=Accept")
        page.click("text=Take back")
        page.wait_for_selector("text=Take back", state="detached")
        assert state_of(page)["face_mm"] == 14.4
        assert answers_of(page)["accept"] == []
        assert (unscanned / "study.yaml.bak").is_file()
        assert page.locator("nav a.wrong").count() == 0
        page.click("#next")
        page.wait_for_selector("nav [aria-current][href='#run']")
        assert page.inner_text("nav [aria-current]").startswith("○ 4 Run")


ATTACK = """<!DOCTYPE html><title>working</title><script>
async function attack() {
  const opened = window.open("../");
  const sent = { method: "POST", body: "{}", headers: { "Content-Type": "application/json" } };
  const asked = await Promise.allSettled([fetch("../state"), fetch("../end", sent)]);
  const other = window.opener || (window.parent === window ? null : window.parent);
  let read = "none";
  try { if (other) read = String(other.document); } catch { read = "closed"; }
  document.title = JSON.stringify([opened, ...asked.map((each) => each.status), origin, read]);
}
attack();
</script>"""


def assert_harmless(frame):
    """What the script has tried was in vain."""
    while (title := frame.evaluate("document.title")) in ("", "working"):
        time.sleep(0.05)
    *tried, read = json.loads(title)
    assert tried == [None, "rejected", "rejected", "null"]
    assert read in ("none", "closed")


def test_a_script_in_a_received_result_cannot_use_the_server(browser, unscanned):
    results = unscanned / "results"
    results.mkdir()
    (results / "index.html").write_text(ATTACK)
    refusals = "Blocked opening", "Security Policy"  # which the browser tells
    with placing(browser, unscanned, complaints=refusals) as (page, _):
        page.click("text=5 Result")
        count = len(page.context.pages)
        inner = page.locator("#answer").element_handle().content_frame()
        inner.wait_for_url("**/results/index.html")
        assert_harmless(inner)
        for relation in (page.get_attribute("#open", "rel"), "opener"):
            page.locator("#open").evaluate("(link, rel) => link.rel = rel", relation)
            with page.expect_popup() as popup:
                page.click("#open")
            assert_harmless(popup.value)
            popup.value.close()
        assert len(page.context.pages) == count
        assert page.evaluate("fetch('state').then((answer) => answer.status)") == 200


def test_places_are_graded_and_a_run_is_stopped(browser, unscanned):
    with placing(browser, unscanned) as (page, server):
        click_stone(page)
        page.check("text=Grade positions")
        page.mouse.click(*seen_on_plan(page, 3.5, 4.5))
        table = table_of(page)
        assert table.wear_grade.isna().all()  # until somebody grades it
        page.keyboard.press("0")
        page.click("#add")
        page.select_option("#grade-2", "3")
        assert "6 are needed" in page.inner_text("#hint")
        table = table_of(page)
        assert table.wear_grade.tolist() == [0, 3]
        assert table[["x_mm", "y_mm"]].to_numpy() == pytest.approx(
            np.array([[3.5, 4.5], [2.5, 2.5]]), abs=0.03
        )
        page.click("#grid")
        for key in "0123":
            page.keyboard.press(key)
        table = table_of(page)
        assert len(table) == 2 + 15  # one of sixteen is near the first position
        assert table.wear_grade.iloc[2:6].tolist() == [0, 1, 2, 3]
        assert table.wear_grade.iloc[6:].isna().all()
        # what is on the stone stays there if the square grows about its middle
        page.check("text=Place the square")
        enter(page, "#size", 7)
        grown = table_of(page)
        assert (grown.x_mm - table.x_mm).to_numpy() == pytest.approx(1)
        page.click("#undo")
        page.click("text=4 Run")
        page.click("[data-start=study]")
        page.wait_for_selector("#run .messages p", timeout=0)
        page.click("[data-stop=study]")
        page.wait_for_selector("[data-start=study]:not([disabled])", timeout=0)
        assert "Stopped with" in page.locator("#run .messages").inner_text()
        assert page.locator("#run .error").count() == 0
        page.click("#end")
        server.wait()
