"""Each loss's best setting on each task: the table of the page, and that of docs/reproduce.md."""

from collections.abc import Mapping

import numpy as np

from galton.losses import LOSSES
from galton.tasks import TASKS
from galton_experiments.analysis import Comparison, decide
from galton_experiments.page import Table
from galton_experiments.runs import Summary
from studies.paper.measures import DETERMINISTIC, final_return, logged, mean_return, versus
from studies.paper.trained import Trained, optimum
from studies.paper.verdicts import told_mean

_BASELINE = "gaussian"
Decisions = Mapping[tuple[str, str], Comparison]
"""A loss on a task against the Gaussian, by task and loss."""


def decisions(trained: Trained) -> Decisions:
    """The final training return of every other loss against the Gaussian's on fresh seeds; null tasks are left out."""
    return {
        (task, loss): versus(judged.again, loss, _BASELINE, final_return)
        for task, judged in trained.judged.items()
        if task in trained.scales
        for loss in judged.again.best
        if loss != _BASELINE
    }


def clear(trained: Trained) -> dict[tuple[str, str], str]:
    """The mark of each decision, all adjusted together: ✓ where a loss is clearly ahead of the Gaussian, ✗ behind."""
    return {key: decision.mark for key, decision in decide(decisions(trained)).items()}


def ahead(trained: Trained) -> set[tuple[str, str]]:
    """Find what is in bold: a loss clearly ahead of the Gaussian, or the Gaussian clearly ahead of all."""
    given = clear(trained)
    found = {key for key, mark in given.items() if mark == "✓"}
    for task in trained.judged:
        theirs = [mark for (of, _), mark in given.items() if of == task]
        found |= {(task, _BASELINE)} if theirs and {*theirs} == {"✗"} else set()
    return found


def readme_table(trained: Trained) -> str:
    """The final training returns on fresh seeds as Markdown, a row per task; bold is computed (see `ahead`)."""
    losses = [*dict.fromkeys(loss for judged in trained.judged.values() for loss in judged.again.best)]
    bold = ahead(trained)
    lines = ["| | runs | " + " | ".join(LOSSES[loss].label for loss in losses) + " |", "|---" * (len(losses) + 2) + "|"]
    for task, judged in trained.judged.items():
        best = optimum(task)
        known = "" if best is None else f" (optimum {_plain(best)})"
        cells = [f"{TASKS[task].title}{known}{' (null)' * (task in trained.nulls)}", str(judged.again.study.trials)]
        for loss in losses:
            text = _final(judged.again, loss) if loss in judged.again.best else "—"
            cells.append(f"**{text}**" if (task, loss) in bold else text)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def winners(trained: Trained) -> Table:
    """The table of each loss's best setting on each task, with its returns as it won and on fresh seeds."""
    headings = ["task", "loss", "best setting", "runs", "on fresh seeds", "their median", "P", "p"]
    headings += [f"evaluation, {name}" for name in DETERMINISTIC.values()]
    headings += ["as it won", "over training", "noise costs", "doing nothing", "optimum"]
    found = decisions(trained)
    p = {key: decision.p for key, decision in decide(found).items()}
    rows = []
    for task, summary in trained.grids.items():
        again = trained.judged[task].again if task in trained.judged else None
        levels = ["—" if value is None else _plain(value) for value in (TASKS[task].at_rest, optimum(task))]
        title = trained.title(task)
        for loss, best in summary.best.items():
            cells = [title, LOSSES[loss].label, best.setting.brief()]
            cells += (
                [str(again.study.trials), _final(again, loss), _plain(float(np.median(final_return(again, loss))))]
                if again
                else ["—"] * 3
            )
            cells += _against(found.get((task, loss)), p.get((task, loss), np.nan))
            evaluated, (over_training, noise) = _deterministic(again or summary, loss)
            rows.append([*cells, *evaluated, _final(summary, loss), over_training, noise, *levels])
    return Table(headings, rows)


def _against(found: Comparison | None, p: float) -> list[str]:
    """P and p of a loss against the Gaussian."""
    if found is None:
        return ["—", "—"]
    return [f"{found.above:.2f}", "—" if np.isnan(p) else "<0.001" if p < 0.001 else f"{p:.3f}"]


def _deterministic(summary: Summary, loss: str) -> tuple[list[str], list[str]]:
    """The deterministic policy's final returns; and the mean training return, and what noise costs there."""
    kinds = logged(summary)
    returns = [_final(summary, loss, metric) if metric in kinds else "—" for metric in DETERMINISTIC]
    over_training = mean_return(summary, loss)
    noise = mean_return(summary, loss, "evaluation_return") - over_training
    return returns, [told_mean(over_training), told_mean(noise)]


def _final(summary: Summary, loss: str, metric: str = "training_return") -> str:
    return told_mean(final_return(summary, loss, metric))


def _plain(value: float) -> str:
    return f"{value:{'.2f' if abs(value) < 100 else ',.0f'}}".replace("-", "−")
