"""What one run is between two updates, apart from its environments, and how an update changes it.

Unbatched: the populations of `scan` and `host` map these functions over runs.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, UInt

from galton.algorithms import a2c
from galton.algorithms.a2c import Diagnostics
from galton.algorithms.diagnostics import diagnose
from galton.policies import Policy
from galton.types import Config, Hypers, Learner, Transition


class Finished(NamedTuple):
    """The episodes that ended in a rollout."""

    done: Bool[Array, "T N"]
    undiscounted_return: Float[Array, "T N"]
    """Of the episode so far; whole where done."""
    length: Int[Array, "T N"]
    """Steps of the episode so far; whole where done."""


class Tally(NamedTuple):
    """Sums since the last log point."""

    n_updates: Float[Array, ""]
    n_episodes: Float[Array, ""]
    undiscounted_return: Float[Array, ""]
    length: Float[Array, ""]
    diagnostics: Diagnostics


class RunState(NamedTuple):
    """One run."""

    learner: Learner
    key: Key[Array, ""]
    """Of everything random in training; the step, folded in, gives each rollout its own."""
    evaluation_key: Key[Array, ""]
    """Of the evaluations, so that they never touch training."""
    step: Int[Array, ""]
    """Environment steps so far."""
    diverged_at: Int[Array, ""]
    """The step of the first update whose gradient was not finite, −1 while there is none. From there on nothing
    is learnt: the parameters stay what they were before it."""
    tally: Tally


class Log(NamedTuple):
    """What is recorded at each log point; NaN once the run has diverged. With axes `[R, L]` in a Result."""

    training_return: Float[Array, "*batch"]
    """Mean undiscounted return of the episodes that ended since the last log point; NaN where none did."""
    episode_length: Float[Array, "*batch"]
    """Their mean length."""
    n_episodes: Float[Array, "*batch"]
    """How many those were."""
    evaluation_return: Float[Array, "*batch"]
    """Mean undiscounted return of the deterministic policy; NaN where evaluation is off."""
    entropy: Float[Array, "*batch"]
    """This and the next three: means over the updates since the last log point."""
    grad_norm: Float[Array, "*batch"]
    policy_loss: Float[Array, "*batch"]
    value_loss: Float[Array, "*batch"]
    actor_grad_norm: Float[Array, "*batch"]
    """This and the rest: a Diagnosis of the last rollout."""
    grad_bound: Float[Array, "*batch"]
    sigma: Float[Array, "*batch"]
    edge_share: Float[Array, "*batch"]
    explained_variance: Float[Array, "*batch"]
    hl_gauss_bias: Float[Array, "*batch"]


def nothing() -> Tally:
    """An empty tally."""
    zero = jnp.float32(0)
    return Tally(zero, zero, zero, zero, Diagnostics(*[zero] * len(Diagnostics._fields)))


def begin(config: Config, policy: Policy, observation_size: int, seed: UInt[Array, ""]) -> tuple[RunState, Array]:
    """A new run, and the key of its first episodes. Not under vmap (see `init_mlp`)."""
    init_key, episodes_key, key, evaluation_key = jax.random.split(jax.random.key(seed), 4)
    learner = a2c.init(init_key, config, policy, observation_size)
    return RunState(learner, key, evaluation_key, jnp.int32(0), jnp.int32(-1), nothing()), episodes_key


def rollout_key(state: RunState, ahead: Int[Array, ""] | int = 0) -> Key[Array, ""]:
    """Of the rollout that begins `ahead` steps from here: the same however training is cut into calls."""
    return jax.random.fold_in(state.key, state.step + ahead)


def learn(
    config: Config, policy: Policy, state: RunState, batch: Transition, finished: Finished, hypers: Hypers
) -> RunState:
    """One update on a rollout `[T, N]`, and the books."""
    frozen = state.diverged_at >= 0
    hypers = hypers._replace(learning_rate=jnp.where(frozen, 0.0, hypers.learning_rate))
    learner, diagnostics = a2c.update(config, policy, state.learner, batch, hypers)
    step = state.step + config.n_steps * config.n_envs
    tally = Tally(
        jnp.float32(1),
        finished.done.sum(dtype=jnp.float32),
        jnp.where(finished.done, finished.undiscounted_return, 0.0).sum(),
        jnp.where(finished.done, finished.length, 0).sum().astype(jnp.float32),
        diagnostics,
    )
    return state._replace(
        learner=learner,
        step=step,
        diverged_at=jnp.where(frozen | jnp.isfinite(diagnostics.grad_norm), state.diverged_at, step),
        tally=jax.tree.map(jnp.add, state.tally, tally),
    )


def read_log(
    config: Config, policy: Policy, state: RunState, batch: Transition, hypers: Hypers
) -> tuple[RunState, Log]:
    """The log of the updates since the last one, the last of them on this batch; evaluation is the caller's."""
    tally = state.tally

    def per_episode(total: Array) -> Array:
        return jnp.where(tally.n_episodes > 0, total / tally.n_episodes, jnp.nan)

    mean = jax.tree.map(lambda total: total / tally.n_updates, tally.diagnostics)
    log = Log(
        training_return=per_episode(tally.undiscounted_return),
        episode_length=per_episode(tally.length),
        n_episodes=tally.n_episodes,
        evaluation_return=jnp.array(jnp.nan),
        **mean._asdict(),
        **diagnose(config, policy, state.learner, batch, hypers)._asdict(),
    )
    log = jax.tree.map(lambda x: jnp.where(state.diverged_at < 0, x, jnp.nan), log)
    return state._replace(tally=nothing()), log
