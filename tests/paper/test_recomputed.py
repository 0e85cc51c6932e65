"""Winners, claims and hypotheses on the committed results, found again by code that shares nothing with Galton's."""

import math
import re

import pytest

from galton.paper import boxed, controls, harder_bandits, hypotheses, reproduce, returns, stability
from galton.paper.order import order_changes
from galton.paper.report import claims
from galton.paper.standings import ahead, clear, decisions, winners

from .recomputed.bandits import BANDITS
from .recomputed.changes import cell, table
from .recomputed.claims import GRIDS, TASKS, on_grids, on_tasks, order, paired
from .recomputed.ranks import compared, holm, marks_of, mean_of
from .recomputed.runs import DATA, LABELS, TITLES, grids_of, null_of, read_all, tasks_of

MODULES = (returns, stability, harder_bandits, controls)
NUMBER = re.compile(r"never|[+−]?\d[\d,]*\.?\d*")


@pytest.fixture(scope="module")
def sweeps():
    return read_all()


@pytest.fixture(scope="module")
def trained():
    found = reproduce.load(str(DATA.parent))
    assert {*found.judged} == {*TITLES}
    return found


def claim_named(name):
    return next(getattr(module, name) for module in MODULES if hasattr(module, name))


def is_printed(text, value):
    """Whether a number is printed as this text."""
    if text == "never":
        return math.isinf(value)
    plain = text.replace("−", "-").replace(",", "")
    decimals = len(plain.partition(".")[2])
    return abs(float(plain) - value) <= 0.5 * 10**-decimals * (1 + 1e-6) + 1e-9


def assert_prints(line, found, mark, p):
    """A line of a claim has this mark, name, numbers and p."""
    assert line.startswith(f"{mark} {found.name} ")
    told = line.removeprefix(f"{mark} {found.name} ")
    if found.null:
        assert told == found.null
        return
    values = [x for number in found.numbers for x in (number if isinstance(number, tuple) else (number,))]
    texts = NUMBER.findall(told)
    if not math.isnan(p):
        assert p < 0.001 if texts[-1] == "0.001" and "p < " in told else is_printed(texts[-1], p)
        texts = texts[:-1]
    assert len(texts) == len(values), line
    assert all(map(is_printed, texts, values)), (line, values)


def assert_same(claim, found):
    """The page and the second path agree on a claim."""
    assert (claim.verdict, claim.count) == (found.verdict, found.count)
    lines = claim.number.splitlines()
    assert len(lines) == len(found.found)
    for line, each, mark, p in zip(lines, found.found, found.marks, found.adjusted, strict=True):
        assert_prints(line, each, mark, p)


@pytest.mark.parametrize("name", TASKS)
def test_claims_on_tasks(name, sweeps, trained):
    claim, (found, notes) = claim_named(name)(trained), on_tasks(tasks_of(sweeps), name)
    assert_same(claim, found)
    assert [line for line in claim.why.splitlines() if line.startswith("By the det")] == notes


def test_the_order_of_the_two_classification_losses(sweeps, trained):
    assert_same(order_changes(trained), order(tasks_of(sweeps))._replace(count=None))


@pytest.mark.parametrize("name", BANDITS)
@pytest.mark.parametrize("prefix", ["", "boxed-"])
def test_claims_on_bandits(name, prefix, sweeps, trained):
    """In raw units and in units of the box; of what is not trained neither path says anything."""
    judged = claim_named(name)(boxed.in_the_box(trained) if prefix else trained)
    found = BANDITS[name]({key.removeprefix(prefix): of for key, of in sweeps.items() if key.startswith(prefix)})
    assert_same(judged, found)


@pytest.mark.parametrize("words", GRIDS)
def test_claims_on_whole_grids(words, sweeps, trained):
    claim = next(claim for claim in claims(trained) if claim.words == words)
    assert_same(claim, on_grids(grids_of(sweeps), words))


def test_every_claim_of_the_page_is_found_by_a_second_path(trained):
    """But for those on gradients, which test_norms.py finds again."""
    known = [claim_named(name)(trained).words for name in (*TASKS, *BANDITS)] + [order_changes(trained).words, *GRIDS]
    others = {claim.words for claim in claims(trained)} - {*known}
    assert all("gradient" in words or "bound" in words for words in others)


def test_winners_against_the_gaussian(sweeps, trained):
    found = {
        (name, loss): compared("", task.again.final(loss), task.again.final("gaussian"), paired(*task.again.runs))
        for name, task in tasks_of(sweeps).items()
        if not null_of(task)
        for loss in task.again.losses
        if loss != "gaussian"
    }
    marks, adjusted = marks_of([*found.values()])
    assert clear(trained) == dict(zip(found, marks, strict=True))
    assert [each.p for each in decisions(trained).values()] == pytest.approx([f.p for f in found.values()], nan_ok=True)
    assert holm([each.p for each in decisions(trained).values()]) == pytest.approx(adjusted, nan_ok=True)
    bold = {key for key, mark in zip(found, marks, strict=True) if mark == "✓"}
    behind = {name: [mark for (of, _), mark in zip(found, marks, strict=True) if of == name] for name, _ in found}
    assert ahead(trained) == bold | {(name, "gaussian") for name, those in behind.items() if {*those} == {"✗"}}


def test_the_table_of_winners(sweeps, trained):
    rows = {(row[0].removesuffix(" (null)"), row[1]): row for row in winners(trained).rows}
    place = {name: i for i, name in enumerate(winners(trained).headings)}
    for name, task in tasks_of(sweeps).items():
        for loss in task.again.losses:
            row = rows[TITLES[name], LABELS[loss]]
            setting = task.grid.of(loss).setting
            assert f"learning rate {setting['learning_rate']:.3g}" in row[place["best setting"]]
            assert all(
                setting[field] == task.again.of(loss).setting[field] for field in ("n_bins", "learning_rate", "eta")
            )
            assert row[place["runs"]] == str(task.again.trials)
            over = task.again.mean(loss)
            cells = {
                "as it won": task.grid.final(loss),
                "on fresh seeds": task.again.final(loss),
                "evaluation, most likely action": task.again.final(loss, "evaluation_return"),
                "over training": over,
                "noise costs": task.again.mean(loss, "evaluation_return") - over,
            }
            if task.again.has("mean_action_return"):
                cells["evaluation, mean action"] = task.again.final(loss, "mean_action_return")
            for heading, values in cells.items():
                texts = NUMBER.findall(row[place[heading]])
                assert all(map(is_printed, texts, mean_of(values))), (row, heading)


def test_the_table_of_hypotheses(sweeps, trained):
    shown = {
        name: [(each.text, each.verdict) for each in cells[1:]]
        for name, cells in hypotheses.table(trained).rows.items()
    }
    assert shown == {name: [cell(judged) for judged in row] for name, row in table(sweeps).items()}


def test_figure_3_in_both_units(sweeps, trained):
    shown = [[(each.text, each.verdict) for each in cells] for cells in boxed.table(trained).rows.values()]
    sides = [{name.removeprefix("boxed-"): of for name, of in sweeps.items() if name.startswith("boxed-")}]
    found = [[cell(judge(side)) for side in (sweeps, *sides)] for judge in BANDITS.values()]
    assert sorted(map(str, shown)) == (sorted(map(str, found)) if sides[0] else [])
