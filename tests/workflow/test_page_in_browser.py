"""The page of the tiny study in a real browser, opened from its file."""

import base64
import contextlib
import io
import itertools
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

from gst.config.tables import TABLES
from gst.page.figures.style import AGREEMENT
from gst.page.page import Shown
from gst.page.results import Results
from gst.page.study_page import write_study_page
from gstlib.io.store import write_dataset
from gstlib.io.tables import read_table

from .conftest import listened_to, middle_of, opened

pytestmark = pytest.mark.browser

PHONE = {"width": 390, "height": 844}


@pytest.fixture
def page(browser, finished_tiny):
    with opened(browser, finished_tiny.results / "index.html") as page:
        yield page


@pytest.fixture(scope="module")
def draws(finished_tiny):
    """Uses of the tiny study's tool, made up: its own scans are too few to infer one."""
    generator = np.random.default_rng(1)
    patches = list(read_table(finished_tiny.results / "tables/registration.csv").patch)
    x, y = generator.normal([[2.2], [3.1]], 0.2, (2, 500))
    pressure = generator.uniform(0, 90, (500, len(patches))) * x[:, np.newaxis]
    weight = generator.uniform(0, 1, 500)
    about = {"units": "1", "long_name": "made up"}
    columns = {"x_mm": x, "y_mm": y, "weight": weight / weight.sum()}
    columns["wear_coefficient"] = generator.uniform(0.005, 0.01, 500)
    variables = {name: ("draw", each, about) for name, each in columns.items()}
    variables["pressure"] = ("draw", "patch"), pressure, about
    return xr.Dataset(
        variables, {"patch": patches}, {"adopted": 1, "answer": "pressed"}
    )


@pytest.fixture(scope="module")
def used(finished_tiny, draws, config, tmp_path_factory):
    """The page of the tiny study as if it had inferred that use; with a fault, fault.html."""
    folder, results = tmp_path_factory.mktemp("used"), finished_tiny.results
    write_dataset(folder / "use.h5", draws)
    rows = ("load_point_x", 2.5, 2.2), ("load_point_y", 2.5, 3.1), ("spread", None, 0.3)
    use = pd.DataFrame(rows, columns=["parameter", "prior", "posterior_mean"])
    use = use.assign(low=0.1, high=3.4, answer="pressed", competitor="", adopted="yes")
    use.to_csv(folder / "use.csv", index=False)
    measured = read_table(results / "tables/registration.csv").mean_wear_depth_um
    losses = pd.DataFrame({"patch": draws.patch.values, "loss_um": measured})
    losses.to_csv(folder / "predicted_losses.csv", index=False)
    tables = [*results.glob("tables/*.csv"), *folder.glob("*.csv")]
    files = {file.name: file for file in tables if file.stem in TABLES}
    files |= {"mesh": results / "specimen/mesh.stl", "use": folder / "use.h5"}
    macroscale = results / "macroscale"
    files |= {name: macroscale / f"{name}.h5" for name in ("surface", "contact")}
    files |= {
        "by_patch": results / "figures/patch",
        "strips": results / "figures/strip",
    }
    names = ["patch", "x_mm", "y_mm", "rotation_deg"]
    patches = read_table(results / "tables/patch_pressures.csv")[names]
    study = Results(
        files,
        places=patches.assign(t0="a.plu", t1="b.plu").to_dict("list"),
        size_mm=5.0,
        patch_mm=0.85,
        force_N=550.0,
    )
    figures = [
        Shown(file, "5 Validation", file.stem, "made before")
        for file in sorted(results.glob("figures/*.png"))
    ]
    none = {"steps": [], "active_tool": None, "methods": "Methods."}
    for name, faults in {"index": [], "fault": [{"text": "a fault"}]}.items():
        about = none | {"config_faults": faults}
        write_study_page(folder / f"{name}.html", study, config, figures, **about)
    return folder / "index.html"


@pytest.mark.parametrize("size", [(1366, 768), (390, 844)], ids=["screen", "phone"])
def test_the_map_and_its_load_points_are_on_the_first_screen(
    browser, used, draws, size
):
    with opened(browser, used, size) as page:
        box = page.locator("#map").bounding_box()
        assert box["y"] + box["height"] < size[1]
        answer = page.locator(".lead").bounding_box()
        beside = answer["x"] > box["x"] + box["width"]
        assert beside if size[0] > 1000 else answer["y"] < box["y"]
        left, top, side = (
            page.locator("#map .frame").first.bounding_box()[of]
            for of in ("x", "y", "width")
        )
        mean = [float(draws.weight @ draws[name]) for name in ("x_mm", "y_mm")]
        for kind, (x, y) in {"given": (2.5, 2.5), "inferred": mean}.items():
            at = middle_of(page.locator(f"#map use[data-kind={kind}]"))
            there = left + x / 5 * side, top + (1 - y / 5) * side
            assert at == pytest.approx(there, abs=2)
        region = middle_of(page.locator("#map ellipse.region"))
        assert region == pytest.approx(
            middle_of(page.locator("#map use[data-kind=inferred]")), abs=2
        )
        assert "outside" in page.locator(".legend").inner_text()


def test_an_accepted_fault_stands_above_the_answer(browser, used):
    with opened(browser, used.with_name("fault.html")) as page:
        fault, answer = (page.locator(one) for one in (".fault", ".lead"))
        assert "a fault" in fault.locator("li").inner_text()
        below = fault.bounding_box()
        assert below["y"] + below["height"] <= answer.bounding_box()["y"]
        assert page.locator("#map ellipse.region, #explorer").count() == 2


def cells(page):
    """The table of the explorer: of each patch pressure, predicted and measured loss."""
    rows = page.locator("#asked tbody tr").all()
    texts = [row.locator("td").all_inner_texts() for row in rows]
    return {name: [float(value) for value in values] for name, *values in texts}


def test_a_click_on_the_map_shows_what_the_nearest_draws_did(browser, used, draws):
    losses = pd.read_csv(used.parent / "predicted_losses.csv", dtype={"patch": str})
    with opened(browser, used) as page:
        box = page.locator("#map .frame").first.bounding_box()
        at = box["x"] + 0.5 * box["width"], box["y"] + 0.3 * box["height"]
        page.mouse.click(*at)  # beside the patches
        x, y = (
            float(page.locator(f"#explorer [name={axis}]").input_value())
            for axis in "xy"
        )
        assert (x, y) == pytest.approx((2.5, 3.5), abs=0.03)
        away = np.hypot(draws.x_mm - x, draws.y_mm - y).values
        nearest = draws.isel(draw=np.argsort(away)[:50])
        worth = nearest.weight / nearest.weight.sum()
        pressure = (worth * nearest.pressure).sum("draw")
        loss = (worth * nearest.wear_coefficient * nearest.pressure).sum("draw")
        wanted = np.stack([pressure, loss, losses.loss_um], axis=1)
        shown = cells(page)
        assert list(shown) == list(losses.patch)
        np.testing.assert_allclose(list(shown.values()), wanted, rtol=6e-3, atol=5e-3)
        told = page.locator("#asked-how").inner_text()
        likely = 100 * float(draws.weight[away <= 0.425].sum())
        assert float(re.search(r"([\d.]+) %", told)[1]) == pytest.approx(
            likely, rel=6e-3
        )
        assert middle_of(page.locator("#asked-at")) == pytest.approx(at, abs=2)


def test_a_load_far_from_all_draws_or_beyond_the_face_has_no_numbers(
    browser, used, draws
):
    with opened(browser, used) as page:
        page.fill("#explorer [name=x]", "2.2")
        page.press("#explorer [name=x]", "Enter")
        assert page.locator("#asked").is_visible()
        page.fill("#explorer [name=x]", "4.9")
        page.click("#explorer button")
        text = page.locator("#asked-how").inner_text()
        y = float(page.locator("#explorer [name=y]").input_value())
        nearest = float(np.hypot(draws.x_mm - 4.9, draws.y_mm - y).min())
        assert text.startswith("No draw of the load point lies within")
        assert numbers(text)[-1] == pytest.approx(nearest, rel=6e-3)
        assert not page.locator("#asked").is_visible()
        page.fill("#explorer [name=x]", "99")
        page.click("#explorer button")
        text = page.locator("#asked-how").inner_text()
        assert "outside the face" in text
        assert numbers(text)[-2:] == [-2.5, 7.5]
        assert not page.locator("#asked, #asked-at").first.is_visible()
        box = page.locator("#map").bounding_box()  # beyond the map, on the face
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] - 4)
        assert "No draw" in page.locator("#asked-how").inner_text()


def numbers(text):
    texts = re.findall(r"\N{MINUS SIGN}?\d+(?:\.\d+)?", text)
    return [float(one.replace("\N{MINUS SIGN}", "-")) for one in texts]


def test_cards_and_explorer_work_in_the_sandbox_of_gst_place(browser, used):
    """Where forms are dead: their buttons have scripts."""
    page = browser.new_page()
    policy = {"Content-Security-Policy": "sandbox allow-scripts allow-downloads"}
    answer = {"path": used, "headers": policy, "content_type": "text/html"}
    page.route("**", lambda route: route.fulfill(**answer))
    _, complaints = listened_to(page)
    page.goto("http://place.test/results/index.html")
    page.click("#patch-table a[href='#patch-13']")
    page.click("#patch-13 form button")
    page.locator("#patch-13").wait_for(state="hidden")
    page.click("#explorer button")
    assert page.locator("#asked").is_visible()
    assert saved(page, lambda: save_everything(page)).startswith(b"PK")
    page.click("#show-methods")
    page.click("#copy-methods")
    assert page.locator("#copied").inner_text() == "Copied."
    assert complaints == []
    page.close()


def save_everything(page):
    page.locator("#save summary").focus()
    page.keyboard.press("Enter")
    page.click("[data-save='']")


def saved(page, click):
    with page.expect_download() as download:
        click()
    return Path(download.value.path()).read_bytes()


def test_a_copy_of_the_page_alone_saves_all_that_it_shows(
    browser, finished_tiny, tmp_path
):
    results, alone = finished_tiny.results, tmp_path / "alone.html"
    shutil.copy(results / "index.html", alone)
    with opened(browser, alone) as page:

        def chosen(folder):
            page.locator("#save summary").focus()
            page.keyboard.press("Enter")
            return saved(page, page.locator(f"[data-save='{folder}']").click)

        whole = chosen("")
        assert chosen("") == whole
        methods = chosen("methods.txt").decode()
        with zipfile.ZipFile(io.BytesIO(whole)) as archive:
            assert archive.testzip() is None
            content = {name: archive.read(name) for name in archive.namelist()}
        figures = {name: content.pop(name) for name in [*content] if "figures" in name}
        assert content.pop("methods.txt").decode() == methods
        assert "with 550 N" in methods
        assert "doi:10.1016/j.jasrep.2024.104939" in methods
        tables = {*results.glob("tables/*.csv")}
        tables.remove(results / "tables/microscale_paths.csv")
        stored = {f"tables/{file.name}": file.read_bytes() for file in tables}
        assert content == stored
        patterns = "figures/*.png", "figures/*.svg", "figures/patch/*.png"
        drawn = [file for pattern in patterns for file in results.glob(pattern)]
        assert {results / name for name in figures} == {*drawn}
        for file in drawn:
            one = figures[file.relative_to(results).as_posix()]
            if file.suffix == ".svg":
                assert one == file.read_bytes()
            else:
                off = ImageChops.difference(
                    picture_in(one), picture_in(file.read_bytes())
                )
                assert max(ImageStat.Stat(off).mean) < 3
        link = page.locator("a[href='figures/wear.svg']")
        assert saved(page, link.click) == figures["figures/wear.svg"]
        page.click("#show-methods")
        assert page.locator("#methods-text").text_content() == methods
        page.click("#copy-methods")
        page.wait_for_function("document.getElementById('copied').textContent")
        assert page.evaluate("getSelection().toString()").strip() == methods.strip()


def test_turning_the_tool_and_its_light_change_the_picture(page):
    canvas = page.locator("#viewer canvas")
    pictures = [canvas.screenshot()]
    for change in (
        lambda: canvas.press("ArrowLeft"),
        lambda: page.locator("#azimuth").fill("120"),
        lambda: page.click("#see-square"),
    ):
        change()
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
    card.wait_for(state="detached" if card.count() == 0 else "hidden")
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


def test_a_card_has_its_pictures_and_they_open_large(page):
    page.click("#patch-table a[href='#patch-13']")
    page.locator("#patch-13 .enlarge").click()
    wide = page.evaluate("document.querySelector('#large img').naturalWidth")
    assert wide > 700
    assert page.locator("#large img").bounding_box()["width"] == wide


def test_a_card_opened_by_its_address_closes_and_fits_the_screen(
    browser, finished_tiny
):
    address = (finished_tiny.results / "index.html").as_uri() + "#patch-13"
    page = browser.new_page(viewport={"width": 1366, "height": 768})
    page.goto(address)
    card = page.locator("#patch-13")
    assert card.is_visible()
    picture = card.locator(".enlarge img").bounding_box()
    assert picture["y"] + picture["height"] < 768
    assert "13_T0.plu → 13_T1.plu" in card.inner_text()
    card.locator("form button").click()
    card.wait_for(state="hidden")
    page.close()


def test_the_map_shows_pressure_or_measured_loss(page):
    shown = "all => all.map(one => one.getAttribute('display'))"
    assert page.locator("#map image").evaluate_all(shown) == ["inline", "none"]
    page.get_by_role("radio", name="measured loss").check()
    assert page.locator("#map image").evaluate_all(shown) == ["none", "inline"]
    assert page.locator(".scale.field:visible").inner_text().endswith("µm")


def picture_in(data):
    return Image.open(io.BytesIO(data)).convert("RGB")


def test_thumbnails_lead_to_cards_where_t0_and_t1_are_compared(page):
    strip = page.locator(".thumbnails a[href='#patch-13'] img").get_attribute("src")
    strip = picture_in(base64.b64decode(strip.partition("base64,")[2]))
    page.click(".thumbnails a[href='#patch-13']")
    page.click("#patch-13 .blink")
    picture = page.locator("#blink-picture")
    for number, epoch in enumerate(
        ("T0", "T1")
    ):  # the first two of the strip's three maps
        shown = picture_in(picture.screenshot())
        maps = [
            strip.crop((k * strip.height, 0, (k + 1) * strip.height, strip.height))
            for k in range(3)
        ]
        off = [
            ImageStat.Stat(ImageChops.difference(shown, one.resize(shown.size))).sum
            for one in maps
        ]
        assert np.sum(off, axis=1).argmin() == number
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
def test_text_stands_out_in_both_colour_schemes(browser, finished_tiny, scheme):
    """By WCAG's contrast of at least 4.5, of the answer, links and notes on their ground."""
    page = browser.new_page(color_scheme=scheme)
    page.goto((finished_tiny.results / "index.html").as_uri())
    contrast = """one => {
      const parse = (colour) => colour.match(/[\\d.]+/g).map(Number);
      const ground = (node) => {
        for (; node; node = node.parentElement) {
          const colour = parse(getComputedStyle(node).backgroundColor);
          if (colour.length === 3 || colour[3] > 0) return colour;
        }
        return [255, 255, 255];
      };
      const bright = (colour) => colour.slice(0, 3).map((part) => part / 255)
        .map((part) => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4)
        .reduce((sum, part, k) => sum + part * [0.2126, 0.7152, 0.0722][k], 0);
      const both = [bright(parse(getComputedStyle(one).color)), bright(ground(one))];
      return (Math.max(...both) + 0.05) / (Math.min(...both) + 0.05);
    }"""
    for place in (
        ".verdict dd",
        ".verdict dt",
        ".deliver button",
        "summary",
        "td .interval",
        "nav a",
        "figcaption",
        ".mark",
        "th",
        "footer p",
    ):
        assert page.locator(place).first.evaluate(contrast) >= 4.5, place
    page.close()


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
    still = np.array(picture_in(base64.b64decode(still.partition("base64,")[2])))
    assert np.ptp(still.reshape(-1, 3), axis=0).min() > 100


def test_a_print_has_the_cards_and_the_whole_table(page):
    page.emulate_media(media="print")
    assert page.locator("dialog.card").evaluate_all(
        "all => all.every(one => one.offsetHeight > 0)"
    )
    assert page.locator("#blink, #large").evaluate_all(
        "all => all.every(one => !one.offsetHeight)"
    )
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


@pytest.mark.parametrize("size", [None, PHONE], ids=["screen", "phone"])
def test_nothing_sticks_out_of_the_page(page, size):
    page.set_viewport_size(size or page.viewport_size)
    width = page.viewport_size["width"]
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
    assert levels.count(1) == 1
    assert levels[0] == 1
    assert all(after - before <= 1 for before, after in itertools.pairwise(levels))
    assert page.locator("html").get_attribute("lang") == "en"
    nameless = (
        "img:not([alt]), main img[alt=''], th:not([scope]), input:not([aria-label])"
    )
    assert page.locator(nameless).count() == 0
    missing = "all => all.filter(one => !document.querySelector(one.getAttribute('href'))).length"
    assert page.locator("a[href^='#']").evaluate_all(missing) == 0


def test_the_keyboard_reaches_every_control(browser, used):
    with opened(browser, used) as page:
        count = page.evaluate("""() => {
          window.left = new Set([...document.querySelectorAll(
            "a[href], button, input, summary, canvas, [tabindex='0']")].filter((one) =>
            one.checkVisibility() && !(one.type === "radio" && !one.checked)));
          document.addEventListener("focusin", (event) => left.delete(event.target));
          return left.size;
        }""")
        assert count > 50
        for _ in range(count + 2):
            page.keyboard.press("Tab")
        assert page.evaluate("[...left].map((one) => one.outerHTML.slice(0, 80))") == []


def test_without_scripts_the_answer_and_the_figures_are_there(browser, finished_tiny):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto((finished_tiny.results / "index.html").as_uri() + "#patch-13")
    assert page.locator(".verdict").is_visible()
    assert page.locator("#patch-13").is_visible()
    context.close()
