"""The Gaussian as the environment sees it: clipped, with its tails on the bounds of the box (Fujita & Maeda, 2018)."""

import dataclasses
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from galton.policies.gaussian import Gaussian, GaussianHead
from galton.policies.tails import LEAST, LOG_SQRT_2PI, Inside, inside, log_tail
from galton.types import Params

_NOTHING = -80.0
"""log p below which p log p is 0 in float32."""


@dataclasses.dataclass(frozen=True)
class ClippedGaussian:
    """N(mean, diag σ²) clipped into its box: a density inside, and the mass of a tail on each bound.

    Mass and density are put on one scale by the half-width h of the box: a bound of mass p counts as p / h. In units
    of the box, where h is 1, that is the clipped-action policy gradient as it was published; in others everything is
    less by the same constant log h, so that neither gradients nor entropies depend on the units of the actions.
    """

    gaussian: Gaussian
    """The Gaussian whose actions the box clips."""

    def sample(self, noise: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """The mean plus σ times standard normal noise, clipped into the box."""
        return jnp.clip(self.gaussian.sample(noise), self.gaussian.low, self.gaussian.high)

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l log φ((a − μ) / σ) / σ inside the box, log Φ((low − μ) / σ) / h on its lower bound, and so above.

        An action beyond a bound counts as the bound.
        """
        gaussian = self.gaussian
        mean, low, high = gaussian.mean, gaussian.low, gaussian.high
        below, above = action <= low, action >= high
        behind = jnp.where(below, mean - low, jnp.where(above, high - mean, 0.0))
        tail = log_tail(behind / gaussian.sigma) - jnp.log(0.5 * (high - low))
        z = gaussian.in_sigmas(jnp.where(below | above, 0.0, action - mean))
        density = -0.5 * z**2 - gaussian.log_sigma - LOG_SQRT_2PI
        return jnp.where(below | above, tail, density).sum(-1)

    def entropy(self) -> Float[Array, "*batch"]:
        """−E log π(a), in closed form: −Σ p log(p / h) over the two bounds, less ∫ π log π between them."""
        gaussian, part, density = self._parts()
        half = jnp.log(0.5 * (gaussian.high - gaussian.low))
        entropy = jnp.zeros_like(gaussian.mean)
        for log_mass in self._log_masses():
            entropy -= jnp.exp(log_mass) * (log_mass - half)
        for piece in (part.below, part.above):
            squares = part.zeta**2 * piece.mass + 2 * part.zeta * piece.first + piece.second
            entropy += density * ((gaussian.log_sigma + LOG_SQRT_2PI) * piece.mass + 0.5 * squares)
        return entropy.sum(-1)

    def std(self) -> Float[Array, "*batch d"]:
        """The standard deviation of the clipped action."""
        gaussian, part, density = self._parts()
        ends = gaussian.low - part.edge, gaussian.high - part.edge
        std, masses = gaussian.sigma, [jnp.exp(log_mass) for log_mass in self._log_masses()]
        first = density * std * (part.above.first - part.below.first)
        second = density * std**2 * (part.above.second + part.below.second)
        for mass, end in zip(masses, ends, strict=True):
            first, second = first + mass * end, second + mass * end**2
        return jnp.sqrt(jnp.maximum(second - first**2, LEAST))

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """Return True for entries on a bound, or beyond."""
        return (action <= self.gaussian.low) | (action >= self.gaussian.high)

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """The median, which is the Gaussian's mean clipped into the box: the same as the Gaussian policy's."""
        return self.gaussian.deterministic_action()

    def _parts(self) -> tuple[Gaussian, Inside, Float[Array, "*batch d"]]:
        """The Gaussian, what of it lies inside, and the density at the point that is nearest to the mean, times σ."""
        gaussian = self.gaussian
        part = inside(gaussian.mean, gaussian.sigma, gaussian.low, gaussian.high)
        return gaussian, part, jnp.exp(-0.5 * part.zeta**2 - LOG_SQRT_2PI)

    def _log_masses(self) -> tuple[Float[Array, "*batch d"], Float[Array, "*batch d"]]:
        """The log-masses of the lower and the upper bound, not below what is 0 in float32."""
        gaussian, std = self.gaussian, self.gaussian.sigma
        low, high = (log_tail(x / std) for x in (gaussian.mean - gaussian.low, -(gaussian.mean - gaussian.high)))
        return jnp.maximum(low, _NOTHING), jnp.maximum(high, _NOTHING)


class ClippedGaussianPolicy(GaussianHead):
    """A Gaussian that is trained on the actions that reach the environment: on a bound only the tail's mass counts.

    Its gradient has the Gaussian's mean and less variance. Mean, σ and their units are the Gaussian policy's.
    """

    label: ClassVar[str] = "clipped Gaussian"

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> ClippedGaussian:
        """The Gaussian of these outputs, clipped into the box."""
        return ClippedGaussian(self.gaussian(outputs, params))
