"""The usual policy: a Gaussian with a learned, state-independent diagonal covariance (§3, §5.1)."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from galton.types import Config, Params


@dataclasses.dataclass(frozen=True)
class Gaussian:
    """N(mean, diag σ²), unbounded: the environment clips what leaves the box [low, high]."""

    mean: Float[Array, "*batch d"]
    log_std: Float[Array, " d"]
    low: Float[np.ndarray, " d"]
    high: Float[np.ndarray, " d"]

    def sample(self, noise: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """Mean + σ · noise, for standard normal noise."""
        return self.mean + jnp.exp(self.log_std) * noise

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l −(a_l − μ_l)² / 2σ_l² − log σ_l − ½ log 2π."""
        z = (action - self.mean) * jnp.exp(-self.log_std)
        return (-0.5 * z**2 - self.log_std - 0.5 * math.log(2 * math.pi)).sum(-1)

    def entropy(self) -> Float[Array, "*batch"]:
        """Σ_l log σ_l + ½ log 2πe."""
        entropy = (self.log_std + 0.5 * math.log(2 * math.pi * math.e)).sum(-1)
        return jnp.broadcast_to(entropy, self.mean.shape[:-1])

    def std(self) -> Float[Array, "*batch d"]:
        """σ."""
        return jnp.broadcast_to(jnp.exp(self.log_std), self.mean.shape)

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """What the environment clips."""
        return (action < self.low) | (action > self.high)

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """The mean, clipped into the box."""
        return jnp.clip(self.mean, self.low, self.high)


@dataclasses.dataclass(frozen=True, eq=False)
class GaussianPolicy:
    """The network gives the mean; log σ, zero at first, is a parameter of its own."""

    low: Float[np.ndarray, " d"]
    high: Float[np.ndarray, " d"]

    @classmethod
    def create(cls, config: Config, low: Float[np.ndarray, " d"], high: Float[np.ndarray, " d"]) -> "GaussianPolicy":
        """The policy for actions in the box [low, high]."""
        del config
        return cls(low, high)

    @property
    def n_outputs(self) -> int:
        """One mean per action dimension."""
        return len(self.low)

    def init(self) -> tuple[Float[Array, " d"], Params]:
        """Mean 0 and σ 1."""
        return jnp.zeros(self.n_outputs), {"log_std": jnp.zeros(self.n_outputs)}

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> Float[Array, "*batch d"]:
        """Standard normal."""
        return jax.random.normal(key, (*shape, self.n_outputs))

    def distribution(self, outputs: Float[Array, "*batch d"], params: Params) -> Gaussian:
        """N(outputs, diag exp(log_std)²)."""
        return Gaussian(outputs, params["log_std"], self.low, self.high)
