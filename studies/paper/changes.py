"""The study of hypotheses makes these changes, one thing at a time, and trains them in these sweeps."""

import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

from galton.envs import LQR
from galton.losses import LOSSES
from galton.tasks import TASKS
from galton_experiments.runs import Summary
from galton_experiments.sweep import Setting, expand, mean_returns, task_defaults
from studies.paper.sweeps import MAIN, Budget, Sweep, again, best_of_each_loss, grid

Fields = Mapping[str, Any]
CONTROL = ("lqr", "mountain-car", "acrobot")
"""The analytic tasks with more than one step."""
_MUJOCO_RATES = {"reacher": [1e-4, 3e-4, 1e-3], "half-cheetah": [1e-4, 3e-4, 1e-3], "ant": [1e-4, 3e-4]}


@dataclasses.dataclass(frozen=True)
class Variant:
    """The main experiment with one thing that is not as in it, to be judged in its place."""

    name: str
    """The name that the table has for it."""
    sweeps: Mapping[str, tuple[Sweep, Sweep]]
    """By task, what settings are chosen by, and what judges them."""
    winners: Callable[[str, Summary, Summary], Mapping[Setting, Setting]]
    """The settings that were chosen, from the task and both sweeps, and what judges each."""
    losses: Collection[str] | None = tuple(LOSSES)
    """The losses that it changes, None for those of the winners; the others are the main experiment's."""


@dataclasses.dataclass(frozen=True)
class Change:
    """Settings, or constants of the environment, under which each loss's setting is chosen anew."""

    name: str
    tasks: tuple[str, ...]
    fields: Fields = dataclasses.field(default_factory=dict)
    """The settings that it sets."""
    of_task: Mapping[str, Fields] = dataclasses.field(default_factory=dict)
    """Those that differ from task to task."""
    losses: tuple[str, ...] = tuple(LOSSES)
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

    @property
    def variant(self) -> Variant:
        """Its winners in the place of the main experiment's."""
        sweeps = {task: (SWEEPS[task, self.ground], AGAIN[task, self.ground]) for task in self.tasks}

        def winners(task: str, chosen: Summary, _: Summary) -> Mapping[Setting, Setting]:
            return {each: each for each in _best(chosen, self.settings(task, chosen.provenance["budget"]))}

        return Variant(self.name, sweeps, winners, self.losses)


_IN_ACTIONS = (0.5, 2.5, 5.0, 12.5, 25.0, 37.5)
"""The paper's six η, read as σ in units of the action, in bins: 100 of them in a box of width 2."""


def _floor(std: float) -> Change:
    tasks = (*CONTROL, "reacher", "half-cheetah", "ant", "bandit")
    return Change(f"σ at least {std:g}", tasks, {"log_std_min": round(math.log(std), 6)}, losses=("gaussian",))


def _lqr(name: str, ground: str, **constants: Any) -> Change:
    return Change(f"LQR, {name}", ("lqr",), ground=ground, env_kwargs=constants)


def _scaled(matrix: Any, factor: float) -> list[list[float]]:
    return [[entry * factor for entry in row] for row in matrix]


_ONE_PASS = {"algorithm": "ppo", "n_epochs": 1, "clip_range": 1e6}
"""PPO in one pass that clips no ratio: A2C's step on each minibatch in turn."""
_WHOLE_EPISODES = {"lqr": (100, 20), "mountain-car": (999, 27), "acrobot": (500, 20), "reacher": (50, 25)}
"""Steps of an episode, and of a minibatch."""
_NORMALISED = {"normalize_observation": True, "normalize_reward": True}
CHANGES: dict[str, tuple[Change, ...]] = {
    "c": tuple(map(_floor, (0.1, 0.2, 0.3, 0.5))),
    "d": (
        _lqr("R = 0.1", "r-0.1", R=_scaled(LQR().R, 0.1)),
        _lqr("R = 0.01", "r-0.01", R=_scaled(LQR().R, 0.01)),
        _lqr("spectral radius 1.02", "radius-1.02", A=_scaled(LQR().A, 1.02 / 0.98)),
        _lqr("spectral radius 1, 200 steps", "radius-1-steps-200", A=_scaled(LQR().A, 1 / 0.98), max_episode_steps=200),
    ),
    "e": (
        Change(
            "observations and rewards normalised",
            (*CONTROL, "reacher", "half-cheetah"),
            _NORMALISED,
            etas=(0.25, 0.75, 2.0),
        ),
    ),
    "f": (
        Change("actor and critic clipped apart", CONTROL, {"clip_separately": True}),
        Change(
            "returns of whole episodes",
            tuple(_WHOLE_EPISODES),
            _ONE_PASS,
            {task: {"n_steps": steps, "batch_size": batch} for task, (steps, batch) in _WHOLE_EPISODES.items()},
            ground="episodes",
        ),
    ),
    "g": (
        Change("η in units of the action", CONTROL, losses=("hl-gauss",), etas=_IN_ACTIONS),
        Change("η in units of the action, rewards normalised", CONTROL, {"normalize_reward": True}, etas=_IN_ACTIONS),
    ),
}
"""The changes that test a hypothesis, by its letter in hypotheses.toml; (a), (b) and (h) have sweeps of their own."""
_GROUNDS: dict[tuple[str, str], list[Change]] = {}
for _change in (change for changes in CHANGES.values() for change in changes):
    for _task in _change.tasks:
        _GROUNDS.setdefault((_task, _change.ground), []).append(_change)

_TRIALS: dict[Budget, int] = {"smoke": 2, "small": 2, "grid": 5, "paper": 5}
_FEWER = {"reacher": 3, "half-cheetah": 2, "ant": 2}
_FRESH = {"bandit": 50, "reacher": 5, "half-cheetah": 5, "ant": 3}


def _sweep(task: str, ground: str, changes: list[Change]) -> Sweep:
    return grid(
        "-".join(filter(None, ("hypotheses", task, ground))),
        task,
        lambda budget: (setting for change in changes for setting in change.settings(task, budget)),
        trials=lambda budget: min(_TRIALS[budget], _FEWER.get(task, _TRIALS[budget])),
        env_kwargs=changes[0].env_kwargs,
    )


def _again(sweep: Sweep, task: str, changes: list[Change]) -> Sweep:
    def winners(chosen: Summary, budget: Budget) -> Iterable[Setting]:
        return (winner for change in changes for winner in _best(chosen, change.settings(task, budget)))

    return again(sweep, winners, trials=lambda budget: 2 if budget == "smoke" else _FRESH.get(task, 20))


SWEEPS = {key: _sweep(*key, changes) for key, changes in _GROUNDS.items()}
"""The sweeps that choose settings, by task and suffix."""
AGAIN = {key: _again(SWEEPS[key], key[0], changes) for key, changes in _GROUNDS.items()}
"""The winners under each change, on fresh seeds."""


def _best(chosen: Summary, settings: Iterable[Setting]) -> tuple[Setting, ...]:
    """Each loss's setting with the highest mean final training return (App. C.2)."""
    means = mean_returns(chosen.study, chosen.table)
    found: dict[str, Setting] = {}
    for setting in settings:
        loss = setting["loss"]
        if setting in means and (loss not in found or means[setting] > means[found[loss]]):
            found[loss] = setting
    return tuple(found.values())


def _best_without_lowest(chosen: Summary) -> tuple[Setting, ...]:
    """Each loss's best setting among those of a grid that do not have its lowest learning rate."""
    settings = chosen.study.settings
    lowest = min(setting["learning_rate"] for setting in settings)
    return _best(chosen, [setting for setting in settings if setting["learning_rate"] > lowest] or settings)


def _other_winners(chosen: Summary, _: Budget) -> tuple[Setting, ...]:
    """Those of them that are not the main experiment's winners anyway."""
    winners = _best_without_lowest(chosen)
    return tuple(each for each in winners if each not in best_of_each_loss(chosen)) or winners[:1]


WITHOUT_LOWEST = Variant(
    "MuJoCo without the learning rate 1e-4",
    {
        task: (MAIN[task], again(MAIN[task], _other_winners, name=f"{task}-without-lowest-rate"))
        for task in TASKS
        if not TASKS[task].in_jax
    },
    lambda _, chosen, done: {each: each for each in _best_without_lowest(chosen) if each in done.study.settings},
    losses=None,
)
"""Hypothesis (h): MuJoCo as it would be judged if the grid began at the second learning rate."""
