"""The linear quadratic regulator (App. C.1), and its solution by the Riccati recursion."""

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from galton.envs.base import box
from galton.errors import require, require_integer

Matrix = tuple[tuple[float, ...], ...] | np.ndarray
"""Rows; an array is turned into them."""


_C, _S = 0.98 * math.cos(0.1), 0.98 * math.sin(0.1)


@dataclasses.dataclass(frozen=True)
class LQR:
    """x' = A x + B u + noise_std · N(0, I), reward −(xᵀQ x + uᵀR u), u in [−1, 1]^m, x₀ ~ U(−1, 1)^n.

    The paper gives no matrices. The defaults are a slightly damped rotation, at which the optimal controller
    never meets the bounds of u, so that its return is the optimum of the bounded task too.
    """

    A: Matrix = ((_C, -_S), (_S, _C))
    """The state-transition matrix, `[n, n]`."""
    B: Matrix = ((0.1, 0.0), (0.0, 0.1))
    """The input matrix, by which the action moves the state, `[n, m]`."""
    Q: Matrix = ((1.0, 0.0), (0.0, 1.0))
    """The matrix of the state's quadratic cost, `[n, n]`."""
    R: Matrix = ((1.0, 0.0), (0.0, 1.0))
    """The matrix of the action's quadratic cost, `[m, m]`."""
    noise_std: float = 0.05
    """The standard deviation of each entry of the noise in a step."""
    max_episode_steps: int = 100
    """The length of every episode."""

    def __post_init__(self) -> None:
        for name in "ABQR":
            matrix = np.asarray(getattr(self, name), np.float64)
            require(matrix.ndim == 2, f"{name} has shape {matrix.shape}; it must be a matrix")
            object.__setattr__(self, name, tuple(map(tuple, matrix.tolist())))
        n, m = np.shape(self.B)
        for name, shape in {"A": (n, n), "Q": (n, n), "R": (m, m)}.items():
            found = np.shape(getattr(self, name))
            require(found == shape, f"{name} has shape {found}; beside B {(n, m)} it must have {shape}")
        for name in "QR":
            matrix = np.array(getattr(self, name))
            require(np.allclose(matrix, matrix.T), f"{name} is {matrix.tolist()}; it must be symmetric")
        require(
            (np.linalg.eigvalsh(self.Q) >= -1e-9 * np.abs(self.Q).max()).all(),
            f"Q is {self.Q}; it must be positive semidefinite",
        )
        require((np.linalg.eigvalsh(self.R) > 0).all(), f"R is {self.R}; it must be positive definite")
        require(0 <= self.noise_std < float("inf"), f"noise_std is {self.noise_std}; it must be 0 or more")
        require_integer("max_episode_steps", self.max_episode_steps, 1)

    @property
    def action_low(self) -> Float[np.ndarray, " m"]:
        """The lower bound, −1 in every dimension."""
        return box(-1.0, len(self.R))

    @property
    def action_high(self) -> Float[np.ndarray, " m"]:
        """The upper bound, 1 in every dimension."""
        return box(1.0, len(self.R))

    @property
    def observation_low(self) -> Float[np.ndarray, " n"]:
        """The state is unbounded: the least float32."""
        return box(float(np.finfo(np.float32).min), len(self.A))

    @property
    def observation_high(self) -> Float[np.ndarray, " n"]:
        """The state is unbounded: the greatest float32."""
        return box(float(np.finfo(np.float32).max), len(self.A))

    def reset(self, key: Key[Array, ""]) -> Float[Array, " n"]:
        """A first state x₀ ~ U(−1, 1)^n."""
        return jax.random.uniform(key, (len(self.A),), minval=-1.0, maxval=1.0)

    def noise(self, key: Key[Array, ""]) -> Float[Array, " n"]:
        """The process noise, normal with standard deviation noise_std."""
        return self.noise_std * jax.random.normal(key, (len(self.A),))

    def step(
        self, state: Float[Array, " n"], action: Float[Array, " m"], noise: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Float[Array, ""], Bool[Array, ""]]:
        """One step; the cost is that of the state before it."""
        A, B, Q, R = (jnp.array(matrix) for matrix in (self.A, self.B, self.Q, self.R))  # noqa: N806
        cost = state @ Q @ state + action @ R @ action
        return A @ state + B @ action + noise, -cost, jnp.array(False)

    def observe(self, state: Float[Array, " n"]) -> Float[Array, " n"]:
        """The agent sees the whole state."""
        return state

    @functools.cached_property  # asking whether this is an Environment asks for it
    def optimal_return(self) -> float:
        """E −Σ_t cost under the optimal controller: exact where it stays inside the box, else an upper bound.

        The cost to go from x at step t is xᵀP_t x + c_t.
        """
        *later, first = (P for _, _, P in riccati(self))
        return -float(np.trace(first) / 3 + sum(self.noise_std**2 * np.trace(P) for P in later))

    @functools.cached_property
    def random_return(self) -> float:
        """E −Σ_t cost under u ~ U(−1, 1)^m, whose variance is 1/3."""
        return self._return_under_noise(1 / 3)

    @property
    def rest_return(self) -> float:
        """E −Σ_t cost under u = 0."""
        return self._return_under_noise(0.0)

    def _return_under_noise(self, variance: float) -> float:
        """E −Σ_t cost where u is noise: uncorrelated with x, so second moments S of x are all it takes."""
        A, B, Q, R = (np.array(matrix) for matrix in (self.A, self.B, self.Q, self.R))  # noqa: N806
        second_moment, total = np.eye(len(A)) / 3, 0.0
        for _ in range(self.max_episode_steps):
            total -= np.trace(Q @ second_moment) + variance * np.trace(R)
            second_moment = A @ second_moment @ A.T + variance * B @ B.T + self.noise_std**2 * np.eye(len(A))
        return float(total)


def riccati(lqr: LQR) -> list[tuple[Float[np.ndarray, "m n"], Float[np.ndarray, "m m"], Float[np.ndarray, "n n"]]]:
    """K, M = R + Bᵀ P' B and P of each step, from the last to the first: Riccati's recursion from P' = 0 after it.

    u* = −K x is the best action, (u − u*)ᵀ M (u − u*) what another costs, and xᵀ P x the cost to go, but for noise.
    """
    A, B, Q, R = (np.array(matrix) for matrix in (lqr.A, lqr.B, lqr.Q, lqr.R))  # noqa: N806
    P, found = np.zeros_like(A), []  # noqa: N806
    for _ in range(lqr.max_episode_steps):
        weight = R + B.T @ P @ B
        gain = np.linalg.solve(weight, B.T @ P @ A)
        P = Q + A.T @ P @ (A - B @ gain)  # noqa: N806
        found.append((gain, weight, P))
    return found
