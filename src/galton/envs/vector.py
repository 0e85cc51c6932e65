"""Vector environments that the user made: Gymnasium's and Stable-Baselines3's."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import iterate
from jaxtyping import Float, Int

from galton.envs.base import HostEnvironments, Steps
from galton.envs.spaces import ActionBox, Observations, as_float32, shown
from galton.errors import BrokenEnvironmentError, require


class VectorTask:
    """A vector environment as it is: its copies are all that there are.

    Args:
        source: a gymnasium.vector.VectorEnv in SAME_STEP mode, or an SB3 VecEnv.

    Raises:
        UsageError: another autoreset mode, or spaces that Galton can't use.
    """

    n_threads = 1

    def __init__(self, source: Any) -> None:
        self._source = source
        self.name = type(source).__name__
        self.given: int = source.num_envs
        if isinstance(source, VectorEnv):
            mode = source.metadata.get("autoreset_mode")
            require(
                mode == AutoresetMode.SAME_STEP,
                f"{self.name}'s autoreset mode is {mode}; Galton needs the last observation of an episode in its last "
                "step: make it with autoreset_mode=gymnasium.vector.AutoresetMode.SAME_STEP (gymnasium.make_vec takes "
                "it in vector_kwargs)",
            )
            self.action_space: Any = source.single_action_space
            self.observation_space: Any = source.single_observation_space
        else:
            self.action_space, self.observation_space = source.action_space, source.observation_space
        self._actions = ActionBox(self.name, self.action_space)
        self._observations = Observations(self.name, self.observation_space)

    def make(self, n_copies: int, n_threads: int = 1) -> HostEnvironments:
        """The environment itself."""
        del n_threads
        require(
            n_copies == self.given,
            f"{n_copies} copies are wanted of {self.name}, which has {self.given}; set n_envs to that, and evaluate on "
            "an environment of its own",
        )
        adapter = GymnasiumVector if isinstance(self._source, VectorEnv) else SB3Vector
        return adapter(self.name, self._source, self._actions, self._observations)


class _Vector:
    """What both kinds share: checks of what came back."""

    def __init__(self, name: str, envs: Any, actions: ActionBox, observations: Observations) -> None:
        self._name, self._envs, self._actions, self._observations = name, envs, actions, observations
        self._n_steps = 0

    def get_state(self) -> None:
        """Vector environments don't tell."""

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Never called, for lack of a state."""
        raise NotImplementedError

    def close(self) -> None:
        """The user made it and closes it."""

    def _call(self, method: str, *arguments: Any, **keywords: Any) -> Any:
        try:
            return getattr(self._envs, method)(*arguments, **keywords)
        except Exception as error:
            told = f"{type(error).__name__}: {error}"
            raise BrokenEnvironmentError(f"{self._name}, step {self._n_steps}: {method} raised {told}") from error

    def _rows(self, batch: Any) -> Float[np.ndarray, "M o"]:
        """Observations of all copies, flat and checked."""
        space, n = self._observations.space, self._envs.num_envs
        where = f"{self._name}, step {self._n_steps}"
        if isinstance(space, gymnasium.spaces.Box):
            values = np.asarray(batch)
            if values.shape != (n, *space.shape) or values.dtype.kind not in "fiub":
                raise BrokenEnvironmentError(
                    f"{where}: the observations are {shown(batch)}; they must be {(n, *space.shape)}"
                )
            return as_float32(values.reshape(n, -1), "the observations", where)
        try:
            parts = list(iterate(gymnasium.vector.utils.batch_space(space, n), batch))
        except Exception as error:
            raise BrokenEnvironmentError(f"{where}: the observations are {shown(batch)}: {error!r}") from error
        return np.stack([self._row(i, part) for i, part in enumerate(parts)])

    def _row(self, copy: int, raw: Any) -> Float[np.ndarray, " o"]:
        return self._observations.flatten(raw, f"{self._name}, copy {copy}, step {self._n_steps}")

    def _numbers(self, values: Any, what: str, kind: type) -> Any:
        """One number per copy."""
        array, n = np.asarray(values), self._envs.num_envs
        where = f"{self._name}, step {self._n_steps}"
        if array.shape != (n,) or array.dtype.kind not in ("b" if kind is bool else "fiub"):
            raise BrokenEnvironmentError(f"{where}: {what} is {shown(values)}; it must be {n} of {kind.__name__}")
        return array.astype(bool) if kind is bool else as_float32(array, what, where)


class GymnasiumVector(_Vector):
    """A gymnasium.vector.VectorEnv in SAME_STEP mode."""

    def reset(self, seeds: Int[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin episodes."""
        self._n_steps = 0
        return self._rows(self._call("reset", seed=[int(seed) for seed in seeds])[0])

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act; the environment resets itself."""
        self._n_steps += 1
        raw, rewards, terminations, truncations, infos = self._call("step", self._actions.to_env(action))
        following = self._rows(raw)
        terminated = self._numbers(terminations, "terminated", bool)
        truncated = self._numbers(truncations, "truncated", bool)
        final = following
        ended = np.flatnonzero(terminated | truncated)
        if len(ended):
            final = following.copy()
            for i in ended:
                if "final_obs" not in infos:
                    raise BrokenEnvironmentError(f"{self._name}, copy {i}, step {self._n_steps}: final_obs is missing")
                final[i] = self._row(int(i), infos["final_obs"][i])
        return Steps(following, final, self._numbers(rewards, "the reward", float), terminated, truncated & ~terminated)


class SB3Vector(_Vector):
    """An SB3 VecEnv."""

    def reset(self, seeds: Int[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin episodes; SB3 numbers the copies' seeds on from the first."""
        self._n_steps = 0
        self._call("seed", int(seeds[0]))
        return self._rows(self._call("reset"))

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act; the environment resets itself."""
        self._n_steps += 1
        raw, rewards, dones, infos = self._call("step", self._actions.to_env(action))
        following = self._rows(raw)
        done = self._numbers(dones, "dones", bool)
        truncated = np.array([bool(info.get("TimeLimit.truncated", False)) for info in infos]) & done
        final = following
        ended = np.flatnonzero(done)
        if len(ended):
            final = following.copy()
            for i in ended:
                if "terminal_observation" not in infos[i]:
                    raise BrokenEnvironmentError(
                        f"{self._name}, copy {i}, step {self._n_steps}: terminal_observation is missing"
                    )
                final[i] = self._row(int(i), infos[i]["terminal_observation"])
        return Steps(following, final, self._numbers(rewards, "the reward", float), done & ~truncated, truncated)


def is_sb3(env: Any) -> bool:
    """Whether it is an SB3 VecEnv, without importing SB3 for the question."""
    return any(cls.__name__ == "VecEnv" and cls.__module__.startswith("stable_baselines3") for cls in type(env).__mro__)
