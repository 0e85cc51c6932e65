"""The state of one run between two updates, apart from its environments, and the update that changes it.

Unbatched: the populations, on the device and on the host, map these functions over runs. The training loop is theirs
too, and it is: act for n_steps steps (a rollout), then `learn` from them, again and again.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key, PyTree, UInt

from galton import schedules
from galton.algorithms import Agent, Scalars, actor_critic
from galton.errors import require
from galton.normalization import Normalizer
from galton.parts import at
from galton.training.diagnosis import diagnose
from galton.training.log import Finished, Log, Tally, nothing, summarise, tally
from galton.types import Learner, Transition

_OF_UPDATES = 2**31 - 1
"""Folded into a rollout's key it gives the update's, which nothing else in the rollout has."""


Counts = Array | np.ndarray
Tree = TypeVar("Tree")
"""A pytree of arrays, JAX's or numpy's."""
Snapshot = dict[str, Any]
"""The pytrees `run` and `environments`, from which a population goes on exactly."""


class RunState(NamedTuple):
    """One run between two updates: what it has learnt, where it is, and what it has to log."""

    learner: Learner
    key: Key[Array, ""]
    """The key of everything random in training; with the step folded in, each rollout has its own."""
    evaluation_key: Key[Array, ""]
    """The key of the evaluations, which are drawn apart so that they never touch training."""
    updates: Int[Array, ""]
    """The number of updates. Environment steps, a rollout's size as many, may be more than 32 bits hold."""
    diverged_at: Int[Array, ""]
    """The number of updates with the first one whose gradient was not finite, −1 while there is none. From there on
    nothing is learnt: the parameters stay what they were before it."""
    tally: Tally


class StoredRun(NamedTuple):
    """A run, or several, as a file holds it: numpy arrays, whose counts are in environment steps."""

    learner: Learner
    key: UInt[Counts, "*runs 2"]
    evaluation_key: UInt[Counts, "*runs 2"]
    step: Int[np.ndarray, "*runs"]
    diverged_at: Int[np.ndarray, "*runs"]
    tally: Tally


def keys_of(seed: UInt[Array, ""]) -> Key[Array, "4"]:
    """The keys of a run's parameters, of its first episodes, of training and of evaluations."""
    return jax.random.split(jax.random.key(seed), 4)


def begin(
    agent: Agent, observation_size: int, seed: UInt[Array, ""], metrics: Sequence[str] = ()
) -> tuple[RunState, Array]:
    """A new run, and the key of its first episodes. Not under vmap (see `networks.last_layer`).

    The names are those of the numbers that its environment tells of itself.
    """
    init_key, episodes_key, key, evaluation_key = keys_of(seed)
    learner = actor_critic.init(init_key, at(agent, 0.0), observation_size)
    empty = nothing((*agent.scalars, *metrics))
    return RunState(learner, key, evaluation_key, jnp.int32(0), jnp.int32(-1), empty), episodes_key


def step_of(agent: Agent, updates: Int[Array, "*runs"]) -> Float[Array, "*runs"]:
    """The environment steps of so many updates, as schedules take them."""
    return updates.astype(jnp.float32) * agent.rollout.size


def key_at(agent: Agent, key: Key[Array, ""], updates: Int[Array, ""]) -> Key[Array, ""]:
    """The key of what begins after so many updates: their environment steps, of which 32 bits count, are folded in."""
    return jax.random.fold_in(key, jnp.asarray(updates).astype(jnp.uint32) * np.uint32(agent.rollout.size))


def rollout_key(agent: Agent, run: RunState, ahead: Int[Array, ""] | int = 0) -> Key[Array, ""]:
    """The key of the rollout that begins `ahead` updates from here: the same however training is cut into calls."""
    return key_at(agent, run.key, run.updates + ahead)


def learn(
    agent: Agent,
    run: RunState,
    normalizer: Normalizer,
    batch: Transition,
    finished: Finished,
    metrics: Scalars | None = None,
) -> RunState:
    """The run after one update on a rollout `[T, N]`, with its step, its tally and a first divergence noted.

    The normaliser is that after the rollout. What the environment tells of itself, the means over the rollout, joins
    the scalars of the update.
    """
    frozen = run.diverged_at >= 0
    updates = run.updates + 1
    key = jax.random.fold_in(rollout_key(agent, run), _OF_UPDATES)
    step = step_of(agent, updates)
    now = at(agent, step)
    now = now.replace(
        policy=at(agent.policy, step_of(agent, run.updates)),  # the one that sampled the batch
        **{name: getattr(now, name).at(step, frozen) for name in ("algorithm", "entropy", "optimizer")},
    )
    learner, told = now.algorithm.update(now, run.learner._replace(normalizer=normalizer), batch, key)
    wanted = f"whose update tells {', '.join(sorted(told))}; its scalars are {', '.join(sorted(agent.scalars))}"
    require(told.keys() == {*agent.scalars}, f"algorithm is {now.algorithm.name!r}, {wanted}")
    finite = jnp.isfinite(told["grad_norm"])
    before, after = ((of.memory["algorithm"], of.normalizer) for of in (run.learner, learner))
    kept, normalizer = jax.tree.map(lambda old, new: jnp.where(frozen | ~finite, old, new), before, after)
    return run._replace(
        learner=learner.remembering(algorithm=kept)._replace(normalizer=normalizer),
        updates=updates,
        diverged_at=jnp.where(frozen | finite, run.diverged_at, updates),
        tally=jax.tree.map(jnp.add, run.tally, tally(finished, told | (metrics or {}))),
    )


def read_log(agent: Agent, run: RunState, batch: Transition) -> tuple[RunState, Log]:
    """The log of the updates since the last one, the last of them on this batch; evaluation is the caller's."""
    names = (*agent.scalars, *(name for name in run.tally.diagnostics if name not in agent.scalars))
    log = summarise(run.tally, names, diagnose(at(agent, step_of(agent, run.updates)), run.learner, batch))
    log = jax.tree.map(lambda x: jnp.where(run.diverged_at < 0, x, jnp.nan), log)
    return run._replace(tally=nothing(names)), log


def over_all(agent: Agent, begin: int, end: float) -> Agent:
    """The agent whose numbers that change over all that is trained change from one step to another."""
    spread = schedules.over(agent, begin, end)
    return spread.replace(optimizer=spread.optimizer.falling(begin, end, agent.rollout.size))


def over_runs(side_by_side: bool, f: Callable[..., Tree], in_axes: Sequence[int | None]) -> Callable[..., Tree]:
    """A function of one run as one of many: side by side, or one after the other. Runs share arguments of axis None."""
    if side_by_side or jax.default_backend() != "cpu":
        return jax.vmap(f, tuple(in_axes))

    def one_after_the_other(*arguments: PyTree[Array]) -> Tree:
        given = list(zip(arguments, in_axes, strict=True))

        def one(own: list[PyTree[Array]]) -> Tree:
            rest = iter(own)
            return f(*(argument if axis is None else next(rest) for argument, axis in given))

        return jax.lax.map(one, [argument for argument, axis in given if axis == 0])

    return one_after_the_other


def reseeded(run: RunState, seeds: UInt[np.ndarray, " R"]) -> RunState:
    """Runs `[R]` with other keys of training and evaluation; what they have learnt stays."""
    keys = jax.vmap(keys_of)(jnp.asarray(seeds))
    return run._replace(key=keys[:, 2], evaluation_key=keys[:, 3])


def stored(agent: Agent, run: RunState) -> StoredRun:
    """The run as a file holds it, with its keys as plain numbers, which can be fetched from a device."""
    key, evaluation_key = map(jax.random.key_data, (run.key, run.evaluation_key))
    step, diverged_at = (in_steps(agent, updates) for updates in (run.updates, run.diverged_at))
    return StoredRun(run.learner, key, evaluation_key, step, diverged_at, run.tally)


def restored(agent: Agent, run: StoredRun) -> RunState:
    """The run that a file holds, with its keys as JAX has them and its steps counted in updates."""
    key, evaluation_key = (jax.random.wrap_key_data(jnp.asarray(k)) for k in (run.key, run.evaluation_key))
    updates, diverged_at = (jnp.asarray(at // agent.rollout.size, jnp.int32) for at in (run.step, run.diverged_at))
    return RunState(run.learner, key, evaluation_key, updates, diverged_at, run.tally)


def in_steps(agent: Agent, updates: Int[Counts, "*runs"]) -> Int[np.ndarray, "*runs"]:
    """The environment steps of so many updates on the host, −1 for −1."""
    counts = np.asarray(updates, np.int64)
    return np.where(counts < 0, -1, counts * agent.rollout.size)
