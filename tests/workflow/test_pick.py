"""`gst pick` in a browser: what is clicked is what the config says."""

import itertools

import numpy as np
import pytest
import trimesh
import yaml
from click.testing import CliRunner
from gst.cli import main
from gst.config import config_problems, read_config_file
from gstlib.surfaces.frames import find_frame, frame_from_points

from .conftest import ROOT, middle_of, opened

pytestmark = pytest.mark.browser

HALF = np.array([20.0, 30.0, 10.0])  # axes of the stone; it is shown along the third
SIDE = 5.0
SCREENS = {"laptop": (1366, 768), "phone": (390, 844)}


@pytest.fixture(scope="module")
def stone():
    stone = trimesh.creation.icosphere(subdivisions=6)
    stone.apply_transform(np.diag([*HALF, 1.0]))
    return stone


@pytest.fixture(scope="module")
def page_file(stone, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pick")
    stone.export(folder / "stone.ply")
    (folder / "patches.tsv").write_text("patch\tx_mm\ty_mm\tt0\nA\t1.0\t3.5\ta.plu\n")
    files = [str(folder / name) for name in ("stone.ply", "patches.tsv", "pick.html")]
    command = ["pick", files[0], "--patches", files[1], "--output", files[2]]
    result = CliRunner().invoke(main, command)
    assert result.exit_code == 0, result.output
    return folder / "pick.html"


@pytest.fixture(params=SCREENS)
def page(browser, page_file, request):
    with opened(browser, page_file, SCREENS[request.param]) as page:
        yield page


def click(page, *offsets):
    """Click at so many mm to the right of the stone's middle and above it."""
    scale = page.evaluate("1 / (2 * Math.hypot(20, 30, 10))")  # of the stone's sphere
    box = page.locator("canvas").bounding_box()
    pixels = scale * min(box["width"], box["height"])
    x, y = middle_of(page.locator("canvas"))
    for right, up in offsets:
        page.mouse.click(x + pixels * right, y - pixels * up)


def config_of(page):
    return yaml.safe_load(page.input_value("#config"))


def frame_of(page, stone):
    """The frame of the config on the page, which the study takes, and which the page draws."""
    square = config_of(page)["square"]
    config = read_config_file(ROOT / "config/config.yaml")
    config["square"]["size_mm"] = square["size_mm"]
    config["square"]["points_mm"] = square["points_mm"]
    assert config_problems(config) == []
    frame = find_frame(square["points_mm"], stone, size_mm=square["size_mm"])
    drawn = page.evaluate("frameOf(points())")
    for name, own in zip(("x", "y", "normal"), frame.axes, strict=True):
        assert drawn[name] == pytest.approx(own, abs=1e-3)
    return frame


def test_three_clicks_make_the_square(page, stone):
    """The reference at the top right, x to the left, y down; the stone is seen from +z."""
    click(page, (2, 4), (-3, 4), (2, -1))
    frame = frame_of(page, stone)
    points = np.array(config_of(page)["square"]["points_mm"])
    # Each point is where it was clicked, on the stone, to a pixel.
    on_screen = np.array([[2, 4], [-3, 4], [2, -1]])
    right = page.evaluate("data.stone.axes[0][1]")  # the view's up is ±y
    np.testing.assert_allclose(points[:, :2] * right, on_screen, atol=0.3)
    assert np.linalg.norm(points / HALF, axis=1) == pytest.approx(1, abs=0.002)
    assert frame.normal[2] > 0.97
    assert page.evaluate("viewer.snapshot()").startswith("data:image/png")
    assert page.locator("text=reference").first.is_visible()
    page.click("#copy")
    assert page.inner_text("#copied") == "Copied."


def test_what_the_check_would_refuse_is_refused(page, stone):
    click(page, (2, 4), (2, -1), (-3, 4))  # clockwise
    assert config_of(page) is None
    assert page.locator("#copy").is_disabled()
    assert "clockwise" in page.inner_text("#step")
    page.click("#swap")
    assert frame_of(page, stone).normal[2] > 0.97
    page.click("#undo")
    assert config_of(page) is None
    page.click("#whole")
    click(page, (-8, 4.1))
    assert "in line" in page.inner_text("#step")
    assert config_of(page) is None


def test_a_square_about_its_centre_can_be_turned(page, stone):
    page.check("[value=centre]")
    click(page, (0, 0))
    before = frame_of(page, stone)
    page.fill("#angle", "30")
    page.fill("#size", "8")
    after = frame_of(page, stone)
    assert config_of(page)["square"]["size_mm"] == 8
    cosine = np.dot(before.x_axis, after.x_axis)
    assert np.degrees(np.arccos(cosine)) == pytest.approx(30, abs=0.1)
    # x turns towards y, about the centre
    assert np.dot(before.axes[1], after.x_axis) == pytest.approx(0.5, abs=1e-3)
    for frame, side in ((before, 5), (after, 8)):
        middle = frame.origin + side / 2 * frame.axes[:2].sum(axis=0)
        assert middle == pytest.approx([0, 0, HALF[2]], abs=0.3)


def test_a_square_seen_straight_has_x_right_and_y_up(page):
    page.check("[value=centre]")
    click(page, (1, 2))
    page.evaluate("viewer.snapshot()")
    corner, x, y = (
        np.array(middle_of(page.locator("#stone").get_by_text(name, exact=True)))
        for name in ("reference", "x", "y")
    )
    right, down = x - corner
    assert abs(down) < 0.3 * right
    right, down = y - corner
    assert abs(right) < 0.3 * -down


def test_enter_clicks_the_middle_of_the_view(page):
    right, left, down = (f"Shift+Arrow{way}" for way in ("Right", "Left", "Down"))
    for keys in ((right,), (left, left), (right, down)):
        for key in (*keys, "Enter"):
            page.locator("canvas").press(key)
            page.evaluate("viewer.snapshot()")  # the view is drawn
    points = np.array(config_of(page)["square"]["points_mm"])
    assert np.linalg.norm(points / HALF, axis=1) == pytest.approx(1, abs=0.002)
    assert points[:, 2].min() > 0


def test_the_stone_turns_by_pointer_and_keys_and_rests_otherwise(page):
    views = [page.evaluate("viewer.snapshot()")]
    x, y = middle_of(page.locator("canvas"))
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 30, steps=3)
    page.mouse.up()
    assert page.evaluate("clicks.length") == 0  # a drag is no click
    views.append(page.evaluate("viewer.snapshot()"))
    for key in ("ArrowLeft", "Shift+ArrowUp", "+", "Home"):
        page.locator("canvas").press(key)
        views.append(page.evaluate("viewer.snapshot()"))
    page.mouse.wheel(0, -300)
    views.append(page.evaluate("viewer.snapshot()"))
    page.evaluate("viewer.rake(90, 5)")
    views.append(page.evaluate("viewer.snapshot()"))
    assert all(one != other for one, other in itertools.pairwise(views))
    frames = """(count) => new Promise((done) => {
        const next = () => (count-- ? requestAnimationFrame(next) : done());
        next();
    })"""
    page.evaluate(frames, 3)  # what was asked for is drawn
    page.evaluate("drawn = 0; viewer.onrender = () => drawn++; 0")
    page.evaluate(frames, 10)
    assert page.evaluate("drawn") == 0


def test_labels_hide_behind_the_stone(page):
    page.evaluate("label = viewer.addLabel([0, 0, 10], 'front')")
    page.evaluate("viewer.snapshot()")
    assert page.locator("text=front").is_visible()
    page.evaluate("viewer.fit([0, 0, 0], [0, 0, -1], [0, 1, 0], 80)")
    page.evaluate("viewer.snapshot()")
    assert not page.locator("text=front").is_visible()


def test_without_webgl_a_sentence_says_so(browser, page_file):
    page = browser.new_page()
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page.goto(page_file.as_uri())
    assert "WebGL" in page.inner_text("#stone")
    page.close()


def test_the_page_agrees_with_the_frame_of_three_points(page):
    """Where the picks are not perpendicular, x stays and y is turned."""
    points = [[1.0, 2.0, 3.0], [4.0, 2.5, 3.0], [2.0, 6.0, 4.0]]
    drawn = page.evaluate("(points) => frameOf(points)", points)
    frame = frame_from_points(points)
    for name, own in (("origin", frame.origin), ("x", frame.axes[0]), ("y", frame.axes[1])):
        assert drawn[name] == pytest.approx(own)
    assert page.evaluate("frameOf([[0, 0, 0], [1, 0, 0], [3, 0.01, 0]])") is None
