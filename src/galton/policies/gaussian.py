"""The usual policy: a Gaussian with a learned, state-independent diagonal covariance (§3, §5.1)."""

import dataclasses
import math
from typing import Annotated, Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from galton.fields import Within
from galton.policies.base import Marginal, Policy
from galton.types import Finite, Number, Params

Floor = Annotated[Number, Within(lambda x: x < np.inf, "finite, or -inf for none")]
Units = Annotated[Number | None, Within(lambda x: (x == 0) | (x == 1), "0 or 1")]


def units_of(policy: Policy, box_units: Number | None) -> tuple[Float[Array, " d"] | float, Float[Array, " d"] | float]:
    """Return the origin and scale of the policy's units: 0 and 1, or the box's center and half-width in box units.

    They are plain numbers where no run of the program uses the box's (None).
    """
    if box_units is None:
        return 0.0, 1.0
    low, high, in_box = policy.low, policy.high, jnp.asarray(box_units) > 0
    return jnp.where(in_box, (high + low) / 2, 0.0), jnp.where(in_box, (high - low) / 2, 1.0)


@dataclasses.dataclass(frozen=True)
class Gaussian:
    """N(mean, diag σ²), unbounded: the environment clips what leaves the box [low, high]."""

    mean: Float[Array, "*batch d"]
    log_std: Float[Array, "*states d"]
    """log σ in units of `unit`; without further axes it is the same in every state."""
    low: Float[np.ndarray, " d"]
    high: Float[np.ndarray, " d"]
    unit: Float[Array, " d"] | float = 1.0
    """The unit of σ. It is no part of log_std, so that a box twice as large changes no bit but exponents."""

    @property
    def sigma(self) -> Float[Array, "*states d"]:
        """σ in the environment's units."""
        return jnp.exp(self.log_std) * self.unit

    @property
    def log_sigma(self) -> Float[Array, "*states d"]:
        """The logarithm of σ in the environment's units."""
        return self.log_std + jnp.log(self.unit)

    def in_sigmas(self, distance: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """Return a distance in multiples of σ."""
        return distance / self.unit * jnp.exp(-self.log_std)

    def sample(self, noise: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """The mean plus σ times standard normal noise."""
        return self.mean + self.sigma * noise

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l −(a_l − μ_l)² / 2σ_l² − log σ_l − ½ log 2π."""
        z = self.in_sigmas(action - self.mean)
        return (-0.5 * z**2 - self.log_sigma - 0.5 * math.log(2 * math.pi)).sum(-1)

    def entropy(self) -> Float[Array, "*batch"]:
        """Σ_l log σ_l + ½ log 2πe."""
        entropy = (self.log_sigma + 0.5 * math.log(2 * math.pi * math.e)).sum(-1)
        return jnp.broadcast_to(entropy, self.mean.shape[:-1])

    def kl(self, other: "Gaussian") -> Float[Array, "*batch"]:
        """KL(self ‖ other) = Σ_l log(σ'/σ) + (σ² + (μ − μ')²) / 2σ'² − ½."""
        return self._kl_of_std(other) + 0.5 * (other.in_sigmas(self.mean - other.mean) ** 2).sum(-1)

    def kl_parts(self, other: "Gaussian") -> dict[str, Float[Array, "*batch"]]:
        """KL from the Gaussian with the other's mean alone, and from that with its σ alone (Song et al., 2020)."""
        of_mean = 0.5 * (self.in_sigmas(self.mean - other.mean) ** 2).sum(-1)
        return {"mean": of_mean, "std": jnp.broadcast_to(self._kl_of_std(other), of_mean.shape)}

    def _kl_of_std(self, other: Any) -> Float[Array, "*states"]:
        """The divergence from the Gaussian with this mean and the other's covariance."""
        log_ratio = self.log_std - other.log_std
        return (0.5 * jnp.expm1(2 * log_ratio) - log_ratio).sum(-1)

    def std(self) -> Float[Array, "*batch d"]:
        """σ in each state."""
        return jnp.broadcast_to(self.sigma, self.mean.shape)

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """Return True for entries that the environment clips."""
        return (action < self.low) | (action > self.high)

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """The mean, clipped into the box."""
        return jnp.clip(self.mean, self.low, self.high)


class GaussianHead(Policy):
    """Policies that are built on a Gaussian share this head, before each makes its own distribution of it.

    The network gives the mean; log σ is a parameter of its own, the same in every state, or with state_dependent_std
    another d of the network's outputs, after the means. Mean and σ are in the environment's units, or, where box_units
    is 1, in half-widths of the action box around its center: what the same numbers then mean does not depend on the
    scale of the box.
    """

    noise_marginals: ClassVar[Marginal] = "normal"

    log_std_init: Finite = 0.0
    """The first log σ."""
    log_std_min: Floor = -math.inf
    """A floor under log σ; −inf is none. One that does not depend on the state never leaves it again."""
    box_units: Units = 0.0
    """1: mean and σ are in half-widths of the action box around its center; 0: in the environment's own units."""
    state_dependent_std: bool = False
    """The network gives log σ too, which then depends on the state as the mean does. It starts near log_std_init, and
    has the floor log_std_min and no upper bound."""

    @property
    def n_outputs(self) -> int:
        """One mean per action dimension, and one log σ where it depends on the state."""
        return len(self._box.low) * (1 + self.state_dependent_std)

    def init(self) -> tuple[Float[Array, " n_outputs"], Params]:
        """Mean 0 and σ = exp(log_std_init), in the policy's units."""
        zeros = jnp.zeros(len(self._box.low))
        if self.state_dependent_std:
            return jnp.concatenate([zeros, zeros + self.log_std_init]), {}
        return zeros, {"log_std": zeros + self.log_std_init}

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> Float[Array, "*batch d"]:
        """Numbers of this marginal, one per action dimension."""
        draw = jax.random.normal if self.noise_marginals == "normal" else jax.random.uniform
        return draw(key, (*shape, len(self._box.low)))

    def mean_and_log_std(
        self, outputs: Float[Array, "*batch n_outputs"], params: Params
    ) -> tuple[Float[Array, "*batch d"], Float[Array, "*states d"]]:
        """The outputs that are means, and log σ = max(log_std, log_std_min)."""
        mean, log_std = jnp.split(outputs, 2, -1) if self.state_dependent_std else (outputs, params["log_std"])
        return mean, jnp.maximum(log_std, self.log_std_min)

    def gaussian(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Gaussian:
        """N(c + h · outputs, diag (h σ)²), where the outputs are those of the means.

        c and h are 0 and 1 in the environment's units, the box's center and half-width in the box's.
        """
        outputs, log_std = self.mean_and_log_std(outputs, params)
        shift, scale = units_of(self, self.box_units)
        if isinstance(scale, float):
            return Gaussian(outputs, log_std, self.low, self.high)
        return Gaussian(shift + scale * outputs, log_std, self.low, self.high, scale)


class GaussianPolicy(GaussianHead):
    """A Gaussian, whose actions the environment clips."""

    label: ClassVar[str] = "Gaussian"
    has_kl: ClassVar[bool] = True

    tanh_mean: bool = False
    """The mean is the box's center plus its half-width times tanh of the output, so that it never leaves the box. σ and
    its units stay as they are; the squashed Gaussian has the tanh after the noise."""

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Gaussian:
        """The Gaussian of these outputs, as wide as they or the parameters say."""
        gaussian = self.gaussian(outputs, params)
        if not self.tanh_mean:
            return gaussian
        share = jnp.tanh(self.mean_and_log_std(outputs, params)[0])
        return dataclasses.replace(gaussian, mean=(self.high + self.low) / 2 + (self.high - self.low) / 2 * share)
