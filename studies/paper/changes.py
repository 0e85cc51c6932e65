"""What the study of hypotheses changes, one thing at a time, and the sweeps that train it."""

import dataclasses
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from galton.envs import LQR
from galton.losses import LOSSES
from galton.tasks import TASKS
from galton_experiments.runs import Summary
from galton_experiments.sweep import Setting, Study, expand, mean_returns, task_defaults
from studies.paper.sweeps import FRESH_TRIALS, MAIN, Budget, Done, Sweep, best_of_each_loss, on_fresh_seeds, task_study

Fields = Mapping[str, Any]

CONTROL = ("lqr", "mountain-car", "acrobot")
"""The analytic tasks with more than one step."""


@dataclasses.dataclass(frozen=True)
class Change:
    """One thing that is not as in the main experiment."""

    name: str
    """What tables call it."""
    tasks: tuple[str, ...]
    fields: Fields = dataclasses.field(default_factory=dict)
    """The settings that it sets."""
    of_task: Mapping[str, Fields] = dataclasses.field(default_factory=dict)
    """Those that differ from task to task."""
    losses: tuple[str, ...] = tuple(LOSSES)
    """The losses that it changes; the others are the main experiment's."""
    etas: tuple[float, ...] = (0.25, 0.75)
    """HL-Gauss's widths, in bins."""
    ground: str = ""
    """The suffix of the sweep that it is trained in: where the environment or the log points are others."""
    env_kwargs: Fields = dataclasses.field(default_factory=dict)

    def settings(self, task: str, budget: Budget) -> tuple[Setting, ...]:
        """The grid from which each loss's best setting is chosen: learning rates, and η where it is HL-Gauss's."""
        smoke, known = budget == "smoke", TASKS[task]
        rates = list(known.learning_rates) if known.in_jax else _MUJOCO_RATES[task]
        etas = {"hl-gauss": list(self.etas), "hl-gauss-centred": [2.0]}
        losses = [loss for loss in self.losses if not smoke or loss in ("gaussian", "hl-gauss")]
        shared = {"learning_rate": rates[1:2] if smoke else rates, "n_bins": 20 if smoke else 100}
        own = dict(self.fields) | dict(self.of_task.get(task, {}))
        blocks = [
            shared | {"loss": loss} | ({"eta": etas[loss][: 1 if smoke else None]} if loss in etas else {}) | own
            for loss in losses
        ]
        return expand(blocks, task_defaults(known.env))


_MUJOCO_RATES = {"reacher": [1e-4, 3e-4, 1e-3], "half-cheetah": [1e-4, 3e-4, 1e-3], "ant": [1e-4, 3e-4]}
_FLOORED = ("gaussian",)
_IN_ACTIONS = (0.01, 0.05, 0.1, 0.25, 0.5, 0.75)
"""The paper's six η, read as σ in units of the action: of a box of width 2 with 100 bins they are 0.5 to 37.5 bins."""


def _in_bins(width: float) -> tuple[float, ...]:
    return tuple(round(eta * 100 / width, 6) for eta in _IN_ACTIONS)


def _whole_episodes(n_steps: int, batch_size: int) -> Fields:
    return {"n_steps": n_steps, "batch_size": batch_size}


def _floor(std: float) -> Change:
    tasks = ("lqr", "mountain-car", "acrobot", "reacher", "half-cheetah", "ant", "bandit")
    return Change(f"σ at least {std:g}", tasks, {"log_std_min": round(math.log(std), 6)}, losses=_FLOORED)


def _lqr(name: str, ground: str, constants: Fields) -> Change:
    return Change(name, ("lqr",), ground=ground, env_kwargs=constants)


def _scaled(matrix: Any, factor: float) -> list[list[float]]:
    return [[entry * factor for entry in row] for row in matrix]


_ONE_PASS = {"algorithm": "ppo", "n_epochs": 1, "clip_range": 1e6}
"""PPO in one pass that clips no ratio: A2C's step on each minibatch in turn."""


class Hypothesis(NamedTuple):
    """A reason why the paper may have seen what we don't, with the changes that test it."""

    title: str
    open: str
    """What the paper says, or leaves open."""
    predicts: str
    """What is to be seen if it is the reason."""
    changes: tuple[Change, ...] = ()
    """Those that are trained as here; (a), (b) and (h) have sweeps of their own."""

    @property
    def told(self) -> str:
        """Both as the text of a table."""
        return f"{self.open} Predicted: {self.predicts[0].lower()}{self.predicts[1:]}"


HYPOTHESES: dict[str, Hypothesis] = {
    "a": Hypothesis(
        "The bandit in units of its box",
        "App. C.1 gives neither the box of the bandit's actions nor the units in which a policy acts. Here it acts in "
        "the environment's own, [−10, 10], with a first σ of 1.",
        "In [−1, 1] a first σ of 1 is half the width of the box: the Gaussian explores as widely as the softmax, but "
        "has a longer way to go before its noise is small.",
    ),
    "b": Hypothesis(
        "The scale of the action box",
        "Nothing is said of units. A softmax over bins has none; a Gaussian's first σ is in those of the action.",
        "Softmax policies learn the same to the bit at any scale, a Gaussian that starts at σ = 1 does not, and one in "
        "units of the box does.",
    ),
    "c": Hypothesis(
        "A floor under σ",
        '§4.3: it was "necessary to either normalize the gradient or clip σ above 0". By how much is not said.',
        "Noise that may not vanish costs the Gaussian everywhere but on Acrobot, where the noise is clipped at full "
        "torque; its deterministic policy does not pay for it.",
        tuple(map(_floor, (0.1, 0.2, 0.3, 0.5))),
    ),
    "d": Hypothesis(
        "An LQR on which holding still is bad",
        "App. C.1 gives neither matrices nor the length of an episode.",
        "Where more is to be gained by acting, a policy that goes still early is no longer close to the best.",
        (
            _lqr("LQR, R = 0.1", "r-0.1", {"R": _scaled(LQR().R, 0.1)}),
            _lqr("LQR, R = 0.01", "r-0.01", {"R": _scaled(LQR().R, 0.01)}),
            _lqr("LQR, spectral radius 1.02", "radius-1.02", {"A": _scaled(LQR().A, 1.02 / 0.98)}),
            _lqr(
                "LQR, spectral radius 1, 200 steps",
                "radius-1-steps-200",
                {"A": _scaled(LQR().A, 1 / 0.98), "max_episode_steps": 200},
            ),
        ),
    ),
    "e": Hypothesis(
        "Observations and rewards normalised together",
        "The paper does not mention normalisation; SB3's VecNormalize does both.",
        "Softmax policies, whose entropy falls with large advantages, gain more than the Gaussian.",
        (
            Change(
                "observations and rewards normalised",
                (*CONTROL, "reacher", "half-cheetah"),
                {"normalize_observation": True, "normalize_reward": True},
                etas=(0.25, 0.75, 2.0),
            ),
        ),
    ),
    "f": Hypothesis(
        "The critic",
        "The critic is learned by regressing to observed returns (§5.1, App. C.2); whether those are bootstrapped, and "
        "whether the gradients of actor and critic are clipped together, is not said. A rollout of a whole episode is "
        "longer than 20 steps, so it is cut into minibatches: that row changes two things.",
        "With a critic that is not late the bias of HL-Gauss is small, and an actor whose step the critic's error does "
        "not shorten learns sooner.",
        (
            Change("actor and critic clipped apart", CONTROL, {"clip_separately": True}),
            Change(
                "returns of whole episodes",
                (*CONTROL, "reacher"),
                _ONE_PASS,
                {
                    "lqr": _whole_episodes(100, 20),
                    "mountain-car": _whole_episodes(999, 27),
                    "acrobot": _whole_episodes(500, 20),
                    "reacher": _whole_episodes(50, 25),
                },
                ground="episodes",
            ),
        ),
    ),
    "g": Hypothesis(
        "η in units of the action",
        "§4.2 tunes η = σ / c without saying what c is. With c = 1, in units of the action, all six of the paper's η "
        "differ; in bins those up to 0.1 are HL-1-Hot.",
        "Wide targets do harm by their bias, unless rewards are normalised.",
        (
            Change("η in units of the action", CONTROL, losses=("hl-gauss",), etas=_in_bins(2.0)),
            Change(
                "η in units of the action, rewards normalised",
                CONTROL,
                {"normalize_reward": True},
                etas=_in_bins(2.0),
            ),
        ),
    ),
    "h": Hypothesis(
        "The lowest learning rate on MuJoCo",
        "App. C.2 tunes from 1e-4 on. An earlier grid of ours left that rate out on MuJoCo.",
        "The Gaussian's best rate is the lowest on offer, so a grid without it flatters classification.",
    ),
}
"""The hypotheses by the letter that the page gives them."""


def grounds() -> Iterator[tuple[str, str, list[Change]]]:
    """What is trained together: task, suffix, and the changes."""
    found: dict[tuple[str, str], list[Change]] = {}
    for hypothesis in HYPOTHESES.values():
        for change in hypothesis.changes:
            for task in change.tasks:
                found.setdefault((task, change.ground), []).append(change)
    for (task, ground), changes in found.items():
        yield task, ground, changes


_TRIALS: dict[Budget, int] = {"smoke": 2, "small": 2, "grid": 5, "paper": 5}
_FEWER = {"reacher": 3, "half-cheetah": 2, "ant": 2}
_FRESH = {"bandit": 50, "reacher": 5, "half-cheetah": 5, "ant": 3}


def _sweep(task: str, ground: str, changes: list[Change]) -> Sweep:
    def study(budget: Budget, _: Done) -> Study:
        settings = dict.fromkeys(setting for change in changes for setting in change.settings(task, budget))
        main = task_study(task, budget, tuple(settings))
        trials = min(_TRIALS[budget], _FEWER.get(task, _TRIALS[budget]))
        kwargs = json.dumps(dict(changes[0].env_kwargs))
        return dataclasses.replace(main, trials=trials, env_kwargs=kwargs)

    return Sweep("-".join(filter(None, ("hypotheses", task, ground))), study)


def _again(sweep: Sweep, task: str, changes: list[Change]) -> Sweep:
    def study(budget: Budget, done: Done) -> Study:
        chosen = done[sweep.name]
        winners = dict.fromkeys(w for change in changes for w in best_under(chosen, change, task, budget).values())
        return on_fresh_seeds(chosen.study, tuple(winners), 2 if budget == "smoke" else _FRESH.get(task, 20))

    return Sweep(f"{sweep.name}-again", study, winners_of=sweep)


def best_under(chosen: Summary, change: Change, task: str, budget: Budget) -> dict[str, Setting]:
    """Each loss's setting with the highest mean final training return under a change (App. C.2)."""
    return _best(chosen, change.settings(task, budget))


def best_without_lowest(chosen: Summary) -> dict[str, Setting]:
    """Each loss's best setting among those of a grid that do not have its lowest learning rate."""
    settings = chosen.study.settings
    lowest = min(setting["learning_rate"] for setting in settings)
    return _best(chosen, [setting for setting in settings if setting["learning_rate"] > lowest] or settings)


def _best(chosen: Summary, settings: Iterable[Setting]) -> dict[str, Setting]:
    means = mean_returns(chosen.study, chosen.table)
    found: dict[str, Setting] = {}
    for setting in settings:
        loss = setting["loss"]
        if setting in means and (loss not in found or means[setting] > means[found[loss]]):
            found[loss] = setting
    return found


def _without_lowest(task: str) -> Sweep:
    """The winners without the lowest learning rate that are not the main experiment's winners anyway."""

    def study(budget: Budget, done: Done) -> Study:
        chosen = done[task]
        winners = [*best_without_lowest(chosen).values()]
        new = [setting for setting in winners if setting not in best_of_each_loss(chosen)] or winners[:1]
        return on_fresh_seeds(chosen.study, tuple(new), FRESH_TRIALS.get(budget, {}).get(task))

    return Sweep(f"{task}-without-lowest-rate", study, winners_of=MAIN[task])


WITHOUT_LOWEST = {task: _without_lowest(task) for task in TASKS if not TASKS[task].in_jax}
"""Hypothesis (h): MuJoCo as it would be judged if the grid began at the second learning rate."""


SWEEPS: dict[tuple[str, str], Sweep] = {
    (task, ground): _sweep(task, ground, changes) for task, ground, changes in grounds()
}
"""What is trained to choose settings, by task and suffix."""
AGAIN: dict[tuple[str, str], Sweep] = {
    (task, ground): _again(SWEEPS[task, ground], task, changes) for task, ground, changes in grounds()
}
"""The winners under each change, on fresh seeds."""
