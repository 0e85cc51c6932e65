"""Bandits whose best dimensions depend on each other, with what a factored policy can reach of the optimum.

The value of a policy is E r + α H with its entropy H, in nats, and the weight α of an entropy bonus.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Array, Float

from galton.envs.bandit import OneStep
from galton.errors import require


@dataclasses.dataclass(frozen=True)
class XorBandit(OneStep):
    """One state, one step, reward 1 if the two entries' signs differ and else 0, plus ε ~ N(0, noise_std²).

    Actions are in [−1, 1]². Without a bonus a factored policy can be best, with all of its mass in one quarter of the
    box. With one it has to give up either the reward or the other quarter.
    """

    noise_std: float = 0.1
    """The standard deviation of the reward's noise, ε."""

    bound = 1.0
    d = 2
    optimal_return = 1.0
    random_return = 0.5

    def worth(self, action: Float[Array, "*batch 2"]) -> Float[Array, "*batch"]:
        """1 if the signs differ, and else 0."""
        return (action[..., 0] * action[..., 1] < 0).astype(action.dtype)

    def soft_optimum(self, alpha: float, n_bins: int) -> float:
        """The greatest value of all policies over k × k bins, k even: α log Σ exp(r / α)."""
        return alpha * (2 * math.log(n_bins) - math.log(2) + float(np.logaddexp(0, 1 / alpha)))

    def factored_optimum(self, alpha: float, n_bins: int) -> float:
        """The greatest value of policies whose two dimensions are independent, over k × k bins, k even.

        It is (1 + m²) / 2 + 2α (H(p) + log(k / 2)) with the entropy H of a coin, p = (1 + m) / 2, where one entry is
        positive with the probability p and the other with 1 − p. The best m is 0 if α ≥ ½, and else m = tanh(m / 2α).
        """
        m = 1.0
        for _ in range(10_000):
            m = math.tanh(m / (2 * alpha))
        p = np.array([(1 + m) / 2, (1 - m) / 2])
        coin = -float((p * np.log(np.maximum(p, 1e-300))).sum())
        return (1 + m**2) / 2 + 2 * alpha * (coin + math.log(n_bins / 2))


@dataclasses.dataclass(frozen=True)
class RidgeBandit(OneStep):
    """One state, one step, reward −½ (a − c)ᵀ Q (a − c) + ε with ε ~ N(0, noise_std²), actions in [−1, 1]^d.

    Q has the eigenvalue `along` on the diagonal (1, …, 1) and `across` on all that is perpendicular to it. So what is
    best is a narrow ridge, on which entries move together.
    """

    d: int = 2
    """The number of dimensions of an action."""
    along: float = 1.0
    """The eigenvalue of Q along the ridge."""
    across: float = 25.0
    """The eigenvalue of Q across the ridge."""
    center: float = 0.2
    """The entries of c, the best action."""
    noise_std: float = 0.1
    """The standard deviation of the reward's noise, ε."""

    bound = 1.0
    optimal_return = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("along", "across"):
            value = getattr(self, name)
            require(0 < value < float("inf"), f"{name} is {value}; it must be greater than 0")
        require(-1 <= self.center <= 1, f"center is {self.center}; it must lie in [−1, 1]")

    @property
    def curvature(self) -> Float[np.ndarray, "d d"]:
        """The matrix Q of the reward, by the eigenvalues along and across."""
        return self.across * np.eye(self.d) + (self.along - self.across) / self.d

    @property
    def random_return(self) -> float:
        """−½ E (a − c)ᵀ Q (a − c), where the variance of an entry is 1/3."""
        return -0.5 * (float(np.trace(self.curvature)) / 3 + self.along * self.d * self.center**2)

    def worth(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """−½ (a − c)ᵀ Q (a − c)."""
        apart = action - self.center
        return -0.5 * (self.across * (apart**2).sum(-1) + (self.along - self.across) / self.d * apart.sum(-1) ** 2)

    def soft_optimum(self, alpha: float) -> float:
        """The greatest value of all densities, that of N(c, α Q⁻¹), where the box is wide: α log ∫ exp(r / α).

        Over bins the entropy is greater by d times the logarithm of a width, and the value so much more.
        """
        return alpha / 2 * (self.d * math.log(2 * math.pi * alpha) - float(np.linalg.slogdet(self.curvature)[1]))

    def factored_optimum(self, alpha: float) -> float:
        """The greatest value of densities with independent dimensions, that of N(c, α / diag Q)."""
        diagonal = float(np.log(np.diag(self.curvature)).sum())
        return alpha / 2 * (self.d * math.log(2 * math.pi * alpha) - diagonal)
