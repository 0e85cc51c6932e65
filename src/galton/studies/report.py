"""The page: what holds of the paper, every figure, and how each was made."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from galton.analysis.page import Section, Table, render
from galton.analysis.plots import settle
from galton.analysis.statistics import mean_interval
from galton.losses import LOSSES
from galton.studies.base import Data, FigureStudy, optimum, present
from galton.studies.claims import all_claims
from galton.studies.measures import final_return, mean_return
from galton.studies.propositions import PRINTED, PRINTED_LABEL, findings
from galton.studies.registry import FIGURES, find_figure
from galton.studies.summary import Summary
from galton.studies.why import METRICS, outcomes, retrained
from galton.sweep.parquet import record_of
from galton.tasks import TASKS

TITLE = "Replacing implicit regression with classification: what holds"
INTRODUCTION = (
    "The paper replaces the regression that hides in Gaussian policy gradients by classification: a softmax over "
    "bins, trained with a cross-entropy towards the sampled bin (HL-1-Hot) or a Gaussian histogram around it "
    "(HL-Gauss). Here all of that is trained again, and what the paper says stands beside what was measured. Intervals "
    "are 95% confidence intervals, each by itself: of twenty true zeros one is expected to look like something.",
    "Unless its test says otherwise, a claim holds if all its numbers clearly say so, and does not if more of them "
    "clearly say the contrary than say so; in between it holds in part. Clearly means that the interval leaves out 0; "
    "where no number is clear, nothing is decided.",
    "Centred HL-Gauss (dash-dotted) is not the paper's. It is HL-Gauss without a bias that docs/paper.md derives, on "
    "a grid of its own with wider targets, and no claim counts it.",
)


BUDGETS = {
    "smoke": "A few hundred steps: the numbers mean nothing, and no verdict does.",
    "small": "A part of the grid, few trials.",
    "paper": "The paper's grid and trials.",
}
"""What to think of each."""


def figures(data: Data) -> dict[str, Figure]:
    """Every figure that the data suffices for."""
    drawn = {name: find_figure(name).draw(data) for name in FIGURES if _is_there(find_figure(name), data)}
    drawn = {name: figure for name, figure in drawn.items() if figure.axes}
    for figure in drawn.values():
        settle(figure)
    return drawn


def _is_there(study: FigureStudy, data: Data) -> bool:
    if study.needs_propositions:
        return data.propositions is not None
    return not study.sweeps or any(name in data.sweeps for name in study.sweeps)


def page(data: Data, drawn: dict[str, Figure]) -> str:
    """HTML, whole."""
    sections = []
    for name in FIGURES:
        study = find_figure(name)
        title = f"{name.replace('-', ' ').capitalize()}: {study.title}" if name[-1].isdigit() else study.title
        table = _TABLES[name](data) if name in _TABLES and name in drawn else None
        missing = () if name in drawn else ("Not trained here.",)
        sections.append(Section(name, title, study.caption, drawn.get(name), _facts(name, study, data), table, missing))
    return render(TITLE, [*INTRODUCTION, *trained(data)], all_claims(data), sections)


def trained(data: Data) -> list[str]:
    """A sentence for each budget that something was trained with."""
    found: dict[str, list[str]] = {}
    for name, summary in data.sweeps.items():
        task = name.removeprefix("why-")
        if task in TASKS:
            title = TASKS[task].title if name in TASKS else f"why on {TASKS[task].title}"
            found.setdefault(summary.provenance["budget"], []).append(f"{title} ({summary.study.trials} trials)")
    if data.propositions is not None:
        found.setdefault(record_of(data.propositions)["budget"], []).append("propositions")
    return [f"Trained with budget {budget}: {', '.join(names)}. {BUDGETS[budget]}" for budget, names in found.items()]


def _facts(name: str, study: FigureStudy, data: Data) -> list[tuple[str, str]]:
    """Settings, versions, machines and the command behind a figure."""
    found = [(sweep, data.sweeps[sweep]) for sweep in study.sweeps if sweep in data.sweeps]
    facts = []
    for sweep, summary in found:
        s = summary.study
        text = (
            f"{len(s.settings)} settings × {s.trials} trials × {s.steps:,} steps, budget "
            f"{summary.provenance['budget']}, {_minutes(summary)} of one core. Best: "
            + "; ".join(f"{LOSSES[loss].label} {best.setting.brief()}" for loss, best in summary.best.items())
        )
        facts.append((f"sweep {sweep}", text))
    records = [summary.provenance for _, summary in found]
    if study.needs_propositions and data.propositions is not None:
        records.append(record_of(data.propositions))
    for word in ("versions", "machines"):
        facts += [
            (word, value) for value in dict.fromkeys(_shown(value) for record in records for value in record[word])
        ]
    return facts + [("command", command) for command in _commands(name, found, records)]


def _commands(name: str, found: list[tuple[str, Summary]], records: list[dict[str, Any]]) -> list[str]:
    """What makes it again; task by task where their budgets differ."""
    budgets = [*dict.fromkeys(record["budget"] for record in records)] or ["paper"]
    words = {
        budget: [name]
        if len(budgets) == 1
        else dict.fromkeys(
            sweep.removesuffix("-again") for sweep, summary in found if summary.provenance["budget"] == budget
        )
        for budget in budgets
    }
    return [f"galton reproduce {' '.join(words[budget])} --budget {budget} --out DIR" for budget in budgets]


def _minutes(summary: Summary) -> str:
    seconds = summary.provenance["train_seconds"] + summary.provenance["compile_seconds"]
    return f"{seconds / 60:,.0f} minutes"


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {version}" for name, version in value.items() if version)
    return str(value)


def winners(data: Data) -> Table:
    """Each loss's best setting on each task, as it won and on fresh seeds."""
    rows = []
    for task, summary in present(data).items():
        known = [TASKS[task].at_rest, optimum(task)]
        for loss, best in summary.best.items():
            again = data.sweeps.get(f"{task}-again")
            judged = again or summary
            evaluation = final_return(judged, loss, "evaluation_return")
            over_training = mean_return(judged, loss)
            noise = mean_return(judged, loss, "evaluation_return") - over_training
            rows.append(
                [
                    TASKS[task].title,
                    LOSSES[loss].label,
                    best.setting.brief(),
                    f"{mean_interval(final_return(summary, loss)):.2f}",
                    f"{mean_interval(final_return(again, loss)):.2f}" if again else "—",
                    *(f"{mean_interval(returns):.2f}" for returns in (evaluation, over_training, noise)),
                    *("—" if value is None else f"{value:.2f}".replace("-", "−") for value in known),
                ]
            )
    headings = ["task", "loss", "best setting", "as it won", "on fresh seeds", "evaluation", "over training"]
    headings += ["noise costs", "doing nothing", "optimum"]
    return Table(headings, rows)


def causes(data: Data) -> Table:
    """What the policies look like in the end, under each change."""
    rows = []
    for task, again in retrained(data).items():
        for (change, loss), outcome in outcomes(again).items():
            cells = [
                f"{np.nanmedian(values):.2f}".replace("-", "−")  # it may be −∞
                if metric == "explained_variance"
                else f"{mean_interval(values):.2f}"
                for metric, values in outcome.finals.items()
            ]
            rows.append([TASKS[task].title, change, LOSSES[loss].label, outcome.setting.brief(), *cells])
    return Table(["task", "change", "loss", "setting", *METRICS.values()], rows)


def bounds(data: Data) -> Table:
    """How tight they are, how they move over training and as σ → 0."""
    rows = []
    for (task, loss, reading), found in findings(data.propositions).items():
        label = PRINTED_LABEL if (loss, reading) == PRINTED else LOSSES[loss].label
        rows.append([TASKS[task].title, label, *("—" if np.isnan(x) else f"{x:.3g}".replace("-", "−") for x in found)])
    headings = ["norm / bound, median", "bound / |A|, mean", "in the end", "its variation", "p in norm ∝ σᵖ"]
    return Table(["task", "loss", *headings], rows)


_TABLES = {"figure-2": winners, "propositions": bounds, "why": causes}
