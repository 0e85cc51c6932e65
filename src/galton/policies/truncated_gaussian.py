"""A Gaussian cut off at the box and rescaled, so that every action is inside and none is on a bound."""

import dataclasses
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from galton.policies.base import Marginal, near_edge
from galton.policies.gaussian import Gaussian, GaussianHead
from galton.policies.tails import LEAST, Inside, inside, quantile
from galton.types import Params


@dataclasses.dataclass(frozen=True)
class TruncatedGaussian:
    """N(mean, diag σ²) given that the action is inside the box [low, high]."""

    gaussian: Gaussian
    """The Gaussian to truncate. If its mean lies outside, the density is largest at that bound and falls from there."""

    def sample(self, noise: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """The action below which the share `noise` of the probability lies: inverse-CDF sampling."""
        gaussian, std, part = self._parts()
        total = part.below.mass + part.above.mass
        is_above = noise * total >= part.below.mass
        share = jnp.where(
            is_above,
            (noise * total - part.below.mass) / jnp.maximum(part.above.mass, 1e-30),
            1 - noise * total / jnp.maximum(part.below.mass, 1e-30),
        )
        room = jnp.where(is_above, gaussian.high - part.edge, part.edge - gaussian.low) / std
        distance = std * quantile(part.zeta, room, jnp.clip(share, 0.0, 1.0))
        return jnp.clip(part.edge + jnp.where(is_above, distance, -distance), gaussian.low, gaussian.high)

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l log φ((a_l − μ_l) / σ_l) / σ_l less the log of the Gaussian's mass in the box.

        Seen from the point of the box that is nearest to the mean, so that no large numbers cancel. An action beyond a
        bound counts as the bound.
        """
        gaussian, std, part = self._parts()
        t = jnp.abs(jnp.clip(action, gaussian.low, gaussian.high) - part.edge) / std
        return (-part.zeta * t - 0.5 * t**2 - gaussian.log_sigma - part.log_mass).sum(-1)

    def entropy(self) -> Float[Array, "*batch"]:
        """−E log π(a), whose closed form is computed by quadrature (see `galton.policies.tails`)."""
        gaussian, _, part = self._parts()
        first, second = part.below.first + part.above.first, part.below.second + part.above.second
        share = (part.zeta * first + 0.5 * second) / (part.below.mass + part.above.mass)
        return (share + gaussian.log_sigma + part.log_mass).sum(-1)

    def std(self) -> Float[Array, "*batch d"]:
        """The standard deviation of what is left, which is less than σ."""
        _, std, part = self._parts()
        mass = part.below.mass + part.above.mass
        mean = (part.above.first - part.below.first) / mass
        square = (part.above.second + part.below.second) / mass
        return std * jnp.sqrt(jnp.maximum(square - mean**2, LEAST))

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """Return True for entries in the first or last hundredth of the box."""
        return near_edge(self.gaussian, action)

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """The mode: the Gaussian's mean, or the bound that is nearest to it."""
        return self.gaussian.deterministic_action()

    def _parts(self) -> tuple[Gaussian, Float[Array, "*states d"], Inside]:
        gaussian, std = self.gaussian, self.gaussian.sigma
        return gaussian, std, inside(gaussian.mean, std, gaussian.low, gaussian.high)


class TruncatedGaussianPolicy(GaussianHead):
    """A Gaussian given that the action is inside the box. Mean, σ and their units are the Gaussian policy's."""

    label: ClassVar[str] = "truncated Gaussian"
    noise_marginals: ClassVar[Marginal] = "uniform"  # for the inverse of the distribution function

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> TruncatedGaussian:
        """The Gaussian, cut off."""
        return TruncatedGaussian(self.gaussian(outputs, params))
