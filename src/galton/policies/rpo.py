"""Robust policy optimisation (Rahman & Xue, 2022): a Gaussian whose mean an update sees moved at random."""

import dataclasses
from typing import ClassVar

import jax
import numpy as np
from jaxtyping import Array, Float, Key

from galton.policies.base import Family, Marginal
from galton.policies.gaussian import Gaussian, GaussianPolicy
from galton.types import Config, Hypers, Params


@dataclasses.dataclass(frozen=True, eq=False)
class RpoPolicy:
    """The Gaussian policy, but that each look of an update adds U(−α, α) to every mean, with α = rpo_alpha.

    The draws are new for each action, dimension, minibatch and epoch. They are in the mean's own units: the
    environment's, or half-widths of the box. Acting, evaluation and the log see the mean as it is.
    """

    gaussian: GaussianPolicy

    family: ClassVar[Family] = "density"
    label: ClassVar[str] = "RPO"

    @classmethod
    def create(cls, config: Config, low: Float[np.ndarray, " d"], high: Float[np.ndarray, " d"]) -> "RpoPolicy":
        """The policy for actions in the box [low, high]; the configuration has no part in it."""
        return cls(GaussianPolicy.create(config, low, high))

    @property
    def n_outputs(self) -> int:
        """One mean per action dimension."""
        return self.gaussian.n_outputs

    def init(self, hypers: Hypers) -> tuple[Float[Array, " d"], Params]:
        """As the Gaussian policy starts."""
        return self.gaussian.init(hypers)

    @property
    def noise_marginals(self) -> Marginal:
        """How the noise is distributed: as the Gaussian policy's, standard normal."""
        return self.gaussian.noise_marginals

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> Float[Array, "*batch d"]:
        """Standard normal numbers, one per action dimension."""
        return self.gaussian.noise(key, shape)

    def distribution(self, outputs: Float[Array, "*batch d"], params: Params, hypers: Hypers) -> Gaussian:
        """The Gaussian policy's distribution."""
        return self.gaussian.distribution(outputs, params, hypers)

    def moved(self, outputs: Float[Array, "*batch d"], key: Key[Array, ""], hypers: Hypers) -> Float[Array, "*batch d"]:
        """The means plus a draw from U(−α, α) for each."""
        return outputs + hypers.rpo_alpha * jax.random.uniform(key, outputs.shape, outputs.dtype, -1.0, 1.0)
