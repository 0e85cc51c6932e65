"""Figure 8: return of the deterministic policy, for the settings of Figure 2."""

from galton.studies.base import FigureStudy
from galton.studies.curves import best_curves
from galton.tasks import TASKS

FIGURE = FigureStudy(
    "Evaluation return",
    "Undiscounted return of the deterministic policy (the Gaussian's mean, the softmax's most likely bin) during "
    "training, with the settings of Figure 2: mean over trials and 95% confidence interval. Unlike "
    "training returns they are without the noise of exploration.",
    tuple(TASKS),
    lambda data: best_curves(data, tuple(TASKS), "evaluation_return"),
)
