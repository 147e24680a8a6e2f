"""The page of the tiny study in a real browser, opened from its file."""

import re

import pytest
from gstlib.io.tables import read_table

from .conftest import middle_of, opened

pytestmark = pytest.mark.browser


@pytest.fixture
def page(browser, finished_tiny):
    with opened(browser, finished_tiny.results / "index.html") as page:
        yield page


def test_turning_the_tool_and_its_light_change_the_picture(page):
    canvas = page.locator("#viewer canvas")
    pictures = {canvas.screenshot()}
    canvas.press("ArrowLeft")
    pictures.add(canvas.screenshot())
    page.locator("#azimuth").fill("120")
    pictures.add(canvas.screenshot())
    page.click("#see-square")
    pictures.add(canvas.screenshot())
    assert len(pictures) == 4


def opened_card(page):
    """The patch whose card is open; the card is closed again."""
    card = page.locator("dialog[open]")
    card.wait_for()
    number = re.match(r"Patch \S+", card.locator("h2").inner_text())[0]
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
    page.wait_for_function("element => element.style.opacity === '1'", arg=number.element_handle())
    page.mouse.click(*middle_of(number))
    assert opened_card(page) == "Patch 16"
    page.locator("#map a[href='#patch-5']").focus()
    page.keyboard.press("Enter")
    assert opened_card(page) == "Patch 5"


def test_the_map_shows_pressure_or_measured_loss(page):
    display = "all => all.map(one => one.getAttribute('display'))"
    assert page.locator("#map image").evaluate_all(display) == ["inline", "none"]
    page.get_by_label("measured loss").check()
    assert page.locator("#map image").evaluate_all(display) == ["none", "inline"]
    assert page.locator(".scale.field:visible").inner_text().endswith("µm")


def test_a_card_compares_t0_and_t1(page):
    page.click(".thumbnails a[href='#patch-13']")
    page.click("#patch-13 .blink")
    picture = page.locator("#blink-picture")
    for epoch in ("T0", "T1"):
        assert epoch in picture.get_attribute("aria-label")
        page.click("#blink-now")


def test_the_table_sorts(page, finished_tiny):
    table = read_table(finished_tiny.results / "tables/patch_pressures.csv")
    heading = page.locator("#patch-table th", has_text="Pressure")
    for order in ("descending", "ascending"):
        heading.locator("button").click()
        assert heading.get_attribute("aria-sort") == order
        is_ascending = order == "ascending"
        ordered = table.sort_values("pressure_MPa", ascending=is_ascending, kind="stable")
        names = page.locator("#patch-table tbody th").all_inner_texts()
        assert names == list(ordered.patch)


def test_without_scripts_the_answer_and_the_figures_are_there(browser, finished_tiny):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto((finished_tiny.results / "index.html").as_uri() + "#patch-13")
    assert page.locator(".verdict").is_visible()
    assert page.locator("#patch-13").is_visible()
    context.close()
