import base64
import dataclasses
import hashlib
import re
import urllib.parse
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser

import numpy as np
import pytest

from galton.errors import UsageError
from galton_experiments.analysis.plots import draw_level, draw_series, finish, panels, settle, svg
from galton_experiments.analysis.statistics import mean_interval
from galton_experiments.page.page import MARKS, VERDICTS, Answer, Cell, Claim, Matrix, Section, Table, render

HOSTILE = "</script><script>alert(1)</script><!-- <img src=x onerror=alert(2)> \"'&amp;"
STEPS = np.arange(1.0, 6.0) * 1000
RUNS = np.random.default_rng(0).normal(size=(4, 5)).cumsum(1)


class Document(HTMLParser):
    """What a page says and holds: text, and each element's tag and attributes in order."""

    def __init__(self, page):
        super().__init__()
        self.elements, self.text, self.raw = [], "", {"script": [], "style": []}
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))

    def handle_data(self, data):
        if self.elements and self.cdata_elem in self.raw:
            self.raw[self.cdata_elem].append(data)
        else:
            self.text += data

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


def figure(names=("Gaussian", "HL-Gauss"), color="#0072B2"):
    drawn, axes = panels(2)
    for panel in axes:
        for i, name in enumerate(names):
            draw_series(panel, STEPS, mean_interval(RUNS + i), name, color)
        draw_level(panel, 3.0, "optimum")
        panel.set_title(f"On {names[0]}")
        panel.set_xlabel("steps")
    finish(drawn, axes)
    return drawn


def claim(**changes):
    plain = Claim("§1", "It works.", "Ours − theirs", "1.0 [0.5, 1.5]", "holds", "The interval is above 0.", "curves")
    return dataclasses.replace(plain, **changes)


def page(claims=(), **changes):
    plain = Section("curves", "Curves", "A caption.", figure())
    return render("A title", ["First.", "Second."], claims, [dataclasses.replace(plain, **changes)])


def images(text):
    """The pictures of a page, as a browser reads them."""
    start = "data:image/svg+xml,"
    found = [attributes["src"] for attributes in Document(text).all("img")]
    assert all(address.startswith(start) for address in found)
    return [urllib.parse.unquote_to_bytes(address.removeprefix(start)) for address in found]


def matrix(**changes):
    rows = {"LQR": [Cell("5 of 6", "holds"), Cell("—")], "Ant": [Cell("0 of 2", "does not hold"), Cell("none")]}
    return dataclasses.replace(Matrix("task", ["ends higher", "learns faster"], rows), **changes)


def test_the_answer_comes_first_then_what_is_first_the_claims_the_contents_and_the_sections():
    sections = [Section("curves", "Curves", "A caption."), Section("before", "Before", table=matrix(), is_first=True)]
    answer = Answer(["It depends.", "On much."], matrix(narrow=True), "A note.", figure(), "In small.")
    text = render("A title", ["First.", "Second."], [claim(section=None)], sections, answer)
    parts = ["A title</h1>", "It depends.", "5 of 6", "On much.", "A note.", "In small.", ">Before<", ">Claims<"]
    places = [text.index(part) for part in [*parts, "Second.", "It works.", ">Contents<", "A caption."]]
    assert places == sorted(places)


def test_a_claim_leads_to_its_figure():
    text = page([claim(), claim(verdict="not decidable here", section=None)])
    links = [attributes["href"] for attributes in Document(text).all("a")]
    assert links == ["#curves"] * 2  # of the claim and of the contents


def test_each_verdict_is_counted_and_shown_with_a_sign_of_its_own():
    text = page([claim(verdict=verdict) for verdict in (*VERDICTS, VERDICTS[0])])
    counts = re.search(r'<ul class="counts">(.*?)</ul>', text, re.DOTALL)[1]
    assert re.findall(r"</svg> ([\w ]+) <b>(\d)</b>", counts) == [(VERDICTS[0], "2"), *((v, "1") for v in VERDICTS[1:])]
    assert len(set(re.findall(r"#page.sign-\d", counts))) == 4


def test_each_unit_of_a_claim_has_its_mark_and_the_claim_its_count():
    lines = [f"{mark} Task {i} +1.0" for i, mark in enumerate(MARKS)]
    text = page([claim(number="\n".join([*lines, "in all"]), count=(1, 3))])
    assert '<p class="count">1 of 3</p>' in text
    units = re.findall(r'<li><b(?: class="verdict-(\d)")?>(.?)</b><span>(.*?)</span>', text)
    assert [(mark, words) for _, mark, words in units] == [
        *((mark, f"Task {i} +1.0") for i, mark in enumerate(MARKS)),
        ("", "in all"),
    ]
    assert [color for color, *_ in units] == ["0", "2", "3", "3", "3", ""]
    legend = re.search(r'<ul class="marks">(.*?)</ul>', text, re.DOTALL)[1]
    assert all(meaning in legend for meaning in MARKS.values())


def test_a_matrix_says_each_cell_with_its_row_and_column():
    text = page(table=matrix())
    cells = re.findall(
        r'<td role="cell" data-label="([^"]+)"(?: class="judged verdict-(\d)")?><span>(.*?)</span>', text
    )
    assert [(label, verdict, re.sub("<svg.*</svg> ", "", words)) for label, verdict, words in cells] == [
        ("ends higher", "0", "5 of 6"),
        ("learns faster", "", "—"),
        ("ends higher", "2", "0 of 2"),
        ("learns faster", "", "none"),
    ]
    assert re.findall(r'role="rowheader">([^<]+)<', text) == ["LQR", "Ant"]


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (lambda: Cell("x", "maybe"), "verdict is 'maybe'"),
        (lambda: matrix(columns=["one"]), "rows has 'LQR' with 2 cells; it must be 1"),
        (lambda: claim(count=(3, 2)), r"count is \(3, 2\); it must be k of n"),
        (lambda: claim(verdict="maybe"), "verdict is 'maybe'"),
        (lambda: Section("Figure 1", "t"), "name is 'Figure 1'"),
        (lambda: Table(["a", "b"], [["1", "2"], ["3"]]), r"\['3'\]; it must be 2"),
        (lambda: page([claim(section="nowhere")]), "section is 'nowhere'.*It works"),
        (lambda: render("t", [], [], [Section("twice", "a"), Section("twice", "b")]), "'twice' twice"),
    ],
)
def test_what_is_wrong_is_named(wrong, named):
    with pytest.raises(UsageError, match=named):
        wrong()


def test_text_from_outside_is_text_and_nothing_else():
    plain = Document(page([claim()], table=Table(["a"], [["b"]]), paragraphs=["c"]))
    hostile = Document(
        render(
            HOSTILE,
            [HOSTILE, HOSTILE],
            [claim(**dict.fromkeys(("source", "words", "test", "number", "why"), HOSTILE))],
            [
                Section(
                    "curves",
                    HOSTILE,
                    HOSTILE,
                    figure((HOSTILE, "HL-Gauss")),
                    Table([HOSTILE], [[HOSTILE]]),
                    [HOSTILE],
                )
            ],
        )
    )
    assert [tag for tag, _ in hostile.elements] == [tag for tag, _ in plain.elements]
    assert hostile.text.count(HOSTILE) == 16  # each where it was given, and titles once or twice more
    assert hostile.raw["script"] == []
    assert [attributes["alt"] for attributes in hostile.all("img")] == [HOSTILE]


def test_text_from_outside_is_text_in_the_answer_too():
    def head(words):
        answer = Answer([words] * 2, Matrix(words, [words], {words: [Cell(words, "holds")]}), words, figure(), words)
        return Document(render("t", [], [], [], answer))

    assert [tag for tag, _ in head(HOSTILE).elements] == [tag for tag, _ in head("plain").elements]
    assert head(HOSTILE).text.count(HOSTILE) == 8


@pytest.mark.slow
def test_nothing_is_fetched_and_only_the_pages_own_style_is_allowed():
    text = page([claim()])
    plain = re.sub(r'src="data:[^"]*"', "", text)
    assert not re.search(r"https?:|//[a-z]|\bsrc=|@import|url\((?!#)|\bstyle=|\son\w+=|<script", plain)
    document = Document(text)
    (policy,) = [meta["content"] for meta in document.all("meta") if meta.get("http-equiv")]
    assert policy.startswith("default-src 'none'; img-src data:;")
    digest = base64.b64encode(hashlib.sha256(document.raw["style"][0].encode()).digest()).decode()
    assert f"style-src 'sha256-{digest}'" in policy


def test_ids_are_unique_and_references_lead_to_one():
    two = [Section(name, name, "", figure(), table=None) for name in ("one", "two")]
    text = render("t", [], [claim(section="one")], two)
    ids = [attributes["id"] for _, attributes in Document(text).elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)', text)) <= {(i, "") for i in ids} | {("", i) for i in ids}


def test_a_figure_is_drawn_as_print_has_it_and_the_same_each_time():
    drawn, again = figure(), figure()
    for each in (drawn, again):
        settle(each)
    text = page([claim()], figure=drawn)
    assert images(text) == [svg(drawn)]
    assert text == page([claim()], figure=again)
    ElementTree.fromstring(images(text)[0])


def test_numbers_stand_flush_right():
    cells = [["LQR", "−1.0 ± 0.2", "3 of 4"], ["Ant", "—", ""]]
    table = Table(["task", "return", "wins"], cells)
    assert [table.is_numeric(column) for column in range(3)] == [False, True, True]
    text = page(table=table)
    assert text.count('class="number"') == 6


def test_whatever_may_be_left_out_may_be_left_out():
    text = render("t", [], [], [Section("empty", "Empty")])
    assert "<figure" not in text
    assert "<details" not in text
    assert 'class="counts"' not in text
    assert "<nav" not in render("t", [], [], [])
