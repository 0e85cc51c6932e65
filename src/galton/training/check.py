"""`check_env` finds out in about five seconds what Galton makes of an environment: will it learn here?"""

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np
from gymnasium.spaces import Box
from gymnasium.wrappers import TimeLimit

from galton.decimals import fitting
from galton.envs.find import find
from galton.envs.host.actions import Actions
from galton.envs.host.base import HostEnvironments
from galton.envs.host.gymnasium import GymnasiumTask
from galton.envs.host.observations import IMAGE_REMEDY, Observations
from galton.envs.host.statistics import statistics_of, wrappers_at
from galton.envs.host.vector import VectorTask
from galton.envs.jax_task import JaxTask
from galton.envs.task import Task
from galton.errors import BrokenEnvironmentError, UsageError
from galton.training.evaluate import opened
from galton.training.probe import Played, Repeated, Spread, aliases, played, repeated
from galton.training.yardsticks import SEED, at_random, nothing

SECONDS, N_EPISODES = 2.0, 10
"""The most seconds, and the number of episodes, for which doing nothing and random actions are each played."""
LARGE, SMALL = 10.0, 0.01
"""Beyond these the entries of observations, and rewards, are what networks learn badly from."""
SLOW = 500.0
"""Steps a second below which it is the environment that training waits for."""


@dataclasses.dataclass(frozen=True)
class Finding:
    """One thing that was found out about an environment."""

    name: str
    """The aspect of the environment that was looked at."""
    value: str
    """The finding in words, with its numbers."""
    remedy: str = ""
    """The advice on what to do about it; empty where all is well."""
    ok: bool = True
    """True if the environment can be trained on despite the finding."""

    def __str__(self) -> str:
        mark = "" if not self.remedy and self.ok else "note: " if self.ok else "stop: "
        remedy = f"\n{'':24}-> {self.remedy}" if self.remedy else ""
        return f"{self.name:24}{mark}{self.value}{remedy}"


@dataclasses.dataclass(frozen=True, repr=False)
class Check:
    """All that was found out about an environment. It is shown as a line for each finding, with its remedy below."""

    findings: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """True if the environment can be trained on."""
        return all(finding.ok for finding in self.findings)

    def __repr__(self) -> str:
        return "\n".join(map(str, self.findings))


def check_env(env: object, env_kwargs: Mapping[str, object] | None = None) -> Check:
    """Find out in about five seconds what Galton makes of an environment, and what to do about what is amiss.

    Doing nothing and random actions are played on a copy of it, or on itself if it is there already. What it raises or
    answers wrongly is a finding, and not an error.

    Args:
        env: what a model takes: an id, a function that makes one, an environment, a vector environment, a record.
        env_kwargs: keyword arguments for an id or a name.
    """
    found: list[Finding] = []
    try:
        found.extend(_findings(env, env_kwargs or {}))  # those before an error stay
    except UsageError as error:
        said, _, remedy = str(error).partition("; ")
        found.append(Finding("environment", said, remedy or "make it by hand first, to see why", ok=False))
    except BrokenEnvironmentError as error:
        found.append(Finding("steps", str(error), "mend the environment: training would end there", ok=False))
    return Check(tuple(found))


def _findings(env: object, env_kwargs: Mapping[str, object]) -> Iterator[Finding]:
    task = find(env, **env_kwargs)
    yield _kind(task)
    yield _actions(task.actions)
    yield _observations(task.observations)
    with opened(task, 1) as (envs, n_copies):
        yield from _played(task, envs, n_copies)


def _played(task: Task, envs: HostEnvironments, n_copies: int) -> Iterator[Finding]:
    seeds, box = np.random.SeedSequence(SEED).generate_state(n_copies), task.actions.box
    yield from _repeated(repeated(envs, seeds, lambda: at_random(box), nothing(box)))
    rest, random = (played(envs, seeds, act(box), N_EPISODES, SECONDS) for act in (nothing, at_random))
    layers = envs.layers[0] if envs.layers else []
    statistics = statistics_of(layers)
    yield from _time(_limit(task, layers), rest, random)
    n_seen = task.observations.size - task.observations.n_mask
    yield _scale(random.observations, n_seen, any(np.ndim(one.mean) for one in statistics.values()))
    yield _rewards(rest.rewards, random.rewards)
    yield Finding("doing nothing", _returns(rest))
    yield Finding("random actions", _returns(random))
    if statistics:
        wrappers = wrappers_at(statistics)
        yield Finding(
            "statistics",
            f"kept by {wrappers}; scales and returns are told here without them",
            "train with normalize_observation=True and normalize_reward=True in their place: those statistics are the "
            "model's, saved and exported with it",
        )
    if layers:
        yield _aliasing(aliases(layers))
    yield _resume(task, envs)
    yield _speed(task, random, n_copies)


def _kind(task: Task) -> Finding:
    if isinstance(task, JaxTask):
        return Finding("environment", f"{task.name}, a record in JAX")
    if isinstance(task, VectorTask):
        return Finding(
            "environment",
            f"{task.name}, which has {task.given} copies and can't be copied itself",
            "evaluate on another: evaluate(env=...) or Evaluate(env=...) takes an id or a function that makes it",
        )
    there = ", which is there already: n_envs is 1" if task.given else ", made anew for each copy"
    alone = isinstance(task, GymnasiumTask) and task.is_alone
    remedy = "give its class, or a function that makes it: a model evaluates on another copy" if alone else ""
    return Finding("environment", f"{task.name}{there}", remedy)


def _actions(actions: Actions) -> Finding:
    box, told = actions.box, []
    if box.numbers:
        bounds = sorted({(box.low[i], box.high[i]) for i in box.numbers})
        spans = ", ".join(f"[{low:g}, {high:g}]" for low, high in bounds[:4]) + (", ..." if len(bounds) > 4 else "")
        told.append(f"{len(box.numbers)} in {spans}; samples are clipped to it, and bins divide it evenly")
    if box.choices:
        sizes = ", ".join(str(box.n_values[i]) for i in box.choices[:8]) + (", ..." if len(box.choices) > 8 else "")
        told.append(f"{_count(len(box.choices), 'choice')} among {sizes}; each has a softmax over its values")
    return Finding("actions", "; ".join(told))


def _observations(observations: Observations) -> Finding:
    kind, size = type(observations.space).__name__, observations.size - observations.n_mask
    masked = f", and with each a mask of {_count(observations.n_mask, 'value')}" if observations.n_mask else ""
    shape = f" of shape {observations.space.shape}" if isinstance(observations.space, Box) else ""
    remedy = IMAGE_REMEDY if observations.has_image else ""
    return Finding("observations", f"{kind}{shape}, seen as a vector of {_count(size, 'number')}{masked}", remedy)


def _repeated(found: Repeated) -> Iterator[Finding]:
    if found.same_start and found.same_steps:
        yield Finding("seeds", "the same seed gives the same episode")
        matter = "change what happens" if found.actions_matter else "change neither observations nor rewards"
        remedy = "" if found.actions_matter else "look whether step uses its action: there may be nothing to learn"
        yield Finding("effect of actions", f"they {matter} in the first {_count(found.n_steps, 'step')}", remedy)
    else:
        what = "first observation" if not found.same_start else "episode from the same first observation"
        remedy = "draw all that is random from self.np_random, after super().reset(seed=seed)"
        yield Finding("seeds", f"the same seed gives another {what}, so no run can be repeated", remedy)


def _limit(task: Task, layers: list[object]) -> int | None:
    limits = [layer._max_episode_steps for layer in layers if isinstance(layer, TimeLimit)]
    return min(limits) if limits else getattr(getattr(task, "record", task), "max_episode_steps", None)


def _time(limit: int | None, *plays: Played) -> Iterator[Finding]:
    lengths, n_steps = [length for play in plays for length in play.lengths], sum(play.n_steps for play in plays)
    n_terminated = sum(play.n_terminated for play in plays)
    yield Finding(
        "time limit",
        "none was found" if limit is None else _count(limit, "step"),
        ""
        if limit is not None or lengths
        else "wrap it into gymnasium.wrappers.TimeLimit, or give max_episode_steps in env_kwargs with an id: an "
        "evaluation plays whole episodes, and training may never see a return",
    )
    if not lengths:
        yield Finding("ends of episodes", f"none in {_count(n_steps, 'step')}")
        return
    span = ("" if min(lengths) == max(lengths) else f"{min(lengths):,} to ") + _count(max(lengths), "step")
    looks_cut = len(lengths) > 3 and n_terminated == len(lengths) and min(lengths) == max(lengths) > 1
    yield Finding(
        "ends of episodes",
        f"{n_terminated} terminated and {len(lengths) - n_terminated} truncated, after {span}",
        "all terminated after as many steps; if that is a time limit, return it as truncated, for a state that a limit "
        "cuts off keeps its value"
        if looks_cut
        else "",
    )


def _scale(found: Spread, n_seen: int, is_normalised: bool) -> Finding:
    mean, deviation = found.mean[:n_seen], found.deviation[:n_seen]
    moving = deviation[deviation > 0]
    still = f"; {len(mean) - len(moving)} of {len(mean)} never moved" if len(moving) < len(mean) else ""
    value = f"means {_range(mean)}, deviations {_range(deviation)}{still}"
    amiss = abs(mean).max() > LARGE or (len(moving) > 0 and (moving.max() > LARGE or moving.min() < SMALL))
    remedy = "train with normalize_observation=True, or scale them in the environment to about -1 to 1"
    return Finding("scale of observations", value, remedy if amiss and not is_normalised else "")


def _rewards(*plays: Spread) -> Finding:
    low, high = min(play.low.min() for play in plays), max(play.high.max() for play in plays)
    typical = max(float((abs(play.mean) + play.deviation).max()) for play in plays)
    n = sum(play.n for play in plays)
    value = f"{low:,.4g} to {high:,.4g} a step"
    if low == high:
        remedy = "none differs, so there is nothing to learn from yet: reward what comes nearer to the goal"
        return Finding("rewards", f"{low:,.4g} in each of {_count(n, 'step')}", remedy)
    amiss = typical > LARGE or typical < SMALL
    return Finding("rewards", value, "train with normalize_reward=True, or scale them to about 1" if amiss else "")


def _returns(play: Played) -> str:
    if not play.returns:
        return f"not known, for no episode ended in {_count(play.n_steps, 'step')}"
    mean, deviation = np.mean(play.returns), np.std(play.returns)
    form = fitting(mean, deviation)
    return f"return {mean:{form}} ± {deviation:{form}} (deviation of {_count(len(play.returns), 'episode')})"


def _aliasing(found: bool) -> Finding:
    told = "each step writes into the array that it returned before" if found else "each step returns a new array"
    remedy = "return a copy: in vector environments the last observation of an episode is lost otherwise"
    return Finding("arrays", told, remedy if found else "")


def _resume(task: Task, envs: HostEnvironments) -> Finding:
    try:
        is_exact = isinstance(task, JaxTask) or envs.get_state() is not None
    except BrokenEnvironmentError as error:
        return Finding("resume", "keeps what was learnt, and begins new episodes", str(error))
    if is_exact:
        return Finding("resume", "exact: episodes go on where they were")
    remedy = "exact where it and its wrappers have get_state and set_state (docs/own_environment.md)"
    return Finding(
        "resume", "keeps what was learnt, and begins new episodes", "" if isinstance(task, VectorTask) else remedy
    )


def _speed(task: Task, play: Played, n_copies: int) -> Finding:
    if isinstance(task, JaxTask):
        return Finding("speed", "that of the compiled program: no step goes through Python")
    rate = n_copies * play.n_steps / max(play.seconds, 1e-9)
    of = "one copy" if n_copies == 1 else f"{n_copies} copies together"
    value = f"{rate:,.0f} steps/s of {of}; a million take {_duration(1e6 / rate)}"
    remedy = "step copies in processes: gymnasium.vector.AsyncVectorEnv with context='spawn'"
    return Finding("speed", value, remedy if rate < SLOW and not isinstance(task, VectorTask) else "")


def _duration(seconds: float) -> str:
    amounts = ((86400, "days"), (3600, "hours"), (60, "minutes"))
    size, name = next(((size, name) for size, name in amounts if seconds >= size), (1, "seconds"))
    return f"{seconds / size:.1f} {name}"


def _count(n: int, what: str) -> str:
    return f"{n:,} {what}" + ("" if n == 1 else "s")


def _range(values: np.ndarray) -> str:
    return f"{values.min():,.3g} to {values.max():,.3g}"
