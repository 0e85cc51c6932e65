"""Tasks that change while an agent learns: what was best is so no longer, and no observation says it.

Their state has a clock, the steps that a copy has taken since it was made. It goes on through the ends of episodes
(`Environment.carried`), is saved with a run, and evaluation begins where training is. Steps tell their regret: what the
best policy of the moment would have expected to get beyond the action taken. The log has its mean, `env_regret`.
"""

import dataclasses
import functools
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key

from galton.envs.bandit import OneState
from galton.envs.base import box
from galton.envs.lqr import LQR, riccati
from galton.errors import require, require_integer, require_word


class Moment(NamedTuple):
    """The state of a changing task."""

    state: Float[Array, " n"]
    """The part that an episode begins anew."""
    t: Int[Array, ""]
    """Steps that this copy has taken, in all its episodes."""
    of_episode: Int[Array, ""]
    """Steps of this episode."""
    optimum: Float[Array, " d"]
    """The best action of a bandit now, () elsewhere."""
    regret: Float[Array, ""]
    """Of the last step, without the noise of its reward."""


class _Changing:
    """The clock that all have in common."""

    period: int

    def carried(self, ended: Moment, fresh: Moment) -> Moment:
        """The next episode begins in a fresh state at the same moment."""
        return fresh._replace(t=ended.t, optimum=ended.optimum)

    def metrics(self, moment: Moment) -> dict[str, Float[Array, ""]]:
        """The regret of the step that led here, and the number of the phase."""
        return {"regret": moment.regret, "phase": moment.t // self.period}


@dataclasses.dataclass(frozen=True)
class DriftingBandit(_Changing, OneState):
    """One state, one step, reward 1 − (4/d) Σ (a_i − a*_i)² + ε with ε ~ N(0, noise_std²), actions in [−1, 1]^d.

    With `still` it is the paper's bandit (§5.2.2) in units of its box, divided by 25 but for its noise. The best action
    a* begins with `size` in every dimension, and all copies of all runs have the same.
    """

    change: Literal["jump", "sine", "walk", "still"] = "jump"
    """a* changes its sign after each period, is size · cos(2π t / period), walks at random and is reflected at ±0.8, or
    stays."""
    period: int = 5_000
    """Steps of a copy from one jump to the next, or of one wave; a walk is size away, in the root mean square, after as
    many."""
    size: float = 0.5
    """The distance of a* from the center of the box at the start, in half-widths."""
    d: int = 2
    """The number of dimensions of an action."""
    noise_std: float = 0.2
    """The standard deviation of the reward's noise, ε."""
    seed: int = 0
    """It decides where a* walks."""

    bound = 1.0
    optimal_return = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_word("change", self.change, ("jump", "sine", "walk", "still"))
        require_integer("period", self.period, 1)
        require_integer("seed", self.seed, 0)
        require(0 < self.size <= FARTHEST, f"size is {self.size}; it must be greater than 0, and {FARTHEST} or less")

    @property
    def random_return(self) -> float | None:
        """E 1 − 4 (a − a*)² with a* where it begins, as long as it stays there or changes its sign."""
        return 1 - 4 * (1 / 3 + self.size**2) if self.change in ("jump", "still") else None

    def reset(self, key: Key[Array, ""]) -> Moment:
        """The one state that there is, before any change."""
        zero = jnp.int32(0)
        return Moment(jnp.ones(1), zero, zero, jnp.full(self.d, self.size), jnp.zeros(()))

    def step(
        self, state: Moment, action: Float[Array, " d"], noise: Float[Array, ""] | float
    ) -> tuple[Moment, Float[Array, ""], Bool[Array, ""]]:
        """Reward the action, end, and move the optimum."""
        regret = 4 * jnp.mean((action - state.optimum) ** 2)
        t = state.t + 1
        moved = state._replace(t=t, optimum=self._optimum(t, state.optimum), regret=regret)
        return moved, 1.0 - regret + noise, jnp.array(True)

    def observe(self, state: Moment) -> Float[Array, " 1"]:
        """The observation, which is the constant 1."""
        return state.state

    def _optimum(self, t: Int[Array, ""], before: Float[Array, " d"]) -> Float[Array, " d"]:
        if self.change == "walk":
            key = jax.random.fold_in(jax.random.key(self.seed), t)
            moved = before + self.size / np.sqrt(self.period) * jax.random.normal(key, (self.d,))
            return reflected(moved, FARTHEST)
        phase = t // self.period
        if self.change == "sine":
            where = jnp.cos(2 * np.pi * (t % self.period) / self.period)
        else:
            where = jnp.where((phase % 2 == 1) & (self.change == "jump"), -1.0, 1.0)
        return jnp.full(self.d, self.size) * where


FARTHEST = 0.8
"""The distance of the best action from the center of the box is at most this, in half-widths."""


def reflected(x: Float[Array, "*batch"], bound: float) -> Float[Array, "*batch"]:
    """The place between walls at ±bound of a path that would have come to x without them."""
    return bound * (1 - jnp.abs((x / bound + 1) % 4 - 2))


@dataclasses.dataclass(frozen=True)
class SwitchingLQR(_Changing):
    """The LQR (`galton.envs.LQR`) and, in every second period, another one; the state stays what it is.

    Its two regulators are `phases`. Regret is that of an action u in an episode with h steps to go, of which the rest
    is optimal in the same phase: (u − u*)ᵀ (R + Bᵀ P B) (u − u*) with Riccati's P of h − 1 steps. Summed over an
    episode in one phase it is the optimal cost's distance from the policy's, in expectation.
    """

    change: Literal["reversal", "rotation", "radius", "cost"] = "reversal"
    """B → −B, B turned by 90° (of two inputs), the spectral radius of A .98 → 1.02, or R → R / 10."""
    period: int = 100_000
    """Steps of a copy from one change to the next."""
    noise_std: float = 0.05
    """The standard deviation of each entry of the noise in a step."""
    max_episode_steps: int = 100
    """The length of every episode."""

    action_low, action_high = box(-1.0, 2), box(1.0, 2)
    observation_low, observation_high = LQR().observation_low, LQR().observation_high

    def __post_init__(self) -> None:
        require_word("change", self.change, ("reversal", "rotation", "radius", "cost"))
        require_integer("period", self.period, 1)
        _ = self.phases

    @functools.cached_property
    def phases(self) -> tuple[LQR, LQR]:
        """The regulators before and after a change."""
        first = LQR(noise_std=self.noise_std, max_episode_steps=self.max_episode_steps)
        A, B, R = (np.array(matrix) for matrix in (first.A, first.B, first.R))  # noqa: N806
        other = {
            "reversal": {"B": -B},
            "rotation": {"B": np.array([[0.0, -1.0], [1.0, 0.0]]) @ B},
            "radius": {"A": A * (1.02 / 0.98)},
            "cost": {"R": R / 10},
        }
        return first, dataclasses.replace(first, **other[self.change])

    @functools.cached_property
    def _solved(self) -> tuple[np.ndarray, ...]:
        """A, B, Q, R, the optimal gains and the weights of regret, each with both phases first."""
        matrices = [np.array([getattr(lqr, name) for lqr in self.phases]) for name in "ABQR"]
        steps = [riccati(lqr)[::-1] for lqr in self.phases]
        return *matrices, *(np.array([[step[i] for step in phase] for phase in steps]) for i in (0, 1))

    @property
    def optimal_return(self) -> float:
        """The better of the phases' optimal returns."""
        return max(lqr.optimal_return for lqr in self.phases)

    @property
    def random_return(self) -> float:
        """The expected return of random actions in the first phase."""
        return self.phases[0].random_return

    def reset(self, key: Key[Array, ""]) -> Moment:
        """A first state x₀ ~ U(−1, 1)², in the first phase."""
        zero = jnp.int32(0)
        return Moment(self.phases[0].reset(key), zero, zero, jnp.zeros(0), jnp.zeros(()))

    def noise(self, key: Key[Array, ""]) -> Float[Array, " n"]:
        """The process noise, normal with standard deviation noise_std."""
        return self.phases[0].noise(key)

    def step(
        self, state: Moment, action: Float[Array, " m"], noise: Float[Array, " n"]
    ) -> tuple[Moment, Float[Array, ""], Bool[Array, ""]]:
        """One step of the phase's regulator."""
        x, phase = state.state, state.t // self.period % 2
        A, B, Q, R, gain, weight = (jnp.asarray(both, jnp.float32)[phase] for both in self._solved)  # noqa: N806
        cost = x @ Q @ x + action @ R @ action
        off = action + gain[state.of_episode] @ x
        following = Moment(
            A @ x + B @ action + noise,
            state.t + 1,
            state.of_episode + 1,
            state.optimum,
            off @ weight[state.of_episode] @ off,
        )
        return following, -cost, jnp.array(False)

    def observe(self, state: Moment) -> Float[Array, " n"]:
        """The agent sees the regulator's state, and not the phase."""
        return state.state
