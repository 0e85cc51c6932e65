"""The Beta policy, which lives in the box and needs no clipping (Chou et al., 2017)."""

import dataclasses
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from galton.policies.base import Marginal, Policy, near_edge
from galton.policies.tails import LOG_SQRT_2PI
from galton.types import Params

_TRIES = 5
_SHIFTS = 5
Noise = tuple[Float[Array, "*batch d 2 n"], Float[Array, "*batch d 2 n"]]
"""Proposals: standard normal numbers, and uniform ones that accept or reject them."""


@dataclasses.dataclass(frozen=True)
class Beta:
    """low + (high − low) x with x from Beta(α, β), α and β above 1: one peak inside the box, and nothing beyond it."""

    alpha: Float[Array, "*batch d"]
    beta: Float[Array, "*batch d"]
    low: Float[np.ndarray, " d"]
    high: Float[np.ndarray, " d"]

    def sample(self, noise: Noise) -> Float[Array, "*batch d"]:
        """X / (X + Y) of the box, with X and Y from Gamma(α) and Gamma(β)."""
        up, down = jnp.moveaxis(sample_gamma(jnp.stack([self.alpha, self.beta], -1), *noise), -1, 0)
        share, rest = up / (up + down), down / (up + down)
        size = self.high - self.low
        action = jnp.where(share < rest, self.low + size * share, self.high - size * rest)
        return jnp.clip(action, self.low, self.high)

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l (α_l − 1) log x_l + (β_l − 1) log(1 − x_l) − log B(α_l, β_l) − log(high_l − low_l).

        Nearer to a bound than a millionth of the box, or than float32 can tell, and beyond it an action counts as being
        there: on the bound itself the density is 0.
        """
        size, total = self.high - self.low, self.alpha + self.beta
        least = np.maximum(1e-6, 2 * np.finfo(self.low.dtype).eps * np.maximum(abs(self.low), abs(self.high)) / size)
        x, rest = (jnp.clip(part / size, least, 1 - least) for part in (action - self.low, self.high - action))
        peak = self.alpha * jnp.log(x * total / self.alpha) + self.beta * jnp.log(rest * total / self.beta)
        return (peak - jnp.log(x) - jnp.log(rest) + self._scale() - np.log(size)).sum(-1)

    def entropy(self) -> Float[Array, "*batch"]:
        """Σ_l log B − (α − 1) ψ(α) − (β − 1) ψ(β) + (α + β − 2) ψ(α + β) + log(high − low)."""
        total = self.alpha + self.beta
        excess = digamma_excess(total)
        expected = jnp.zeros_like(total)
        for shape in (self.alpha, self.beta):
            gap = digamma_excess(shape) - excess  # E log x − log E x
            expected += shape * gap - gap - jnp.log(shape / total)
        return (np.log(self.high - self.low) - expected - self._scale()).sum(-1)

    def std(self) -> Float[Array, "*batch d"]:
        """(high − low) √(α β / (α + β + 1)) / (α + β)."""
        total = self.alpha + self.beta
        return (self.high - self.low) * jnp.sqrt(self.alpha / total * (self.beta / total) / (total + 1))

    at_edge = near_edge

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """The mean, α / (α + β) of the box."""
        mean = self.low + (self.high - self.low) * (self.alpha / (self.alpha + self.beta))
        return jnp.clip(mean, self.low, self.high)

    def _scale(self) -> Float[Array, "*batch d"]:
        """½ log(α β / (α + β) / 2π) and Stirling's remainders: what log B leaves when its powers are taken out."""
        total = self.alpha + self.beta
        remainders = stirling_rest(self.alpha) + stirling_rest(self.beta) - stirling_rest(total)
        return 0.5 * jnp.log(self.alpha * (self.beta / total)) - LOG_SQRT_2PI - remainders


def sample_gamma(
    shape: Float[Array, "*batch"], normal: Float[Array, "*batch n"], uniform: Float[Array, "*batch n"]
) -> Float[Array, "*batch"]:
    """Gamma(shape) for shapes of 1 and more, by Marsaglia & Tsang (2000): the first of n proposals that is accepted.

    Each is accepted with probability .95 at least; that none of five is has probability 3e-7, and then the first is
    taken.
    """
    d = (shape - 1 / 3)[..., None]
    v = jnp.maximum(1 + normal / jnp.sqrt(9 * d), 1e-3) ** 3
    accepted = jnp.log(uniform) < 0.5 * normal**2 + d * (1 - v + jnp.log(v))
    return jnp.take_along_axis(d * v, accepted.argmax(-1, keepdims=True), -1)[..., 0]


def stirling_rest(x: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Stirling's remainder, log Γ(x) − (x − ½) log x + x − ½ log 2π for x ≥ 1."""
    rest = jnp.zeros_like(x)
    for _ in range(_SHIFTS):
        rest += (x + 0.5) * jnp.log1p(1 / x) - 1
        x = x + 1
    return rest + 1 / (12 * x) - 1 / (360 * x**3) + 1 / (1260 * x**5)


def digamma_excess(x: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """ψ(x) − log x for x ≥ 1."""
    excess = jnp.zeros_like(x)
    for _ in range(_SHIFTS):
        excess += jnp.log1p(1 / x) - 1 / x
        x = x + 1
    return excess - 1 / (2 * x) - 1 / (12 * x**2) + 1 / (120 * x**4) - 1 / (252 * x**6)


class BetaPolicy(Policy):
    """The network gives two outputs per dimension, and α and β are 1 + softplus of them.

    It starts at α = β = 1 + log 2 with a σ of .48 half-widths of the box.
    """

    label: ClassVar[str] = "Beta"
    noise_marginals: ClassVar[tuple[Marginal, Marginal]] = ("normal", "uniform")

    @property
    def n_outputs(self) -> int:
        """Two per action dimension."""
        return 2 * len(self._box.low)

    def init(self) -> tuple[Float[Array, " n_outputs"], Params]:
        """All outputs begin at 0, and there are no other parameters."""
        return jnp.zeros(self.n_outputs), {}

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> Noise:
        """The proposals for two Gamma numbers per action dimension."""
        keys, size = jax.random.split(key), (*shape, len(self._box.low), 2, _TRIES)
        return jax.random.normal(keys[0], size), jax.random.uniform(keys[1], size)

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Beta:
        """Beta distributions with α and β from the first and second output of each dimension."""
        shapes = 1 + jax.nn.softplus(outputs.reshape(*outputs.shape[:-1], len(self._box.low), 2))
        return Beta(shapes[..., 0], shapes[..., 1], self.low, self.high)
