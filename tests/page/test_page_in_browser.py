"""The page as a reader has it: opened from disk, in a Chromium."""

import csv
import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import sync_playwright

from galton.analysis.plots import draw_level, draw_series, finish, panels
from galton.analysis.scales import from_best
from galton.analysis.statistics import Interval
from galton.page.page import Answer, Cell, Claim, Matrix, Section, Table, render

from . import browser

STEPS = np.array([1.0, 10.0, 100.0, 1000.0, 10000.0])
NAMES = ("Gaussian", 'HL, "Gauss"')
MEANS = dict(zip(NAMES, (np.array([-25.25, -22.5, -21.0, -20.75, -20.01]), np.linspace(-24.0, -18.0, 5)), strict=True))
INTERVALS = {name: Interval(mean, mean - 1.5, mean + 1.25) for name, mean in MEANS.items()}
RUNS = {name: mean + np.array([[-2.0], [-1.0], [1.0], [2.0]]) for name, mean in MEANS.items()}
PUBLISHED = sorted((Path(__file__).parents[2] / "results").glob("*/index.html"))
DESKTOP, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}


def draw():
    figure, axes = panels(3)
    for i, panel in enumerate(axes):
        for name, color in zip(NAMES, ("#000000", "#0072B2"), strict=True):
            draw_series(panel, STEPS, INTERVALS[name], name, color, single_runs=RUNS[name])
        draw_level(panel, -17.5, "optimum", "--")
        panel.set_title(f"Task {i}")
        panel.set_xlabel("steps")
    axes[1].set_xscale("log")
    from_best(axes[2], "y", -17.5, 0.5, (-30.0, -17.0))
    finish(figure, axes)
    return figure


def bars():
    figure, (axes,) = panels(1)
    axes.bar([0, 1, 2], [3, 5, 4])
    return figure


def shared():
    figure, axes = panels(3)
    image = axes[0].imshow(np.eye(3))
    figure.colorbar(image, ax=axes)
    return figure


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    table = Table([f"a heading of column {i}" for i in range(8)], [["−1.25 ± 0.5"] * 8])
    cells = [Cell("4 of 6", "holds in part"), Cell("0 of 6", "does not hold"), Cell("not trained")]
    rows = {"a change of which much is said": cells, "another": cells[::-1]}
    matrix = Matrix("change", [f"the {i} claim of the paper" for i in range(3)], rows)
    sections = [
        Section("curves", "Learning curves", "A caption of some length. " * 9, draw(), table),
        Section("changes", "Changes", table=matrix, is_first=True),
        Section("bars", "Bars", "Without series.", bars()),
        Section("shared", "With a colour bar", "Which can't be divided.", shared()),
    ]
    claims = [Claim("§5", "It works. " * 12, "Ours − theirs", "1.0 [0.5, 1.5]", "holds", "Above 0.", "curves")]
    path = tmp_path_factory.mktemp("page") / "index.html"
    answer = Answer(
        ["It depends. " * 6, "More. " * 20], dataclasses.replace(matrix, narrow=True, columns=["a", "b", "c"])
    )
    answer = dataclasses.replace(answer, figure=draw(), note="A note. " * 9)
    text = render("A title that is longer than a line", ["Words. " * 30], claims, sections, answer)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def chromium():
    path = browser.find()
    if not browser.starts(path):
        pytest.fail(f"the browser is {path}. {browser.MISSING}")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=path, args=list(browser.ARGUMENTS))
        yield running
        running.close()


@pytest.fixture
def opened(chromium, file):
    """Opens the page; fails in the end if it said, threw or asked for anything."""
    contexts, paths, said, asked = [], [], [], []

    def open_page(viewport=None, path=file, **options):
        contexts.append(chromium.new_context(viewport=viewport or DESKTOP, **options))
        page = contexts[-1].new_page()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.on("requestfailed", lambda request: said.append(request.url))
        paths.append(path.as_uri())
        page.goto(paths[-1])
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert said == []
    assert [url for url in asked if not url.startswith("blob:")] == paths


def hover(page, i, x, scale=float):
    """Puts the mouse over panel i where the x axis says x."""
    hit = page.locator("#curves .hit").nth(i)
    hit.scroll_into_view_if_needed()
    box = hit.bounding_box()
    low, high = map(
        scale, page.evaluate(f"JSON.parse(document.querySelector('#curves script').text).panels[{i}].x.limits")
    )
    share = (scale(x) - low) / (high - low)
    page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)


def rows(page):
    return [row.locator("td").all_inner_texts() for row in page.locator("#curves .tip tr").all()]


def number(value):
    return (f"{value:.0f}" if value == int(value) else f"{value:#.4g}").replace("-", "−")


def expected(k):
    """The tooltip's rows at the k-th x."""
    values = [(name, *(number(end[k]) for end in interval)) for name, interval in INTERVALS.items()]
    return [*([name, mean, f"[{low}, {high}]"] for name, mean, low, high in values), ["optimum", "−17.50", ""]]


@pytest.mark.parametrize(("i", "scale"), [(0, float), (1, np.log)])
def test_the_mouse_reads_the_values_at_the_nearest_x(opened, i, scale):
    page = opened()
    hover(page, i, 9300, scale)
    assert page.locator("#curves .tip caption").inner_text() == "steps: 10,000"
    assert rows(page) == expected(4)
    hover(page, i, 1100, scale)
    assert page.locator("#curves .tip caption").inner_text() == "steps: 1,000"
    assert rows(page) == expected(3)
    assert page.locator("#curves .guide circle").count() == 3
    page.mouse.move(1, 1)
    assert page.locator("#curves .tip").is_hidden()


def test_a_tap_reads_and_a_tap_elsewhere_lets_go(opened):
    page = opened(PHONE, has_touch=True)
    for i in (1, 0):
        hit = page.locator("#curves .hit").nth(i)
        hit.scroll_into_view_if_needed()
        hit.tap(position={"x": hit.bounding_box()["width"] - 2, "y": 20})
        assert rows(page) == expected(4)
        inside = page.locator("#curves .tip").bounding_box()
        assert 0 <= inside["x"] <= inside["x"] + inside["width"] <= PHONE["width"]
    page.locator("h2").first.tap()
    assert page.locator("#curves .tip").is_hidden()


def test_arrow_keys_walk_along_the_curves(opened):
    page = opened()
    panel = page.locator("#curves .hit").nth(1)
    page.locator("#curves .hit").nth(0).focus()
    page.keyboard.press("Tab")
    assert panel.evaluate("hit => hit === document.activeElement")
    for key, k in (("Home", 0), ("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1), ("End", 4), ("ArrowRight", 4)):
        page.keyboard.press(key)
        assert rows(page) == expected(k)
    assert "−17.50" in panel.get_attribute("aria-valuetext")
    page.keyboard.press("Escape")
    assert page.locator("#curves .tip").is_hidden()


def test_a_series_goes_from_all_panels_and_comes_back(opened):
    page = opened()
    button = page.locator("#curves").get_by_role("button", name=NAMES[1])
    marks = page.locator('#curves [data-series="1"]:not(.run)')
    assert marks.count() == 2 * 3
    for shown in (False, True):
        button.click()
        assert button.get_attribute("aria-pressed") == str(shown).lower()
        assert all(mark.is_visible() == shown for mark in marks.all())
        hover(page, 2, 1000)
        assert [name for name, *_ in rows(page)] == [name for name, *_ in expected(3) if shown or name != NAMES[1]]


def test_single_runs_are_shown_on_demand_and_go_with_their_series(opened):
    page = opened()
    runs = page.locator("#curves .run")
    assert runs.count() == 3 * 2 * 4
    assert not any(run.is_visible() for run in runs.all())
    page.locator("#curves").get_by_role("button", name="Show single runs").click()
    assert all(run.is_visible() for run in runs.all())
    page.locator("#curves").get_by_role("button", name=NAMES[0]).click()
    assert sum(run.is_visible() for run in runs.all()) == 3 * 4
    page.locator("#curves").get_by_role("button", name="Show single runs").click()
    assert not any(run.is_visible() for run in runs.all())
    assert page.locator("#bars .runs").count() == 0


def test_the_download_holds_what_is_drawn(opened, tmp_path):
    page = opened(accept_downloads=True)
    with page.expect_download() as download:
        page.locator("#curves .download").click()
    assert download.value.suggested_filename == "curves.csv"
    download.value.save_as(tmp_path / "curves.csv")
    with (tmp_path / "curves.csv").open(newline="", encoding="utf-8") as file:
        heading, *lines = csv.reader(file)
    assert heading == ["panel", "series", "x", "mean", "low", "high"]
    assert len(lines) == 3 * (2 * 5 + 1)
    assert lines[10] == ["Task 0", "optimum", "", "-17.5", "", ""]
    assert [line[1] for line in lines[11:21]] == [NAMES[0]] * 5 + [NAMES[1]] * 5
    numbers = np.array([line[2:] for line in lines[16:21]], float)
    np.testing.assert_array_equal(numbers.T, [STEPS, *INTERVALS[NAMES[1]]])


@pytest.mark.parametrize("viewport", [DESKTOP, PHONE, {"width": 820, "height": 1100}])
def test_the_page_is_as_wide_as_the_screen(opened, viewport):
    page = opened(viewport)
    page.locator("summary").click()
    assert page.evaluate("document.documentElement.scrollWidth") <= viewport["width"]
    for svg in page.locator(".panels:not(.whole) svg").all():
        box = svg.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= viewport["width"]
    image = page.locator("#shared image").first.bounding_box()
    assert image["height"] > 50  # scrolled, not shrunk
    assert page.locator(".claims thead").is_visible() == (viewport is not PHONE)


def test_the_guide_marks_the_curve_where_it_is_drawn_on_any_scale(opened):
    page = opened()
    for i in range(3):
        hover(page, i, 9300, np.log if i == 1 else float)
        tops = [circle.bounding_box()["y"] for circle in page.locator("#curves .guide circle").all()]
        line = page.locator(f"#curves .panels > svg:nth-of-type({i + 1}) .mark[data-series='0'] > path").last
        end = line.evaluate("path => { const to = path.getPointAtLength(path.getTotalLength()); "
                            "return new DOMPoint(to.x, to.y).matrixTransform(path.getScreenCTM()).y }")  # fmt: skip
        assert min(abs(top + 3.5 - end) for top in tops) < 2


@pytest.mark.slow
@pytest.mark.parametrize("viewport", [{"width": 1440, "height": 900}, PHONE], ids=["desktop", "phone"])
@pytest.mark.parametrize("published", PUBLISHED, ids=lambda path: path.parent.name)
def test_a_published_page_opens_in_silence_and_is_no_wider_than_the_screen(opened, published, viewport):
    page = opened(viewport, published)
    assert page.locator("h1").bounding_box()["y"] < viewport["height"]
    assert page.evaluate("document.documentElement.scrollWidth") <= viewport["width"]


@pytest.mark.parametrize("viewport", [{"width": 1440, "height": 900}, {"width": 390, "height": 844}])
def test_the_first_screen_has_the_answer_and_all_rows(opened, viewport):
    page = opened(viewport)
    for inside in (".answer .lead", ".answer .matrix"):
        box = page.locator(inside).bounding_box()
        assert box["y"] + box["height"] <= viewport["height"]
    beside = (
        page.locator(".answer figure").bounding_box()["x"] > page.locator(".answer .matrix").bounding_box()["x"] + 10
    )
    assert beside == (viewport["width"] > 1000)


def test_on_a_phone_each_row_of_verdicts_is_a_card_that_names_its_columns(opened):
    page = opened(PHONE)
    cell = page.locator("#changes td").first
    assert "the 0 claim of the paper" in cell.evaluate(
        "cell => getComputedStyle(cell, '::before').content + cell.dataset.label"
    )
    assert page.locator("#changes thead").is_hidden()
    assert page.locator("#page\\.answer thead").is_visible()


def luminance(page, selector, what):
    color = page.locator(selector).first.evaluate(f"element => getComputedStyle(element).{what}")
    return np.array([float(part) for part in re.findall(r"[\d.]+", color)[:3]]) / 255 @ [0.2126, 0.7152, 0.0722]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_theme_is_the_systems_until_the_button_says_otherwise(opened, scheme):
    page = opened(color_scheme=scheme)
    button = page.locator(".theme")
    for dark in (scheme == "dark", scheme != "dark"):
        assert button.get_attribute("aria-pressed") == str(dark).lower()
        assert (luminance(page, "body", "backgroundColor") < 0.5) == dark
        for selector, what in (("body", "color"), ("#curves .panels text", "fill"), ("#curves .mark > path", "stroke")):
            assert (luminance(page, selector, what) > 0.5) == dark
        assert len(page.screenshot()) > 20_000
        button.click()


def test_print_is_light_and_shows_what_was_folded(opened):
    page = opened(color_scheme="dark")
    page.emulate_media(media="print")
    assert luminance(page, "body", "backgroundColor") > 0.5
    assert page.get_by_text("Words. Words.").is_visible()
    assert page.locator(".theme").is_hidden()
    assert len(page.pdf()) > 20_000


def test_without_the_script_there_is_everything_but_what_needs_it(opened):
    page = opened(java_script_enabled=False)
    assert page.locator("#curves .panels svg").count() == 3
    assert page.locator("#curves").get_by_role("button", name=NAMES[0]).is_visible()
    assert page.locator("#curves .run").first.is_hidden()
    assert page.locator("#curves .tools").is_hidden()
    assert page.locator(".theme").is_hidden()
