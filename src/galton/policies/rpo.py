"""Robust policy optimisation (Rahman & Xue, 2022): a Gaussian whose mean an update sees moved at random."""

from typing import ClassVar

import jax
from jaxtyping import Array, Float, Key

from galton.policies.gaussian import Gaussian, GaussianHead
from galton.types import NotNegative, Params


class RpoPolicy(GaussianHead):
    """The Gaussian policy, but that each look of an update adds U(−α, α) to every mean, with α = rpo_alpha.

    The draws are new for each action, dimension, minibatch and epoch. They are in the mean's own units: the
    environment's, or half-widths of the box. Acting, evaluation and the log see the mean as it is.
    """

    label: ClassVar[str] = "RPO"

    rpo_alpha: NotNegative = 0.5
    """The most that an update moves the mean up or down, in the mean's own units."""

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Gaussian:
        """The Gaussian policy's distribution."""
        return self.gaussian(outputs, params)

    def moved(self, outputs: Float[Array, "*batch d"], key: Key[Array, ""]) -> Float[Array, "*batch d"]:
        """The means plus a draw from U(−α, α) for each; outputs that are log σ stay."""
        moves = self.rpo_alpha * jax.random.uniform(key, outputs.shape, outputs.dtype, -1.0, 1.0)
        return outputs + (moves.at[..., len(self._box.low) :].set(0.0) if self.state_dependent_std else moves)
