"""The page of the tiny study in a real browser, opened from its file."""

import base64
import contextlib
import io
import re
import shutil
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from PIL import Image, ImageChops, ImageColor, ImageStat

from gst.page.figures.style import AGREEMENT
from gst.page.page import Shown
from gst.page.results import Results
from gst.page.study_page import write_study_page
from gst.setup.place import _POLICY_OF_RESULTS
from gstlib.io.store import write_dataset
from gstlib.io.tables import read_table

from .conftest import UNREADABLE, listened_to, middle_of, opened

pytestmark = pytest.mark.browser

SIZES = pytest.mark.parametrize(
    "size", [(1366, 768), (390, 844)], ids=["screen", "phone"]
)


@pytest.fixture(scope="module")
def address(finished_tiny):
    return (finished_tiny.results / "index.html").as_uri()


@pytest.fixture
def page(browser, address):
    with opened(browser, address) as page:
        yield page


@pytest.fixture(scope="module")
def draws(finished_tiny):
    """Uses of the tiny study's tool, made up: its own scans are too few to infer one."""
    generator = np.random.default_rng(1)
    patches = list(read_table(finished_tiny.results / "tables/registration.csv").patch)
    x, y = generator.normal([[2.2], [3.1]], 0.2, (2, 500))
    draws = xr.Dataset(coords={"patch": patches})
    draws["x_mm"], draws["y_mm"] = ("draw", x), ("draw", y)
    draws["weight"] = "draw", generator.dirichlet(np.ones(500))
    draws["wear_coefficient"] = "draw", generator.uniform(0.005, 0.01, 500)
    pressure = generator.uniform(0, 90, (500, len(patches))) * x[:, np.newaxis]
    draws["pressure"] = ("draw", "patch"), pressure
    for variable in draws.values():
        variable.attrs.update(units="1", long_name="made up")
    return draws.assign_attrs(adopted=1, answer="pressed")


@pytest.fixture(scope="module")
def used(finished_tiny, draws, config, tmp_path_factory):
    """The page of the tiny study as if it had inferred that use."""
    folder = tmp_path_factory.mktemp("used") / "results"
    shutil.copytree(finished_tiny.results, folder)
    tables, figures = folder / "tables", sorted(folder.glob("figures/*.png"))
    write_dataset(folder / "use.h5", draws)
    rows = ("load_point_x", 2.5, 2.2), ("load_point_y", 2.5, 3.1), ("spread", None, 0.3)
    use = pd.DataFrame(rows, columns=["parameter", "prior", "posterior_mean"])
    use = use.assign(low=0.1, high=3.4, answer="pressed", competitor="", adopted="yes")
    use.to_csv(tables / "use.csv", index=False)
    measured = read_table(tables / "registration.csv").mean_wear_depth_um
    losses = pd.DataFrame({"patch": draws.patch.values, "loss_um": measured})
    losses.to_csv(tables / "predicted_losses.csv", index=False)
    named = {"mesh": "specimen/mesh.stl", "strips": "figures/strip", "use": "use.h5"}
    named |= {"by_patch": "figures/patch", "surface": "macroscale/surface.h5"}
    named |= {"contact": "macroscale/contact.h5"}
    files = {file.name: file for file in tables.glob("*.csv")}
    files |= {name: folder / file for name, file in named.items()}
    places = read_table(tables / "patch_pressures.csv").to_dict("list")
    places |= dict.fromkeys(("t0", "t1"), ["a.plu"] * len(losses))
    sizes = {"size_mm": 5.0, "patch_mm": 0.85, "force_N": 550.0}
    study = Results(files, places=places, **sizes)
    shown = [Shown(file, "5 Validation", file.stem, "made before") for file in figures]
    about = {"steps": [], "config_faults": [], "active_tool": None}
    page = folder / "index.html"
    write_study_page(page, study, config, shown, **about, methods="Methods.")
    return page


@pytest.fixture
def used_page(browser, used):
    with opened(browser, used.as_uri()) as page:
        yield page


@SIZES
def test_the_map_and_its_load_points_are_on_the_first_screen(
    browser, used, draws, size
):
    with opened(browser, used.as_uri(), size) as page:
        box = page.locator("#map").bounding_box()
        assert box["y"] + box["height"] < size[1]
        answer = page.locator(".lead").bounding_box()
        beside = answer["x"] > box["x"] + box["width"]
        assert beside if size[0] > 1000 else answer["y"] < box["y"]
        mean = [float(draws.weight @ draws[name]) for name in ("x_mm", "y_mm")]
        for kind, place in {"given": (2.5, 2.5), "inferred": mean}.items():
            at = middle_of(page.locator(f"#map use[data-kind={kind}]"))
            assert at == pytest.approx(seen_on_map(page, *place), abs=2)
        region = middle_of(page.locator("#map ellipse.region"))
        assert region == pytest.approx(at, abs=2)
        assert "outside" in page.locator(".legend").inner_text()


def seen_on_map(page, x_mm, y_mm):
    """Where a point of the square of 5 mm is on the screen."""
    box = page.locator("#map .frame").first.bounding_box()
    right, up = x_mm / 5 * box["width"], y_mm / 5 * box["width"]
    return box["x"] + right, box["y"] + box["width"] - up


def position(page):
    """The load point that the explorer is asked about."""
    fields = (page.locator(f"#explorer [name={axis}]") for axis in "xy")
    return tuple(float(field.input_value()) for field in fields)


def test_a_click_on_the_map_shows_what_the_nearest_draws_did(used_page, used, draws):
    losses = pd.read_csv(
        used.parent / "tables/predicted_losses.csv", dtype={"patch": str}
    )
    at = seen_on_map(used_page, 2.5, 3.5)  # beside the patches
    used_page.mouse.click(*at)
    x, y = position(used_page)
    assert (x, y) == pytest.approx((2.5, 3.5), abs=0.03)
    away = np.hypot(draws.x_mm - x, draws.y_mm - y).values
    nearest = draws.isel(draw=np.argsort(away)[:50])
    nearest["loss"] = nearest.wear_coefficient * nearest.pressure
    mean = nearest.weighted(nearest.weight).mean("draw")
    rows = used_page.locator("#asked tbody tr").all()
    shown = pd.DataFrame(row.locator("td").all_inner_texts() for row in rows)
    assert list(shown[0]) == list(losses.patch)
    wanted = np.stack([mean.pressure, mean.loss, losses.loss_um], axis=1)
    values = shown.loc[:, 1:].astype(float)
    np.testing.assert_allclose(values, wanted, rtol=6e-3, atol=5e-3)
    told = numbers(used_page.locator("#asked-how").inner_text())
    likely = 100 * float(draws.weight[away <= 0.425].sum())
    assert told[2] == pytest.approx(likely, rel=6e-3)
    assert middle_of(used_page.locator("#asked-at")) == pytest.approx(at, abs=2)


def test_a_load_far_from_all_draws_or_beyond_the_face_has_no_numbers(used_page, draws):
    asked = used_page.locator("#asked")

    def told(x_mm):
        used_page.fill("#explorer [name=x]", x_mm)
        used_page.press("#explorer [name=x]", "Enter")
        return used_page.locator("#asked-how").inner_text()

    told("2.2")
    assert asked.is_visible()
    far = told("4.9")
    x, y = position(used_page)
    nearest = float(np.hypot(draws.x_mm - x, draws.y_mm - y).min())
    assert far.startswith("No draw of the load point lies within")
    assert numbers(far)[-1] == pytest.approx(nearest, rel=6e-3)
    assert not asked.is_visible()
    beyond = told("99")
    assert "outside the face" in beyond
    assert numbers(beyond)[-2:] == [-2.5, 7.5]
    assert not used_page.locator("#asked, #asked-at").first.is_visible()
    box = used_page.locator("#map").bounding_box()  # beyond the map, on the face
    used_page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] - 4)
    assert "No draw" in used_page.locator("#asked-how").inner_text()


def numbers(text):
    texts = re.findall(r"\N{MINUS SIGN}?\d+(?:\.\d+)?", text)
    return [float(one.replace("\N{MINUS SIGN}", "-")) for one in texts]


def test_cards_and_explorer_work_in_the_sandbox_of_gst_place(browser, used):
    """Where forms are dead: their buttons have scripts."""
    page = browser.new_page()
    policy = {"Content-Security-Policy": _POLICY_OF_RESULTS.replace("\n", ";")}
    answer = {"path": used, "headers": policy, "content_type": "text/html"}
    page.route("**", lambda route: route.fulfill(**answer))
    _, complaints = listened_to(page)
    page.goto("http://place.test/results/index.html")
    page.click("#patch-table a[href='#patch-13']")
    page.click("#patch-13 form button")
    page.locator("#patch-13").wait_for(state="hidden")
    page.click("#explorer button")
    assert page.locator("#asked").is_visible()
    assert chosen(page, "").startswith(b"PK")
    page.click("#show-methods")
    page.click("#copy-methods")
    assert page.locator("#copied").inner_text() == "Copied."
    assert complaints == []
    page.close()


def picture_in(data):
    """The picture in a file, or in an address that has all of it."""
    if isinstance(data, str):
        data = base64.b64decode(data.partition("base64,")[2])
    return Image.open(io.BytesIO(data)).convert("RGB")


def saved(page, click):
    with page.expect_download() as download:
        click()
    return Path(download.value.path()).read_bytes()


def chosen(page, folder):
    """What is saved if this is chosen in the menu, with the keyboard."""
    page.locator("#save summary").focus()
    page.keyboard.press("Enter")
    return saved(page, page.locator(f"[data-save='{folder}']").click)


def test_a_copy_of_the_page_alone_saves_all_that_it_shows(
    browser, finished_tiny, tmp_path
):
    results, alone = finished_tiny.results, tmp_path / "alone.html"
    shutil.copy(results / "index.html", alone)
    with opened(browser, alone.as_uri()) as page:
        whole = chosen(page, "")
        assert chosen(page, "") == whole
        methods = chosen(page, "methods.txt").decode()
        with zipfile.ZipFile(io.BytesIO(whole)) as archive:
            assert archive.testzip() is None
            content = {name: archive.read(name) for name in archive.namelist()}
        assert content.pop("methods.txt").decode() == methods
        patterns = "tables/*.csv", "figures/*.[ps][nv]g", "figures/patch/*.png"
        files = {
            file.relative_to(results).as_posix(): file.read_bytes()
            for pattern in patterns
            for file in results.glob(pattern)
        }
        del files["tables/microscale_paths.csv"]
        assert content.keys() == files.keys()
        for name, expected in files.items():
            if name.endswith(".png"):
                both = picture_in(content[name]), picture_in(expected)
                assert max(ImageStat.Stat(ImageChops.difference(*both)).mean) < 3
            else:
                assert content[name] == expected
        link = page.locator("a[href='figures/wear.svg']")
        assert saved(page, link.click) == files["figures/wear.svg"]
        page.click("#show-methods")
        assert page.locator("#methods-text").text_content() == methods
        page.click("#copy-methods")
        page.wait_for_function("document.getElementById('copied').textContent")
        assert page.evaluate("getSelection().toString()").strip() == methods.strip()


def test_turning_the_tool_and_its_light_change_the_picture(page):
    canvas = page.locator("#viewer canvas")
    pictures = [canvas.screenshot()]
    canvas.press("ArrowLeft")
    pictures.append(canvas.screenshot())
    page.fill("#azimuth", "120")
    pictures.append(canvas.screenshot())
    page.click("#see-square")
    pictures.append(canvas.screenshot())
    assert len(set(pictures)) == 4


def opened_card(page):
    """The patch whose card is open; the card is closed again."""
    card = page.locator("dialog[open]")
    card.wait_for()
    title = card.locator("h2").inner_text()
    number = re.match(r"Patch \S+", title)[0]
    assert page.url.endswith(f"#{number.lower().replace(' ', '-')}")  # to be passed on
    page.keyboard.press("Escape")
    card.wait_for(state="hidden")
    page.wait_for_function("location.hash === ''")
    return number


def test_a_click_or_a_key_opens_the_card_of_the_patch(page):
    page.click("#patch-table tbody a >> text=/^13$/")
    assert opened_card(page) == "Patch 13"
    page.click("#map a[href='#patch-7']")
    assert opened_card(page) == "Patch 7"
    page.click("#see-square")
    number = page.locator("#viewer span", has_text=re.compile("^16$"))
    page.wait_for_function(
        "element => element.style.opacity === '1'", arg=number.element_handle()
    )
    page.mouse.click(*middle_of(number))
    assert opened_card(page) == "Patch 16"
    for place in ("#patch-table a[href='#patch-5']", "#map a[href='#patch-5']"):
        page.locator(place).focus()
        page.keyboard.press("Enter")
        assert opened_card(page) == "Patch 5"


def test_a_card_leads_to_the_next_and_the_previous_one(page):
    names = [row.inner_text() for row in page.locator("#patch-table tbody th").all()]
    page.click(f"#patch-table a[href='#patch-{names[0]}']")
    for name in [*names[1:], *names[-2::-1]]:
        page.locator("dialog[open] .turn a", has_text=f"Patch {name}").click()
        assert page.locator("dialog[open] h2").inner_text().startswith(f"Patch {name} ")
        assert page.url.endswith(f"#patch-{name}")
    assert page.locator("dialog[open] .turn a").count() == 1


def test_a_card_opened_by_its_address_fits_the_screen_and_its_picture_opens_large(
    browser, address
):
    with opened(browser, f"{address}#patch-13") as page:
        card, large = page.locator("#patch-13"), page.locator("#large img")
        picture = card.locator(".enlarge img").bounding_box()
        assert picture["y"] + picture["height"] < 768
        card.locator(".enlarge").click()
        wide = large.evaluate("one => one.naturalWidth")
        assert wide > 700
        assert large.bounding_box()["width"] == wide
        page.keyboard.press("Escape")
        card.locator("form button").click()
        card.wait_for(state="hidden")


def test_the_map_shows_pressure_or_measured_loss(page):
    shown = "all => all.map(one => one.getAttribute('display'))"
    assert page.locator("#map image").evaluate_all(shown) == ["inline", "none"]
    page.get_by_role("radio", name="measured loss").check()
    assert page.locator("#map image").evaluate_all(shown) == ["none", "inline"]
    assert page.locator(".scale.field:visible").inner_text().endswith("µm")


def test_thumbnails_lead_to_cards_where_t0_and_t1_are_compared(page):
    thumbnail = page.locator(".thumbnails a[href='#patch-13'] img")
    strip = picture_in(thumbnail.get_attribute("src"))
    thumbnail.click()
    page.click("#patch-13 .blink")
    picture = page.locator("#blink-picture")
    # the first two of the strip's three maps
    for number, epoch in enumerate(("T0", "T1")):
        shown = picture_in(picture.screenshot())
        width, height = shown.size
        maps = np.split(np.asarray(strip.resize((3 * width, height)), float), 3, axis=1)
        off = [np.abs(one - shown).sum() for one in maps]
        assert np.argmin(off) == number
        assert epoch in picture.get_attribute("aria-label")
        page.click("#blink-now")
    bar = page.locator("#blink-picture .length")
    share = bar.bounding_box()["width"] / picture.bounding_box()["width"]
    assert bar.inner_text() == "0.2 mm"
    assert share == pytest.approx(0.2 / 0.85, rel=0.02)
    page.click("#blink-now")
    page.check("#blink-on")
    page.wait_for_function("document.getElementById('blink-now').dataset.epoch === '0'")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_is_readable_and_every_control_has_a_name(page, scheme):
    page.emulate_media(color_scheme=scheme)
    for details in page.locator("summary").all():
        details.click()
    assert page.evaluate(UNREADABLE) == []
    page.click("#patch-table a[href='#patch-13']")
    assert page.evaluate(UNREADABLE) == []


def test_a_print_is_short_and_keeps_its_colours(page):
    """Answer and tool, table, four figures a sheet, six cards a sheet; all with their colours."""
    pdf = page.pdf(prefer_css_page_size=True)
    sheets = len(re.findall(rb"/Type */Page\b", pdf))
    figures = page.locator("main section > figure > .enlarge").count()
    cards = page.locator("dialog.card").count()
    assert figures / 4 < sheets <= 2 + -(-figures // 4) + -(-cards // 6)
    drawn = b""
    for stream in re.findall(rb"stream\r?\n(.*?)endstream", pdf, re.DOTALL):
        with contextlib.suppress(zlib.error):
            drawn += zlib.decompressobj().decompress(stream)
    filled = {
        tuple(round(255 * float(part)) for part in colour)
        for colour in re.findall(rb"([\d.]+) ([\d.]+) ([\d.]+) rg", drawn)
    }
    assert {ImageColor.getrgb(colour) for colour in AGREEMENT.values()} <= filled
    still = page.locator("#still").evaluate("one => one.toDataURL()")
    still = np.array(picture_in(still))
    assert np.ptp(still.reshape(-1, 3), axis=0).min() > 100


def test_a_print_has_the_cards_and_the_whole_table(page):
    page.emulate_media(media="print")
    assert not page.locator("dialog.card:not(:visible)").count()
    assert not page.locator(":is(#blink, #large):visible").count()
    table = page.locator("#patch-table")
    page.set_viewport_size({"width": 720, "height": 1000})  # A4 less its margins
    assert table.bounding_box()["width"] <= 720


def test_the_table_sorts(page, finished_tiny):
    table = read_table(finished_tiny.results / "tables/patch_pressures.csv")
    heading = page.locator("#patch-table th", has_text="Pressure")

    def patches():
        return page.locator("#patch-table tbody th").all_inner_texts()

    assert patches() == list(table.patch)
    for order, ascending in (("descending", False), ("ascending", True)):
        heading.locator("button").click()
        assert heading.get_attribute("aria-sort") == order
        ordered = table.sort_values("pressure_MPa", ascending=ascending, kind="stable")
        assert patches() == list(ordered.patch)
    page.locator("#patch-table th button", has_text="Patch").click()
    assert heading.get_attribute("aria-sort") == "none"
    assert patches() == sorted(table.patch, key=int)


@SIZES
def test_nothing_sticks_out_of_the_page(page, size):
    width, height = size
    page.set_viewport_size({"width": width, "height": height})
    for details in page.locator("summary").all():
        details.click()
    assert page.evaluate("document.documentElement.scrollWidth") == width
    page.evaluate(
        "document.querySelectorAll('dialog.card').forEach(card => card.show())"
    )
    assert page.evaluate("document.documentElement.scrollWidth") == width
    # every picture is there, whole
    assert page.locator("main .enlarge img").count() > 8
    assert page.locator("main .enlarge img").evaluate_all(
        "all => all.every(one => Math.abs(one.width / one.height"
        " - one.naturalWidth / one.naturalHeight) < 0.01 * one.width / one.height)"
    )


def test_headings_names_and_labels_are_as_accessibility_asks(page):
    levels = page.locator("h1, h2, h3").evaluate_all(
        "all => all.map(one => +one.tagName[1])"
    )
    assert levels.count(1) == levels[0] == 1
    assert max(np.diff(levels)) <= 1
    assert page.locator("html").get_attribute("lang") == "en"
    nameless = (
        "img:not([alt]), main img[alt=''], th:not([scope]), input:not([aria-label])"
    )
    assert page.locator(nameless).count() == 0
    missing = "all => all.filter(one => !document.querySelector(one.getAttribute('href'))).length"
    assert page.locator("a[href^='#']").evaluate_all(missing) == 0


def test_the_keyboard_reaches_every_control(used_page):
    count = used_page.evaluate("""() => {
      window.left = new Set([...document.querySelectorAll(
        "a[href], button, input, summary, canvas, [tabindex='0']")].filter((one) =>
        one.checkVisibility() && !(one.type === "radio" && !one.checked)));
      document.addEventListener("focusin", (event) => left.delete(event.target));
      return left.size;
    }""")
    assert count > 50
    for _ in range(count + 2):
        used_page.keyboard.press("Tab")
    left = "[...left].map((one) => one.outerHTML.slice(0, 80))"
    assert used_page.evaluate(left) == []


def test_without_scripts_the_answer_and_the_figures_are_there(browser, address):
    with browser.new_page(java_script_enabled=False) as page:
        page.goto(f"{address}#patch-13")
        assert page.locator(".verdict").is_visible()
        assert page.locator("#patch-13").is_visible()
