"""Our own environments, in pure JAX, behind Gymnasium's interface."""

import gymnasium
import jax
import numpy as np
from gymnasium.spaces import Box
from jaxtyping import PyTree

from galton.envs.registry import make


class GymnasiumEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """One of ENVS for gymnasium.make; keyword arguments are the record's constants.

    Actions are in [−1, 1]^d, as Gymnasium recommends, and scaled to the task's box; what lies outside is clipped.
    Only the bandit's box, [−10, 10]^d, differs from it.
    """

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, task: str, render_mode: str | None = None, **constants: object) -> None:
        self.render_mode = render_mode
        self.record = make(task, **constants)
        self.observation_space = Box(self.record.observation_low, self.record.observation_high)
        self.action_space = Box(-1.0, 1.0, self.record.action_low.shape)
        self._state: PyTree = None
        self._reset, self._observe = jax.jit(self.record.reset), jax.jit(self.record.observe)

        def step(state: PyTree, action: jax.Array, key: jax.Array) -> tuple[PyTree, jax.Array, jax.Array]:
            low, high = self.record.action_low, self.record.action_high
            scaled = low + (jax.numpy.clip(action, -1, 1) + 1) / 2 * (high - low)
            return self.record.step(state, scaled, self.record.noise(key))

        self._step = jax.jit(step)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[np.ndarray, dict[str, object]]:
        """A first observation; the record knows no options. What outlasts episodes begins anew with a seed alone."""
        super().reset(seed=seed, options=options)
        fresh, carried = self._reset(self._key()), getattr(self.record, "carried", None)
        goes_on = carried is not None and seed is None and self._state is not None
        self._state = self.record.carried(self._state, fresh) if goes_on else fresh  # type: ignore[attr-defined]
        return np.array(self._observe(self._state)), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, object]]:
        """One step; the time limit is Gymnasium's TimeLimit wrapper's."""
        self._state, reward, terminated = self._step(self._state, action, self._key())
        return np.array(self._observe(self._state)), float(reward), bool(terminated), False, {}

    def _key(self) -> jax.Array:
        return jax.random.key(int(self.np_random.integers(2**31)))
