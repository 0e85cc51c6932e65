"""Figure 9: the training returns that the paper has no room for in Figure 2."""

from galton.studies.base import FigureStudy
from galton.studies.curves import best_curves

_TASKS = ("lqr", "acrobot")

FIGURE = FigureStudy(
    "Training return on the LQR and on Acrobot",
    "Two panels of Figure 2, as the paper has them in its appendix.",
    (*_TASKS, *(f"{task}-again" for task in _TASKS)),
    lambda data: best_curves(data, _TASKS, "training_return"),
)
