"""Figure 2: training return of each loss's best setting, on all seven tasks."""

from galton.studies.base import FigureStudy
from galton.studies.curves import best_curves
from galton.tasks import TASKS

FIGURE = FigureStudy(
    "Training return",
    "Undiscounted training return of each loss's best setting (highest mean final training return): mean over trials "
    "and 95% confidence interval of the runs that it was chosen by. Claims are judged by others, on fresh seeds, which "
    "are in the table. The dashed line is the best that any policy can do, where that is known; the dotted line is "
    "what the action 0 earns, always taken. In the table the mean of a curve is how a loss does over training, and "
    "the noise of exploration costs what the deterministic policy earns more over training.",
    (*TASKS, *(f"{task}-again" for task in TASKS)),
    lambda data: best_curves(data, tuple(TASKS), "training_return"),
)
