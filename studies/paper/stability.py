"""What §1 says of stability, in both readings: between seeds, and in a run that loses what it had."""

import numpy as np

from galton_experiments.analysis import mean_interval, rounded
from galton_experiments.page import Claim
from studies.paper.measures import apart, better, drawdown, final_return, versus
from studies.paper.prose import says
from studies.paper.scale import Scale
from studies.paper.trained import Trained
from studies.paper.verdicts import Found, by_task, claim, unit


def alike_between_seeds(trained: Trained) -> Claim:
    """The fourth contribution of §1, between runs: how far seeds end from one another."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        chosen, again = trained.judged[task]
        ours = better(chosen, final_return)
        found = versus(again, "gaussian", ours, apart)
        typical = (np.median(apart(again, loss)) / (scale.best - scale.rest) for loss in ("gaussian", ours))
        return {"": unit(found, "{:.3f} and {:.3f}, P = ".format(*typical) + f"{found.above:.2f}")}

    return claim(
        *says("alike_between_seeds"),
        by_task(trained, trained.judged, judge),
    )


def keeps_what_it_learns(trained: Trained) -> Claim:
    """The fourth contribution of §1, within a run: what is lost again of what had been reached."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        chosen, again = trained.judged[task]
        ours = better(chosen, final_return)
        found = versus(again, "gaussian", ours, lambda summary, loss: drawdown(summary, loss, scale))
        lost = (rounded(mean_interval(drawdown(again, loss, scale)), "") for loss in ("gaussian", ours))
        return {"": unit(found, f"{' and '.join(lost)}, P = {found.above:.2f}")}

    return claim(
        *says("keeps_what_it_learns"),
        by_task(trained, trained.judged, judge),
    )
