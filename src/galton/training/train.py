"""Many runs of agents of one structure, trained side by side."""

import contextlib
import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Int

from galton.algorithms import Agent
from galton.errors import require, require_integer, require_word
from galton.fields import checked
from galton.training.log import MEAN_ACTION_RETURN, Log
from galton.training.population import Population, populate
from galton.types import Learner, Rule

Kept = dict[str, np.ndarray]
"""A training that was left at a log point, as arrays by name."""
Keep = Callable[[Callable[[], Kept | None]], None]
"""It is called with a function that makes a `Kept`, or None where nothing can go on."""
_STATE, _LOG, _CALL, _SECONDS = "state/", "log/", "call/", "seconds"


@dataclasses.dataclass(frozen=True)
class Result:
    """The result of `train`: R trained runs with L log points each."""

    agent: Agent
    """The agent of all runs; its numbers are `[R]`, one for each."""
    seeds: Int[np.ndarray, " R"]
    """The seed of each run."""
    steps: Int[np.ndarray, " L"]
    """Environment steps taken at each log point."""
    log: Log
    """The record of each log point, numpy arrays `[R, L]`."""
    diverged_at: Int[np.ndarray, " R"]
    """The step at which a run diverged, −1 for a run that did not."""
    learner: Learner
    """The learner of each run, each leaf a numpy array `[R, ...]`."""
    compile_seconds: float
    """The time that it took to compile the programs, in seconds."""
    train_seconds: float
    """The time that training took besides compiling, in seconds, evaluation included."""

    @property
    def steps_per_second(self) -> float:
        """Environment steps of training, all runs together, per second; evaluation's time included."""
        return len(self.seeds) * float(self.steps[-1]) / self.train_seconds

    def final(self, metric: str, fraction: float = 0.05) -> Float[np.ndarray, " R"]:
        """A metric's mean over the last 5% of the log points (at least one) of each run.

        NaN for a diverged run. Points without a finished episode don't count; if all lack one, the last before
        them does.
        """
        columns = self.log.columns()
        require_word("metric", metric, columns)
        return final(np.asarray(columns[metric]), self.diverged_at, fraction)


def final(
    curves: Float[np.ndarray, "R L"], diverged_at: Int[np.ndarray, " R"], fraction: float = 0.05
) -> Float[np.ndarray, " R"]:
    """The mean of each curve over its last part, as `Result.final` describes it."""
    last = curves[:, -max(1, round(fraction * curves.shape[1])) :]
    known = ~np.isnan(last)
    mean = np.where(known, last, 0).sum(1) / np.maximum(known.sum(1), 1)
    latest = np.where(np.isnan(curves), -1, np.arange(curves.shape[1])).max(1)
    mean = np.where(known.any(1), mean, curves[np.arange(len(curves)), latest])
    return np.where(diverged_at >= 0, np.nan, mean)


def train(
    env: object,
    agent: Agent,
    seeds: Sequence[int],
    total_timesteps: int,
    *,
    n_logs: int = 100,
    n_eval_episodes: int = 10,
    eval_mean: bool = False,
    on_log: Callable[[int, Log], None] | None = None,
    meanwhile: Callable[[int], None] | None = None,
    keep: Keep | None = None,
    kept: Kept | None = None,
    devices: Sequence[jax.Device] | None = None,
) -> Result:
    """Train R runs side by side, one per seed.

    Args:
        env: what `galton.envs.find` takes: a record of ours, a name, a Gymnasium id, a function that makes one.
        agent: of all runs, as `galton.make_agent` makes it or `galton.Agent` of its parts; each of its numbers is one
            for all runs or an array `[R]`.
        seeds: R integers; a run is determined by its seed and its settings.
        total_timesteps: per run; rounded up to whole updates and log points.
        n_logs: log points at most, with as many updates between each two.
        n_eval_episodes: episodes of each evaluation at each log point; 0 turns evaluation off.
        eval_mean: whether each evaluation plays the same episodes once more by the mean of the policy's distribution,
            for the log's `mean_action_return`; most densities have one deterministic action and play them once.
        on_log: called at each log point with the steps so far and the log's `[R]` arrays.
        meanwhile: called about twice a second with the steps so far; what it raises ends training.
        keep: called at each log point but the last with a function that gives the arrays from which `kept` goes on, or
            None where the environments can't tell their states.
        kept: such arrays of the same call, from which it goes on to the same bits; what they hold is not trained again.
        devices: the JAX devices that the runs are split over; by default all of this process.

    Raises:
        UsageError: a number out of range, an environment that can't be used, or arrays of another call.
        BrokenEnvironmentError: an environment broke on the way.
    """
    check_arguments(seeds, total_timesteps, n_logs, n_eval_episodes)
    _check_numbers(agent, len(seeds))
    size = agent.rollout.size
    steps = log_points(size, total_timesteps, n_logs)
    check_length(total_timesteps, int(steps[-1]) // size)
    agent = jax.tree.map(lambda number: np.broadcast_to(np.asarray(number, np.float32), len(seeds)), agent)
    updates_per_log = int(steps[0]) // size
    with contextlib.closing(populate(env, agent, seeds, devices)) as population:
        rules = _rules(agent, eval_mean) if n_eval_episodes else {}
        call = {f"{_CALL}{i}": np.array(x) for i, x in enumerate((seeds, steps, *jax.tree.leaves(agent)))}
        trained = _train(
            population, steps, updates_per_log, n_eval_episodes, rules, on_log, meanwhile, keep, kept, call
        )
    return Result(agent, np.asarray(seeds), steps, *trained)


PIECE = 0.5
"""Seconds that a piece of training takes, about, unless a single update takes longer."""


class Pieces:
    """Cuts training by `advance` into pieces of half a second. How long an update takes is learnt on the way."""

    def __init__(self, advance: Callable[[int], None]) -> None:
        self._advance, self._n = advance, 1

    def train(self, at_most: int) -> int:
        """Train for a piece of at most so many updates, and return how many they were."""
        n, start = min(self._n, at_most), time.perf_counter()
        self._advance(n)
        seconds = max(time.perf_counter() - start, 1e-9)
        if n == self._n or seconds > PIECE:
            self._n = max(1, min(2 * n, int(n * PIECE / seconds)))
        return n


def _rules(agent: Agent, eval_mean: bool) -> dict[str, Rule | None]:
    """The columns of the log that evaluation fills, and by which action; None is the configuration's own."""
    rules: dict[str, Rule | None] = {"evaluation_return": None}
    if eval_mean:
        rules[MEAN_ACTION_RETURN] = None if agent.policy.acting_by("mean") is agent.policy else "mean"
    return rules


def _train(
    population: Population,
    steps: Int[np.ndarray, " L"],
    updates_per_log: int,
    n_eval_episodes: int,
    rules: Mapping[str, Rule | None],
    on_log: Callable[[int, Log], None] | None,
    meanwhile: Callable[[int], None] | None,
    keep: Keep | None,
    kept: Kept | None,
    call: Kept,
) -> tuple[Log, Int[np.ndarray, " R"], Learner, float, float]:
    """Train from log point to log point: log, divergences, learner, and the seconds of compiling and of training."""
    if n_eval_episodes:
        population.check_evaluation(n_eval_episodes)
    population.decay_over(0, int(steps[-1]))
    population.compile()
    compiled, start = population.compile_seconds, time.perf_counter()
    logs: list[Log] = []
    pieces, earlier = Pieces(population.advance), _restored(population, kept, call)

    def whole_log() -> Log:
        stacked: Log = jax.tree.map(lambda *x: np.stack(x, axis=1), *logs)
        for name, values in earlier.items():
            stacked = stacked.having(name, np.concatenate([values, stacked.columns()[name]], axis=1))
        return stacked

    def seconds() -> Float[np.ndarray, " 2"]:
        compiling = population.compile_seconds
        own = np.array([compiling, time.perf_counter() - start - (compiling - compiled)])
        return own if kept is None else own + kept[_SECONDS]

    def to_keep() -> Kept | None:
        snapshot = population.snapshot()
        if "environments" not in snapshot:
            return None
        state = {f"{_STATE}{i}": np.asarray(leaf) for i, leaf in enumerate(jax.tree.leaves(snapshot))}
        log = {f"{_LOG}{name}": np.asarray(values) for name, values in whole_log().columns().items()}
        return state | log | call | {_SECONDS: seconds()}

    for step in steps[next((values.shape[1] for values in earlier.values()), 0) :]:
        to_go = updates_per_log
        while to_go:
            to_go -= pieces.train(to_go)
            if meanwhile:
                meanwhile(population.step)
        log = population.log()
        played = {rule: population.evaluate(n_eval_episodes, rule).mean(1) for rule in dict.fromkeys(rules.values())}
        for name, rule in rules.items():
            log = log.having(name, np.where(population.diverged_at < 0, played[rule], np.nan))
        logs.append(log)
        if on_log:
            on_log(int(step), log)
        if keep and step != steps[-1]:
            keep(to_keep)
    learner, diverged_at = population.learner, population.diverged_at
    return whole_log(), diverged_at, learner, *seconds().tolist()


def _restored(population: Population, kept: Kept | None, call: Kept) -> Kept:
    """The columns `[R, l]` of an earlier log, whose state the population goes on from; nothing where none was kept."""
    if kept is None:
        return {}
    leaves, structure = jax.tree.flatten(population.snapshot())
    found = [kept.get(f"{_STATE}{i}", np.zeros(0)) for i in range(len(leaves))]
    same = all(np.array_equal(kept.get(name, ()), value, equal_nan=True) for name, value in call.items())
    same &= all(one.shape == np.shape(own) for one, own in zip(found, leaves, strict=True))
    require(same, "kept is of other runs than these; give what the same call was to keep")
    population.restore(jax.tree.unflatten(structure, found))
    return {name.removeprefix(_LOG): values for name, values in kept.items() if name.startswith(_LOG)}


def check_length(total_timesteps: int, n_updates: int) -> None:
    """Raise UsageError for more updates than a run counts."""
    require(n_updates < 2**31, f"total_timesteps is {total_timesteps}; a run counts up to 2³¹ − 1 updates")


def log_points(rollout_size: int, total_timesteps: int, n_logs: int) -> Int[np.ndarray, " L"]:
    """The environment steps at which `train` writes its log: whole updates, as many between each two."""
    n, interval = log_plan(rollout_size, total_timesteps, n_logs)
    return (1 + np.arange(n)) * interval


def log_plan(rollout_size: int, total_timesteps: int, n_logs: int) -> tuple[int, int]:
    """The number of log points, and the environment steps between each two."""
    n_updates = -(-total_timesteps // rollout_size)
    updates_per_log = -(-n_updates // min(n_logs, n_updates))
    return -(-n_updates // updates_per_log), updates_per_log * rollout_size


def check_arguments(seeds: Sequence[int], total_timesteps: int, n_logs: int, n_eval_episodes: int) -> None:
    """Raise UsageError for what `train` can't take."""
    require(np.ndim(seeds) == 1, f"seeds is {seeds}; give a sequence of integers, such as range(5)")
    require(len(seeds) >= 1, "seeds is empty; give at least 1")
    for seed in seeds:
        check_seed(seed)
    require_integer("total_timesteps", total_timesteps, 1)
    require_integer("n_logs", n_logs, 1)
    require_integer("n_eval_episodes", n_eval_episodes, 0)


def _check_numbers(agent: Agent, n_runs: int) -> None:
    """Raise UsageError for anything but an agent whose numbers are one each, or one for each run."""
    checked("agent", agent, Agent)
    for path, numbers in jax.tree_util.tree_leaves_with_path(agent):
        name, shape = _named(path), np.shape(numbers)
        require(
            shape in ((), (n_runs,)), f"{name} has shape {shape}; it must be a number, or [{n_runs}]: one for each run"
        )


def _named(path: Sequence[Any]) -> str:
    """The setting at a place in an agent; of a schedule its number."""
    return ".".join(key.name for key in path[1:])


def check_one_run(agent: Agent) -> None:
    """Raise UsageError for anything but an agent whose numbers are one each."""
    checked("agent", agent, Agent)
    for path, value in jax.tree_util.tree_leaves_with_path(agent):
        require(np.ndim(value) == 0, f"{_named(path)} is {value}; give one number (train alone takes one for each run)")


def check_seed(seed: int) -> None:
    """Raise UsageError unless it is an integer from 0 to 2³² − 1."""
    require_integer("seed", seed, 0)
    require(seed < 2**32, f"seed is {seed}; it must be less than 2³²")
