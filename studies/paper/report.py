"""The page: the answer, what holds of the paper, every figure, and how all was made."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from galton_experiments.analysis.plots import images, settle
from galton_experiments.page import Claim, Section, render
from galton_experiments.sweep import Store
from studies.paper import hypotheses, made, tables
from studies.paper.answer import answer
from studies.paper.figure import FigureStudy
from studies.paper.registry import FIGURES
from studies.paper.trained import Trained

TITLE = "Replacing implicit regression with classification: what holds"
INTRODUCTION = (
    "The paper replaces the regression that hides in Gaussian policy gradients by classification: a softmax over "
    "bins, trained with a cross-entropy towards the sampled bin (HL-1-Hot) or a Gaussian histogram around it "
    "(HL-Gauss). Here all of that is trained again, and what the paper says stands beside what was measured.",
    "A claim has a decision for each task, or for what else its lines name. Each is a rank test of P, the chance that "
    "a run of the first is above one of the second: Mann and Whitney's, or where eight or more pairs of runs have "
    "common seeds the one that exchanges the two of a pair. Those of a claim are adjusted together (Holm); clear is "
    "what stays below p = 0.05, if the mean points the way that P does. Numbers of a single loss, such as how much a "
    "setting moves it, are judged by Student's t test instead, and so is whether two losses differ by little. "
    "Intervals are 95% intervals of the mean, each by itself. A run that diverges counts as the worst of its sweep. "
    "Beside a verdict stands how many of the decisions are clearly as the paper says. A claim holds if all that can "
    "be decided are, and does not if more are clearly the contrary; in between it holds in part. Tasks on which fewer "
    "than one run in a hundred ever earns more than rest are null, and no claim on returns counts them.",
    "Rest is what doing nothing earns, or acting at random where that is known and better; rest → best is the way "
    "from there to the optimum, or where that is not known to the best mean final return of any setting on the grid, "
    "in training or of the deterministic policy. Centred HL-Gauss (dash-dotted) is not the paper's. It is HL-Gauss "
    "without a bias that docs/paper.md derives, on a grid of its own with wider targets, and no claim compares it. "
    "App. C.2 has 20 trials of each of 88 settings. Where a task has fewer of either, Figures 4 to 7 say it above its "
    "panel, and the last table has both for every sweep.",
)
FIRST = (hypotheses.NAME,)
"""The figures that stand before the claims."""


def figures(trained: Trained) -> dict[str, Figure]:
    """Every figure, drawn, for which enough was trained to draw something."""
    drawn = {name: figure.draw(trained) for name, figure in FIGURES.items() if figure.is_there(name, trained)}
    drawn = {name: figure for name, figure in drawn.items() if figure.axes}
    for figure in drawn.values():
        settle(figure)
    return drawn


def page(trained: Trained, drawn: Mapping[str, Figure]) -> str:
    """The whole page as HTML, with the figures that were drawn."""
    judged = claims(trained)
    sections = [_section(name, figure, trained, drawn.get(name)) for name, figure in FIGURES.items()]
    there = [made.section(trained)] if trained.sweeps or trained.tables else []
    head = answer(trained, judged)
    if head.figure is not None:
        settle(head.figure)
    return render(TITLE, INTRODUCTION, judged, [*sections, *there], head)


def write(folder: Path, trained: Trained) -> None:
    """Figures and page into a folder; the same data give the same bytes."""
    drawn, store = figures(trained), Store(str(folder))
    html = page(trained, drawn)  # before anything is written, for it may be refused
    pictures = {f"{name}{suffix}": image for name in drawn for suffix, image in images(drawn[name]).items()}
    for name, image in pictures.items():
        store.write(f"figures/{name}", image)
    for name in {f"{figure}{suffix}" for figure in FIGURES for suffix in (".png", ".svg")} - {*pictures}:
        store.remove(f"figures/{name}")  # of what a former version drew, or from data that have gone
    store.write("index.html", html.encode())
    store.write(tables.FILE, tables.document(trained).encode())
    print(f"{len(drawn)} figures and the page: {folder / 'index.html'}")


def claims(trained: Trained) -> list[Claim]:
    """What is said of all figures, in its order, each resting on the section of its figure."""
    placed = [
        (place, dataclasses.replace(judge(trained), section=name))
        for name, figure in FIGURES.items()
        for place, judge in figure.claims.items()
    ]
    return [claim for _, claim in sorted(placed, key=lambda entry: entry[0])]


def _section(name: str, figure: FigureStudy, trained: Trained, drawn: Figure | None) -> Section:
    title = figure.title if figure.number is None else f"Figure {figure.number}: {figure.title}"
    table = figure.table(trained) if figure.table and drawn else None
    missing = () if drawn else ("Not trained here.",)
    return Section(name, title, figure.caption, drawn, table, missing, name in FIRST)
