"""The page of the tiny study in a real browser, opened from its file."""

import itertools
import re

import pytest
from gstlib.io.tables import read_table

from .conftest import opened

pytestmark = pytest.mark.browser

PHONE = {"width": 390, "height": 844}


@pytest.fixture
def page(browser, finished_tiny):
    with opened(browser, finished_tiny.results / "index.html") as page:
        yield page


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
    page.keyboard.press("Escape")
    card.wait_for(state="detached" if card.count() == 0 else "hidden")
    return title


def test_a_click_or_a_key_opens_the_card_of_the_patch(page):
    page.click("#patch-table tbody a >> text=/^13$/")
    assert opened_card(page) == "Patch 13"
    page.click("#map a[href='#patch-7']")
    assert opened_card(page) == "Patch 7"
    page.click("#see-square")
    number = page.locator("#viewer span", has_text=re.compile("^16$"))
    page.wait_for_function("element => element.style.opacity === '1'", arg=number.element_handle())
    box = number.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert opened_card(page) == "Patch 16"
    for place in ("#patch-table a[href='#patch-5']", "#map a[href='#patch-5']"):
        page.locator(place).focus()
        page.keyboard.press("Enter")
        assert opened_card(page) == "Patch 5"


def test_a_card_has_its_pictures_and_they_open_large(page):
    page.click("#patch-table a[href='#patch-13']")
    page.locator("#patch-13 .enlarge").click()
    wide = page.evaluate("document.querySelector('#large img').naturalWidth")
    assert wide > 700
    assert page.locator("#large img").bounding_box()["width"] == wide


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
    page.evaluate("document.querySelectorAll('dialog.card').forEach(card => card.show())")
    assert page.evaluate("document.documentElement.scrollWidth") == width
    # every picture is there, whole
    assert page.locator("main .enlarge img").count() > 8
    assert page.locator("main .enlarge img").evaluate_all(
        "all => all.every(one => Math.abs(one.width / one.height"
        " - one.naturalWidth / one.naturalHeight) < 0.01 * one.width / one.height)"
    )


def test_headings_names_and_labels_are_as_accessibility_asks(page):
    levels = page.locator("h1, h2, h3").evaluate_all("all => all.map(one => +one.tagName[1])")
    assert levels.count(1) == 1
    assert levels[0] == 1
    assert all(after - before <= 1 for before, after in itertools.pairwise(levels))
    assert page.locator("html").get_attribute("lang") == "en"
    nameless = "img:not([alt]), main img[alt=''], th:not([scope]), input:not([aria-label])"
    assert page.locator(nameless).count() == 0
    missing = "all => all.filter(one => !document.querySelector(one.getAttribute('href'))).length"
    assert page.locator("a[href^='#']").evaluate_all(missing) == 0


def test_without_scripts_the_answer_and_the_figures_are_there(browser, finished_tiny):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto((finished_tiny.results / "index.html").as_uri() + "#patch-13")
    assert page.locator(".verdict").is_visible()
    assert page.locator("#patch-13").is_visible()
    context.close()
