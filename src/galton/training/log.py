"""A run is recorded in sums while it trains, and in a log at each log point."""

import collections
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from galton.algorithms import Scalars

MEAN_ACTION_RETURN = "mean_action_return"
"""The column of `train`'s log for evaluation by the mean of the policy's distribution, where it is asked for."""


class Finished(NamedTuple):
    """After each step of a rollout: which episodes ended with it, and what they are up to there."""

    done: Bool[Array, "T N"]
    undiscounted_return: Float[Array, "T N"]
    """Reward collected in the episode so far, which is all of it where done."""
    length: Int[Array, "T N"]
    """Steps of the episode so far, which is all of it where done."""


class Tally(NamedTuple):
    """Sums over the updates and episodes since the last log point."""

    n_updates: Float[Array, ""]
    n_episodes: Float[Array, ""]
    undiscounted_return: Float[Array, ""]
    length: Float[Array, ""]
    diagnostics: Scalars
    """The scalars that the updates reported, summed over them, by name."""


class Log(NamedTuple):
    """The numbers of each log point; NaN once the run has diverged. With axes `[R, L]` in a Result."""

    training_return: Float[Array, "*batch"]
    """Mean undiscounted return of the episodes that ended since the last log point; NaN where none did."""
    episode_length: Float[Array, "*batch"]
    """Mean length, in steps, of the episodes that ended since the last log point."""
    n_episodes: Float[Array, "*batch"]
    """The number of episodes that ended since the last log point."""
    evaluation_return: Float[Array, "*batch"]
    """Mean undiscounted return of the deterministic policy; NaN where evaluation is off."""
    scalars: Mapping[str, Float[Array, "*batch"]]
    """The algorithm's scalars of its updates since the last log point, means by name, and a diagnosis of the last
    rollout."""

    def having(self, name: str, values: Float[np.ndarray, "*batch"]) -> "Log":
        """The same log with other values, or further ones, of that name."""
        known: Any = values
        if name in self._fields:
            return self._replace(**{name: known})
        return self._replace(scalars=collections.OrderedDict(self.scalars) | {name: known})

    def columns(self) -> dict[str, Float[Array | np.ndarray, "*batch"]]:
        """All that is recorded, by name: the four numbers of every log, then the algorithm's scalars."""
        return {name: getattr(self, name) for name in self._fields if name != "scalars"} | dict(self.scalars)


def nothing(names: tuple[str, ...]) -> Tally:
    """An empty tally of updates that tell these scalars."""
    zero = jnp.float32(0)
    return Tally(zero, zero, zero, zero, dict.fromkeys(names, zero))


def tally(finished: Finished, told: Scalars) -> Tally:
    """The tally of one update, from the episodes of its rollout and the scalars it told."""
    return Tally(
        jnp.float32(1),
        finished.done.sum(dtype=jnp.float32),
        jnp.where(finished.done, finished.undiscounted_return, 0.0).sum(dtype=jnp.float32),
        jnp.where(finished.done, finished.length, 0).sum().astype(jnp.float32),
        {name: jnp.asarray(value, jnp.float32) for name, value in told.items()},  # of JAX's x64 mode too
    )


def summarise(sums: Tally, names: tuple[str, ...], diagnosis: Scalars) -> Log:
    """The log that a tally makes; the scalars in the order of the names, those of the diagnosis behind them."""

    def per_episode(total: Array) -> Array:
        return jnp.where(sums.n_episodes > 0, total / sums.n_episodes, jnp.nan)

    means = {name: sums.diagnostics[name] / sums.n_updates for name in names}
    return Log(
        training_return=per_episode(sums.undiscounted_return),
        episode_length=per_episode(sums.length),
        n_episodes=sums.n_episodes,
        evaluation_return=jnp.array(jnp.nan),
        scalars=collections.OrderedDict(means | diagnosis),  # JAX sorts the keys of a plain dict
    )
