"""Running statistics of observations and rewards, with the semantics of Stable-Baselines3's VecNormalize.

Observations are counted from an origin, the first that the run sees: beside a large mean float32 has no digits left for
what moves, and the samples that the statistics begin with would be far from all that are seen. So `from_origin` comes
first; outside JAX it is `from_origin_on_host`, which has the observations as they are, in float64.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from galton.types import Learner, Number

CLIP = 10.0
EPSILON = 1e-8
PRIOR = 1e-4
"""The number of samples that the initial mean 0 and variance 1 count for."""
ROUNDING = 1e-7
"""Of a number in float32."""


class Moments(NamedTuple):
    """Mean and variance of all that was seen."""

    mean: Float[Array, "*rest"]
    variance: Float[Array, "*rest"]
    n: Float[Array, ""]
    """The number of samples that they count for, PRIOR included: those seen, or no more than a window."""


class Normalizer(NamedTuple):
    """Normalising needs to know this; an entry is () where it is off."""

    observation: Moments | tuple[()]
    """Moments of the observations beyond the origin, `[o]`."""
    discounted_return: Moments | tuple[()]
    """Moments of each copy's discounted return: rewards are divided by its standard deviation."""
    running_return: Any
    """The discounted return of the episode so far, `[N]`."""
    origin: Any = ()
    """The origin, subtracted from observations first, `[o]`; 0 in files from before it existed."""


def init(observation_size: int, n_envs: int, observations: bool, rewards: bool) -> Normalizer:
    """Mean 0 and variance 1, counted for PRIOR samples, of what is to be normalised."""

    def moments(*shape: int) -> Moments:
        return Moments(jnp.zeros(shape), jnp.ones(shape), jnp.full((), PRIOR))

    return Normalizer(
        moments(observation_size) if observations else (),
        moments() if rewards else (),
        jnp.zeros(n_envs) if rewards else (),
        jnp.zeros(observation_size) if observations else (),
    )


def in_new_episodes(learner: Learner) -> Learner:
    """The learner where every copy begins an episode: what is known stays, and their discounted returns are 0."""
    begun = jax.tree.map(jnp.zeros_like, learner.normalizer.running_return)
    return learner._replace(normalizer=learner.normalizer._replace(running_return=begun))


def update_moments(moments: Moments, batch: Float[Array, "N *rest"], window: Number | None = None) -> Moments:
    """Chan's parallel update with the N samples of one step.

    With a window w they count for w samples at most. From there on a step leaves w / (w + N) of the weight that those
    seen before have.
    """
    n = batch.shape[0]
    total = moments.n + n
    delta = batch.mean(0) - moments.mean
    share = n / total
    counted = total if window is None else jnp.minimum(total, window)
    spread = batch.var(0) + delta**2 * (moments.n / total)
    return Moments(moments.mean + share * delta, moments.variance + share * (spread - moments.variance), counted)


def _apart(normalizer: Normalizer, rows: Any) -> tuple[Any, Any]:
    """The entries that are normalised, and those behind them, which stay as they are: an action mask."""
    n = normalizer.origin.shape[-1]
    return rows[..., :n], rows[..., n:]


def begin(normalizer: Normalizer, raw: Float[Array, "N o"]) -> Normalizer:
    """Count the first observations of a run of N environments, the first of which becomes the origin."""
    if not normalizer.observation:
        return normalizer
    normalizer = normalizer._replace(origin=_apart(normalizer, raw)[0][0])
    return observe(normalizer, from_origin(normalizer, raw))


def from_origin(normalizer: Normalizer, raw: Float[Array, "*batch o"]) -> Float[Array, "*batch o"]:
    """Observations told from the origin; as they are where normalising is off."""
    if not normalizer.observation:
        return raw
    own, mask = _apart(normalizer, raw)
    return jnp.concatenate([own - normalizer.origin, mask], -1) if mask.size else own - normalizer.origin


def from_origin_on_host(normalizer: Normalizer, raw: Float[np.ndarray, "*runs n o"]) -> Float[np.ndarray, "*runs n o"]:
    """The same for n observations of each run, in float32: digits are lost after the origin is taken away."""
    if normalizer.observation:
        own, mask = _apart(normalizer, raw)
        moved = own - np.asarray(normalizer.origin)[..., None, :]
        raw = np.concatenate([moved, mask], -1) if mask.size else moved
    return raw.astype(np.float32, copy=False)


def observe(normalizer: Normalizer, moved: Float[Array, "N o"], window: Number | None = None) -> Normalizer:
    """Count the observations of one step of N environments, told from the origin."""
    if not normalizer.observation:
        return normalizer
    own, _ = _apart(normalizer, moved)
    return normalizer._replace(observation=update_moments(normalizer.observation, own, window))


def observation(normalizer: Normalizer, moved: Float[Array, "*batch o"]) -> Float[Array, "*batch o"]:
    """Standardised and clipped to ±10, told from the origin; as it is where normalising is off."""
    if not normalizer.observation:
        return moved
    own, mask = _apart(normalizer, moved)
    scaled = jnp.clip((own - normalizer.observation.mean) / deviation(normalizer), -CLIP, CLIP)
    return jnp.concatenate([scaled, mask], -1) if mask.size else scaled


def deviation(normalizer: Normalizer) -> Float[Array, " o"]:
    """The divisor of observations: an entry's standard deviation or, while it never moved, its size, at least 1.

    So an entry that was constant in training does not carry a policy away when it first moves in use.
    """
    assert normalizer.observation
    mean, variance, n = normalizer.observation
    size = jnp.abs(normalizer.origin)
    never_moved = (jnp.abs(mean) <= ROUNDING * size) & (variance * n <= 2 * PRIOR)  # all that is left is the prior's 1
    return jnp.where(never_moved, jnp.maximum(size, 1.0), jnp.sqrt(variance + EPSILON))


def reward(
    normalizer: Normalizer,
    raw: Float[Array, " N"],
    done: Bool[Array, " N"],
    gamma: Number,
    window: Number | None = None,
) -> tuple[Normalizer, Float[Array, " N"]]:
    """Count the rewards of one step and divide them by the standard deviation of the discounted return, within ±10."""
    if not normalizer.discounted_return:
        return normalizer, raw
    running = normalizer.running_return * gamma + raw
    moments = update_moments(normalizer.discounted_return, running, window)
    scaled = jnp.clip(raw / jnp.sqrt(moments.variance + EPSILON), -CLIP, CLIP)
    return normalizer._replace(discounted_return=moments, running_return=jnp.where(done, 0.0, running)), scaled


def receive(
    normalizer: Normalizer,
    raw: Float[Array, " N"],
    done: Bool[Array, " N"],
    final: Float[Array, "N o"],
    following: Float[Array, "N o"],
    gamma: Number,
    window: Number | None = None,
) -> tuple[Normalizer, Float[Array, " N"], Float[Array, "N o"]]:
    """Take in one step: its rewards, the observations that end it and those, after any reset, that follow.

    The new statistics, normalised rewards and normalised ends; observations are told from the origin.
    """
    normalizer, scaled = reward(observe(normalizer, following, window), raw, done, gamma, window)
    return normalizer, scaled, observation(normalizer, final)
