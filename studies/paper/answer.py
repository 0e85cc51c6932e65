"""The head of the page: whether classification ends higher, on which tasks, with and without exploration."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from galton.losses import LOSSES
from galton.tasks import TASKS
from galton_experiments.analysis import fit_curves, rounded
from galton_experiments.analysis.plots import finish, panels
from galton_experiments.page import VERDICTS, Answer, Cell, Claim, Matrix
from studies.paper.curves import draw_best, draw_levels, shown
from studies.paper.measures import DETERMINISTIC, final_return, over_regression
from studies.paper.prose import text
from studies.paper.trained import Scale, Trained
from studies.paper.verdicts import Found, Unit, by_task, marks

_KINDS = ("training", "deterministic")
_COLORS = {"✓": VERDICTS[0], "✗": VERDICTS[2]}
_EXCEPTION = TASKS["acrobot"].title
"""The task on which the paper itself has regression end higher."""
_OF_EXCEPTION = {"✗": "it ends lower, as the paper says", "✓": "it ends higher, too", "≈": "neither is clear"}
_WORDS = {"✓": "higher", "✗": "lower", "≈": "neither clearly", "?": "too few runs"}


def answer(trained: Trained, claims: Sequence[Claim]) -> Answer:
    """The answer in words, a row for each task, and the learning curves of the paper's losses."""
    found = {kind: _gaps(trained, kind) for kind in _KINDS}
    given = {kind: marks(units) for kind, units in found.items()}
    return Answer(
        [_sentence(given[_KINDS[0]]), " ".join([*_further(trained, given[_KINDS[1]]), _counted(claims)])],
        Matrix("gain", [*_KINDS, "verdict"], _rows(found, given), narrow=True),
        text("page")["answer"]["note"],
        curves(trained) if trained.grids else None,
        text("page")["answer"]["caption"],
    )


def _gaps(trained: Trained, kind: str) -> dict[str, Found]:
    """Compare the better classification loss with the Gaussian, by the task's title."""

    def judge(task: str, _: Scale) -> dict[str, Found]:
        judged = trained.judged[task]
        kinds = [metric for metric in reversed(DETERMINISTIC) if metric in judged.again.table.column_names]
        metric = "training_return" if kind == _KINDS[0] else kinds[0]
        return {"": over_regression(judged, final_return, metric)}

    return by_task(trained, trained.judged, judge)


def _rows(found: Mapping[str, Mapping[str, Found]], given: Mapping[str, Mapping[str, str]]) -> dict[str, list[Cell]]:
    rows = {}
    for title in found[_KINDS[0]]:
        of_task = [given[kind][title] for kind in _KINDS]
        units = [found[kind][title] for kind in _KINDS]
        texts = ["—" if isinstance(unit, Unit) else rounded(unit.difference) for unit in units]
        cells = [Cell(told, _COLORS.get(mark)) for told, mark in zip(texts, of_task, strict=True)]
        rows[title] = [*cells, _verdict(*of_task)]
    return rows


def _verdict(training: str, deterministic: str) -> Cell:
    """Judge a task by both marks together."""
    if training == "∅":
        return Cell("null task", VERDICTS[3])
    if training == deterministic:
        return Cell(_WORDS[training], _COLORS.get(training, VERDICTS[3]))
    noisy = training in _COLORS and {training, deterministic} != {"✓", "✗"}
    told = f"{_WORDS[training]} with noise" if noisy else f"{_WORDS[deterministic]} without noise"
    return Cell(told, VERDICTS[1])


def _sentence(given: Mapping[str, str]) -> str:
    """On how many tasks classification clearly ends higher, of those that can be decided, and the paper's exception."""
    others = {title: mark for title, mark in given.items() if title != _EXCEPTION and mark in "✓✗≈"}
    if not others:
        return "Whether classification ends higher than regression can be decided on none of the tasks here."
    ends = {mark: [title for title, each in others.items() if each == mark] for mark in "✓✗≈"}
    words = {"✗": "clearly ends lower", "≈": "does neither clearly"}
    parts = [f"it clearly does on {len(ends['✓'])} of {len(others)} others{_named(ends['✓'])}"]
    parts += [f"{words[mark]} on {len(ends[mark])}{_named(ends[mark])}" for mark in "✗≈" if ends[mark]]
    said = f"The paper says that classification ends higher than regression almost everywhere but on {_EXCEPTION}"
    mark = given.get(_EXCEPTION, "")
    exception = f"; on {_EXCEPTION} {_OF_EXCEPTION[mark]}" if mark in _OF_EXCEPTION else ""
    return f"{said}. Here {', '.join(parts)}{exception}."


def _further(trained: Trained, given: Mapping[str, str]) -> list[str]:
    """Sentences on the deterministic policy, and on the tasks that were left out."""
    n = sum(mark in "✓✗≈" for mark in given.values())
    higher, lower = (sum(each == mark for each in given.values()) for mark in "✓✗")
    counts = f"{higher} of {n} end clearly higher and {lower} lower"
    without = f"By the deterministic policy, without the noise of exploration, {counts}."
    nulls = [(TASKS[task].title, why) for task, why in trained.nulls.items() if task in trained.judged]
    left_out = [f"{title} is left out ({why})." for title, why in nulls]
    few = [title for title, mark in given.items() if mark == "?"]
    return [*([without] if n else []), *left_out, *([f"Too few runs to decide: {', '.join(few)}."] if few else [])]


def _counted(claims: Sequence[Claim]) -> str:
    """Count the verdicts on the paper's statements, in a sentence."""
    counts = {verdict: sum(claim.verdict == verdict for claim in claims) for verdict in VERDICTS}
    words = ("hold", "hold in part", "do not hold", "can't be decided here")
    told = ", ".join(f"{n} {word}" for n, word in zip(counts.values(), words, strict=True) if n)
    return f"Of {len(claims)} statements of the paper {told}." if claims else ""


def _named(titles: Sequence[str]) -> str:
    return f" ({', '.join(titles)})" if titles else ""


def curves(trained: Trained) -> Figure:
    """The training return of the paper's losses on each task, small."""
    by_task = shown(trained)
    figure, axes = panels(len(by_task), columns=4, height=1.6, width=1.64, size=7.0)
    for panel, (task, summary) in zip(axes, by_task.items(), strict=True):
        of_paper = {loss: summary for loss in summary.best if LOSSES[loss].in_paper}
        fit_curves(panel, draw_best(panel, of_paper, "training_return"), draw_levels(panel, task))
        panel.set_title(f"{TASKS[task].title}, n = {summary.study.trials}", fontsize=7.5)
        panel.set_xlabel("steps")
    finish(figure, axes)
    return figure
