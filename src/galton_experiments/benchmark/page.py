"""The page of a benchmark: the answer, the scores, every task, and what each method was given."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from galton_experiments.analysis.plots import settle
from galton_experiments.analysis.scales import AXES
from galton_experiments.benchmark import factorial_page, tables
from galton_experiments.benchmark.answer import sentences
from galton_experiments.benchmark.figures import FIGURES, few
from galton_experiments.benchmark.found import Found
from galton_experiments.page.page import Answer, Section, render

_SCORE = (
    "A run's score on a task is its percentile among all methods' runs of the stage there: the share of them that are "
    "below it. Where both settings of a method are the same draw, its runs count twice. Scores of all tasks have the "
    "same scale, from 0 to 1. A method's score is the mean over tasks of its runs' mean. The interquartile mean (IQM) "
    "leaves out the lowest and the highest quarter of its runs, which may be all runs of a task. The 95% intervals "
    "come of drawing each task's runs again. They say nothing of the luck of the draws: other draws of the same "
    "priors would have given every method another setting."
)
_AGAINST = (
    "P(above) is the chance that a run is above one of the baseline's on a task that is drawn at random; a tie counts "
    "half. Its interval draws the runs of one seed together, and is too narrow with few seeds. With own settings both "
    "have the setting that was selected for the task. Sensitivity is what that gains over one setting for all tasks, "
    "by the same scores."
)
_RETURNS = (
    "Returns are means over fresh seeds with Student's 95% interval; a diverged run counts as the worst that any "
    "method had on the task, and as below it by rank. Runs of one trial have the same seed under all methods; p is "
    "that of a rank test of P(above) which exchanges the two of such a pair, or of Mann and Whitney's with fewer than "
    "eight. Difference, P and p are those of shared settings against the baseline's. Each method's p values are "
    "adjusted for the tasks of the stage by Holm's method."
)
_COUNTED = ("A run of a setting that was selected for all tasks and for its own is counted twice, and trained once.",)
_BEST_OF = (
    "The mean over all subsets of n draws, exactly, of the score of the draw that is best among them. With several "
    "seeds the draw is chosen by all but one of them and judged by that one, so that the best does not flatter."
)


def figures(found: Found) -> dict[str, Figure]:
    """Every figure for which enough was trained."""
    known = factorial_page.FIGURES if found.protocol.design == "factorial" else FIGURES
    drawn = {name: draw(found) for name, draw in known.items()}
    drawn = {name: figure for name, figure in drawn.items() if figure.axes}
    for figure in drawn.values():
        settle(figure)
    return drawn


def page(found: Found, drawn: Mapping[str, Figure]) -> str:
    """The whole page as HTML, the same for the same runs."""
    in_stages = found.protocol.design == "stages"
    sections = (_of_stages if in_stages else factorial_page.sections)(found, drawn)
    sections += [
        Section("tasks", "What was trained", table=tables.tasks(found), paragraphs=(tables.trained(found),)),
        Section("fixed", "What was fixed", table=tables.fixed(found)),
        Section("budget", "What each method was given", table=tables.budget(found), paragraphs=_COUNTED * in_stages),
        Section("prior", "What was searched", table=tables.prior(found), paragraphs=(_file(found),)),
    ]
    return render(found.protocol.title, (), (), sections, Answer(sentences(found)))


def _of_stages(found: Found, drawn: Mapping[str, Figure]) -> list[Section]:
    """The sections of what the stages found."""
    sections: list[Section] = []
    metric, there = tables.metric(found), {stage: t for stage, t in tables.STAGES.items() if stage in found.standings}
    for stage, title in there.items():
        shown = drawn.get("scores") if not sections else None
        text: tuple[str, ...] = () if sections else (_SCORE, _AGAINST)
        table = tables.scores(found, stage)
        sections.append(Section(f"scores-{stage}", f"Scores by {metric}: {title}", "", shown, table, text))
    for i, (stage, title) in enumerate(there.items()):
        text = () if i else (_RETURNS,)
        table = tables.returns(found, stage)
        sections.append(Section(f"returns-{stage}", f"{metric.capitalize()}: {title}", "", None, table, text))
        if len(found.protocol.methods) > 2:
            name = f"pairs-{stage}"
            sections.append(Section(name, f"Each two methods: {title}", table=tables.pairs(found, stage)))
    if "curves" in drawn:
        caption = (
            "Shared settings on fresh seeds: the mean of all runs that have not diverged so far, and its 95% interval. "
            f"{AXES} {few(found)}"
        )
        sections.append(Section("curves", "Learning curves", caption, drawn["curves"]))
    if "best-of-n" in drawn:
        caption = f"{_BEST_OF} {few(found)}".rstrip()
        sections.append(Section("best-of-n", "What tuning brings", caption, drawn["best-of-n"], tables.best_of(found)))
    return [*sections, Section("selected", "What was selected", table=tables.settings(found))]


def _file(found: Found) -> str:
    """Name the file that all of this comes from, by its hash."""
    return (
        f"All of this was made by one file, whose content has the hash {found.protocol.digest}. The common fields come "
        "from one Latin hypercube for all methods, a method's own fields from a second one beside it."
    )
