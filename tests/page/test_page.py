import base64
import dataclasses
import hashlib
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.figure import Figure

from galton.analysis.plots import draw_level, draw_marks, draw_series, finish, grid, panels, settle
from galton.analysis.scales import from_best
from galton.analysis.statistics import Interval, mean_interval
from galton.errors import UsageError
from galton.page.page import MARKS, VERDICTS, Answer, Cell, Claim, Matrix, Section, Table, render

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
            draw_series(panel, STEPS, mean_interval(RUNS + i), name, color, single_runs=RUNS + i)
        draw_level(panel, 3.0, "optimum", "--")
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


def data(document, i=0):
    return json.loads(document.raw["script"][i])


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
    assert links == ["#curves"] * 3  # of the claim, of the contents, and the download's


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
    assert hostile.text.count(HOSTILE) == 19  # each where it was given, titles three times more, and in the drawing
    assert data(hostile)["names"] == [HOSTILE, "HL-Gauss", "optimum"]
    assert len(hostile.raw["script"]) == 2


def test_text_from_outside_is_text_in_the_answer_too():
    def head(words):
        answer = Answer([words] * 2, Matrix(words, [words], {words: [Cell(words, "holds")]}), words, figure(), words)
        return Document(render("t", [], [], [], answer))

    assert [tag for tag, _ in head(HOSTILE).elements] == [tag for tag, _ in head("plain").elements]
    assert head(HOSTILE).text.count(HOSTILE) == 8


def test_nothing_is_fetched_and_only_the_pages_own_style_and_script_are_allowed():
    text = page([claim()])
    assert not re.search(r"https?:|//[a-z]|\bsrc=|@import|url\((?!#)|\bstyle=|\son\w+=", text)
    document = Document(text)
    (policy,) = [meta["content"] for meta in document.all("meta") if meta.get("http-equiv")]
    assert policy.startswith("default-src 'none';")
    for body, name in ((document.raw["style"][0], "style-src"), (document.raw["script"][-1], "script-src")):
        digest = base64.b64encode(hashlib.sha256(body.encode()).digest()).decode()
        assert f"{name} 'sha256-{digest}'" in policy


def test_ids_are_unique_and_references_lead_to_one():
    two = [Section(name, name, "", figure(), table=None) for name in ("one", "two")]
    text = render("t", [], [claim(section="one")], two)
    ids = [attributes["id"] for _, attributes in Document(text).elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)', text)) <= {(i, "") for i in ids} | {("", i) for i in ids}


def test_the_same_input_gives_the_same_bytes_and_a_figure_is_left_as_it_was():
    drawn = figure()
    gids = [artist.get_gid() for artist in drawn.findobj()]
    assert page([claim()], figure=drawn) == page([claim()], figure=figure())
    assert [artist.get_gid() for artist in drawn.findobj()] == gids
    assert drawn.legends[0].get_visible()


def test_the_numbers_are_those_drawn():
    (left, right) = data(Document(page()))["panels"]
    assert left["title"] == right["title"] == "On Gaussian"
    assert left["grids"] == [STEPS.tolist(), []]
    expected = mean_interval(RUNS + 1)
    for series, name in zip(left["series"][1:], (1, 2), strict=True):
        assert series["name"] == name
    for end in ("mean", "low", "high"):
        np.testing.assert_allclose(left["series"][1][end], getattr(expected, end), rtol=1e-4)
    assert left["series"][2] == left["series"][2] | {"x": 1, "mean": [3]}
    assert "low" not in left["series"][2]


def test_a_panels_box_and_limits_say_where_its_numbers_are_drawn():
    drawn = figure()
    for axes in drawn.axes:
        axes.set_xscale("log")
    text = page(figure=drawn)
    for i, panel in enumerate(data(Document(text))["panels"]):
        mark = re.search(rf'id="curves.axes-{i}".*?class="mark" data-series="0"><path d="M([\d.]+) ([\d.]+)l', text)
        left, top, width, height = panel["box"]
        low, high = np.log(panel["x"]["limits"])
        assert left + width * (np.log(STEPS[0]) - low) / (high - low) == pytest.approx(float(mark[1]), abs=0.1)
        low, high = panel["y"]["limits"]
        mean = panel["series"][0]["mean"][0]
        assert top + height * (high - mean) / (high - low) == pytest.approx(float(mark[2]), abs=0.1)


def test_a_scale_of_another_kind_is_told_by_where_its_values_lie():
    drawn, (axes,) = panels(1)
    axes.plot([1.0, 2.0], [-90.0, 9.0], gid="a")
    from_best(axes, "y", 10.0, 1.0, (-100.0, 10.0))
    (panel,) = data(Document(page(figure=drawn)))["panels"]
    assert (panel["x"]["scale"], panel["y"]["scale"]) == ("linear", "knots")
    knots = np.array(panel["y"]["knots"])
    assert knots[[0, -1]] == pytest.approx([-100, 10])
    shares = 1 - np.log1p(10 - knots) / np.log1p(110)
    np.testing.assert_allclose(shares, np.linspace(0, 1, len(knots)), atol=1e-6)


def test_the_legend_has_the_figures_order():
    drawn, (axes,) = panels(1)
    for name in ("b", "a", "c"):
        draw_series(axes, STEPS, mean_interval(RUNS), name, "black")
    finish(drawn, [axes], ["a", "b"])
    assert data(Document(page(figure=drawn)))["names"] == ["a", "b", "c"]


def test_of_a_figure_that_stays_whole_the_room_of_its_legend_is_cut_off():
    def height(drawn):
        return float(re.search(r'viewBox="0.0 0.0 [\d.]+ ([\d.]+)"', page(figure=drawn))[1])

    drawn, axes = grid(2, 2)
    for panel in axes[:3]:
        draw_series(panel, STEPS, mean_interval(RUNS), "a", "black")
    axes[3].set_axis_off()
    finish(drawn, axes)
    settle(drawn)
    assert height(drawn) < drawn.get_figheight() * 72 - 10


def test_an_area_under_a_curve_is_no_band_and_unknown_numbers_are_null():
    drawn, (axes,) = panels(1)
    gap = np.where(STEPS == 3000, np.nan, STEPS)
    draw_series(axes, STEPS, Interval(gap, gap - 1, gap + 2), "gap", "black")
    axes.plot(STEPS, STEPS, gid="hill")
    axes.fill_between(STEPS, STEPS, gid="hill")
    axes.stairs([1, 4], [0, 1, 3], gid="steps")
    axes.stairs([1, 4], [0, 1, 3], gid="steps", fill=True)
    axes.axvline(2, gid="upright")
    (panel,) = data(Document(page(figure=drawn)))["panels"]
    gap, hill, steps = panel["series"]
    assert gap["low"] == [999, 1999, None, 3999, 4999]
    assert gap["high"] == [1002, 2002, None, 4002, 5002]
    assert set(hill) == {"name", "color", "x", "mean"}
    assert (panel["grids"][steps["x"]], steps["mean"]) == ([0.5, 2], [1, 4])


def test_marks_side_by_side_have_the_values_of_their_place_and_their_bars():
    drawn, (axes,) = panels(1)
    intervals = [Interval(2.0, 1.0, 4.0), Interval(-3.0, -4.5, -2.5), Interval(5.0, np.nan, np.nan)]
    for i, name in enumerate(("left", "right")):
        draw_marks(axes, [Interval(*(np.array(interval) + i)) for interval in intervals], name, "#0072B2", 0.2 * i)
    (panel,) = data(Document(page(figure=drawn)))["panels"]
    assert panel["grids"] == [[0, 1, 2]]
    for i, series in enumerate(panel["series"]):
        found = list(zip(series["mean"], series["low"], series["high"], strict=True))
        assert found == [(2 + i, 1 + i, 4 + i), (-3 + i, -4.5 + i, -2.5 + i), (5 + i, None, None)]


def test_axes_with_words_for_numbers_keep_them():
    drawn, (axes,) = panels(1)
    draw_series(axes, [0.0, 1.0], Interval(*np.ones((3, 2))), "a", "black")
    axes.set_xticks([0, 1], ["none", "all"])
    assert data(Document(page(figure=drawn)))["panels"][0]["x"]["ticks"] == [[0, "none"], [1, "all"]]


def test_ink_follows_the_theme():
    drawn, (axes,) = panels(1)
    for i, color in enumerate(("black", "#0072b2", "#444444", "#440154", "#e0e010", "#d55e00")):
        axes.plot([0, 1], gid=str(i), color=color)
    grey = "color-mix(in srgb, currentColor 73%, var(--paper))"
    colors = [series["color"] for series in data(Document(page(figure=drawn)))["panels"][0]["series"]]
    assert colors[:3] == ["currentColor", "var(--blue)", grey]
    assert re.fullmatch(r"light-dark\(#440154, #[0-9a-f]{6}\)", colors[3])
    assert re.fullmatch(r"light-dark\(#[0-9a-f]{6}, #e0e010\)", colors[4])
    assert colors[5] == "#d55e00"
    assert "#000000" not in page(figure=drawn)


def test_a_figure_is_divided_into_its_panels_unless_they_belong_together():
    def drawings(drawn):
        return page(figure=drawn).count("viewBox") - page(figure=None).count("viewBox")

    plain = figure()
    plain.suptitle("Both")
    assert drawings(plain) == 2 + 3  # and the legend's
    assert "Both</p>" in page(figure=plain)
    shared = Figure(layout="constrained")
    image = shared.subplots().imshow([[0, 1]])
    shared.colorbar(image)
    assert drawings(shared) == 1
    uneven, (left, right) = panels(2)
    left.set_yticks([0], ["the words for both of the panels"])
    right.set_yticks([0], [""])
    assert drawings(uneven) == 1
    assert drawings(Figure()) == 1


def test_the_legend_is_the_pages_own_and_has_no_swatch_where_colours_differ():
    text = page()
    assert re.findall(r'<button type="button" aria-pressed="true">.*?<span>(.*?)<', text) == [
        "Gaussian",
        "HL-Gauss",
        "optimum",
    ]
    assert text.count(">Gaussian<") == 1
    drawn, axes = panels(2)
    for panel, color in zip(axes, ("black", "#009E73"), strict=True):
        panel.plot([0, 1], gid="k = 10", color=color)
    assert '<button type="button" aria-pressed="true"><span>k = 10<' in page(figure=drawn)


def test_math_is_running_text_but_for_fractions():
    drawn, (axes,) = panels(1)
    axes.set_title(r"$x_i^{10} + y$")
    axes.set_xlabel(r"the $\frac{1}{2}$")
    axes.set_yscale("log")
    text = page(figure=drawn)
    words = ["".join(re.findall(r"<tspan[^>]*>([^<]*)<", part)) for part in re.findall(r"<text.*?</text>", text)]
    assert "100" in words  # ten to the power of nought
    assert len([part for part in re.findall(r"<text.*?</text>", text) if 'text-anchor="end"' in part]) > 0
    assert re.search(r'<tspan x="[^"]+" y="[^"]+"[^>]*>2</tspan>', text)


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
