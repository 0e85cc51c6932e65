"""Winners, claims and hypotheses on the committed results, found again by code that shares nothing with Galton's."""

import numpy as np
import pytest

from studies.paper import hypotheses, rescaling
from studies.paper.report import claims
from studies.paper.standings import ahead, clear, decisions, winners

from .agreement import NAMES, NUMBER, agreed, is_printed, judge_of
from .recomputed.bandits import BANDITS
from .recomputed.changes import cell, table
from .recomputed.claims import GRIDS, TASKS, on_tasks, paired
from .recomputed.ranks import compared, holm, marks_of, mean_of
from .recomputed.runs import LABELS, TITLES, null_of, record_of, settings_of, tasks_of


@pytest.mark.parametrize("name", NAMES)
def test_every_claim_is_found_again(name, trained, sweeps, trust):
    agreed(name, trained, sweeps)
    promise = "A second program, with numpy and scipy alone, finds every claim again but those on gradients."
    trust("claims-again", promise, topic="numbers", figure=1, unit="claims", at_least=len(NAMES), over="sum")


@pytest.mark.parametrize("name", [name for name, (*_, notes) in TASKS.items() if notes])
def test_what_is_noted_of_the_deterministic_policy(name, trained, sweeps):
    _, notes = on_tasks(tasks_of(sweeps), name)
    assert notes == [line for line in judge_of(name)(trained).why.splitlines() if line.startswith("By the det")]


@pytest.mark.parametrize("name", BANDITS)
def test_the_bandit_in_units_of_its_box(name, trained, sweeps):
    boxed_runs = {name.removeprefix("boxed-"): of for name, of in sweeps.items() if name.startswith("boxed-")}
    agreed(name, rescaling.in_the_box(trained), boxed_runs)


def test_every_claim_of_the_page_is_among_them(trained):
    """But for those on gradients, which test_norms.py finds again."""
    known = {judge_of(name)(trained).words for name in NAMES if name not in GRIDS} | {*GRIDS}
    others = {claim.words for claim in claims(trained)} - known
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
            assert is_printed(row[place["their median"]], np.median(task.again.final(loss)))
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


@pytest.mark.slow
def test_the_table_of_hypotheses(sweeps, trained):
    shown = {
        name: [(each.text, each.verdict) for each in cells[1:]]
        for name, cells in hypotheses.table(trained).rows.items()
    }
    assert shown == {name: [cell(judged) for judged in row] for name, row in table(sweeps).items()}


def columns_that_differ(tables, i):
    """The columns of the tables in which setting i's numbers are not the same bits in all of them."""
    rows = [table.filter(np.equal(table["setting"].to_numpy(), i)) for table in tables]
    bits = [{name: str(each[name].to_pylist()) for name in each.column_names} for each in rows]
    return {name for name in bits[0] if len({each[name] for each in bits}) > 1}


def test_the_same_bits_at_every_scale(trained, tables):
    """Of σ, and of a density's entropy and loss, bits differ as their unit does."""
    found = []
    for name in TITLES:
        scaled = [table for file, table in tables.items() if file.startswith(f"scale-{name}-")]
        for i, setting in enumerate(settings_of(record_of(scaled[0])) if len(scaled) > 1 else []):
            of_density = {"entropy", "final_entropy", "final_policy_loss"} if setting["box_units"] else set()
            found.append("yes" if columns_that_differ(scaled, i) <= {"final_sigma"} | of_density else "no")
    said = [line.split(" | ")[-1].removesuffix(" |") for line in rescaling.markdown(trained).splitlines()[2:]]
    assert found == said
    assert {*found} == {"yes", "no"}
