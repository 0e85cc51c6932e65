"""The page: what holds of the paper, every figure, and how each was made."""

import dataclasses
from collections.abc import Mapping

from matplotlib.figure import Figure

from galton.analysis.plots import settle
from galton.losses import LOSSES
from galton.page.page import Claim, Section, render
from galton.paper.figure import FigureStudy
from galton.paper.registry import FIGURES, all_sweeps
from galton.paper.summary import Summary
from galton.paper.trained import Trained
from galton.sweep.parquet import record_of

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
    "grid": "App. C.2's grid, or on Ant a part of it, with few trials.",
    "paper": "App. C.2's grid and trials.",
}
"""What to think of the numbers of each budget."""


def figures(trained: Trained) -> dict[str, Figure]:
    """Every figure, drawn, for which enough was trained to draw something."""
    drawn = {name: figure.draw(trained) for name, figure in FIGURES.items() if figure.is_there(name, trained)}
    drawn = {name: figure for name, figure in drawn.items() if figure.axes}
    for figure in drawn.values():
        settle(figure)
    return drawn


def page(trained: Trained, drawn: Mapping[str, Figure]) -> str:
    """The whole page as HTML, with the figures that were drawn."""
    sections = [_section(name, figure, trained, drawn.get(name)) for name, figure in FIGURES.items()]
    return render(TITLE, [*INTRODUCTION, *budgets(trained)], claims(trained), sections)


def claims(trained: Trained) -> list[Claim]:
    """What is said of all figures, in its order, each resting on the section of its figure."""
    placed = [
        (place, dataclasses.replace(judge(trained), section=name))
        for name, figure in FIGURES.items()
        for place, judge in figure.claims.items()
    ]
    return [claim for _, claim in sorted(placed, key=lambda entry: entry[0])]


def budgets(trained: Trained) -> list[str]:
    """A sentence for each budget that something was trained with: what, and what to think of it."""
    found: dict[str, list[str]] = {}
    for name, sweep in all_sweeps().items():
        if sweep.title and name in trained.sweeps:
            summary = trained.sweeps[name]
            found.setdefault(summary.provenance["budget"], []).append(f"{sweep.title} ({summary.study.trials} trials)")
    for name, table in trained.tables.items():
        found.setdefault(record_of(table)["budget"], []).append(name)
    return [f"Trained with budget {budget}: {', '.join(names)}. {BUDGETS[budget]}" for budget, names in found.items()]


def _section(name: str, figure: FigureStudy, trained: Trained, drawn: Figure | None) -> Section:
    title = figure.title if figure.number is None else f"Figure {figure.number}: {figure.title}"
    table = figure.table(trained) if figure.table and drawn else None
    missing = () if drawn else ("Not trained here.",)
    return Section(name, title, figure.caption, drawn, _facts(name, figure, trained), table, missing)


def _facts(name: str, figure: FigureStudy, trained: Trained) -> list[tuple[str, str]]:
    """Settings, versions, machines and the command behind a figure."""
    found = {sweep: trained.sweeps[sweep.name] for sweep in figure.sweeps if sweep.name in trained.sweeps}
    facts = [(f"sweep {sweep.name}", _told(summary)) for sweep, summary in found.items()]
    records = [summary.provenance for summary in found.values()]
    records += [record_of(trained.tables[name])] if name in trained.tables else []
    for word in ("versions", "machines"):
        values = dict.fromkeys(_shown(value) for record in records for value in record[word])
        facts += [(word, value) for value in values]
    made = [*dict.fromkeys(record["budget"] for record in records)] or ["paper"]
    for budget in made:
        of_budget = (sweep for sweep, summary in found.items() if summary.provenance["budget"] == budget)
        # Where budgets differ, the words are the tasks'.
        words = [name] if len(made) == 1 else dict.fromkeys((sweep.winners_of or sweep).name for sweep in of_budget)
        facts.append(("command", f"galton reproduce {' '.join(words)} --budget {budget} --out DIR"))
    return facts


def _told(summary: Summary) -> str:
    """A sentence on how much was trained, and which settings were best."""
    study, made = summary.study, summary.provenance
    minutes = (made["train_seconds"] + made["compile_seconds"]) / 60
    best = "; ".join(f"{LOSSES[loss].label} {best.setting.brief()}" for loss, best in summary.best.items())
    return (
        f"{len(study.settings)} settings × {study.trials} trials × {study.steps:,} steps, budget {made['budget']}, "
        f"{minutes:,.0f} minutes of one core. Best: {best}"
    )


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {version}" for name, version in value.items() if version)
    return str(value)
