"""Vector environments that the user made: Gymnasium's and Stable-Baselines3's."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, iterate
from jaxtyping import Float, Integer

from galton.envs.host.action_box import ActionBox
from galton.envs.host.answers import as_float32, as_numbers, shown
from galton.envs.host.base import HostEnvironments, Steps
from galton.envs.host.observations import Observations
from galton.errors import BrokenEnvironmentError, UsageError, require
from galton.foreign import is_instance_of


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
        kind = "single_" if isinstance(source, VectorEnv) else ""
        spaces: list[Any] = [getattr(source, f"{kind}{name}_space", None) for name in ("action", "observation")]
        self.action_space, self.observation_space = spaces
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
        """Refused: `get_state` gives none."""
        del state
        raise UsageError(f"{self._name} can't be put into a state; vector environments don't tell theirs")

    def close(self) -> None:
        """The user made it and closes it."""

    def _call(self, method: str, *arguments: Any, **keywords: Any) -> Any:
        try:
            return getattr(self._envs, method)(*arguments, **keywords)
        except Exception as error:
            told = f"{type(error).__name__}: {error}"
            raise BrokenEnvironmentError(f"{self._where()}: {method} raised {told}") from error

    def _call_for(self, what: str, method: str, *arguments: Any, **keywords: Any) -> Any:
        """The parts of a tuple, named in `what`."""
        answer = self._call(method, *arguments, **keywords)
        if not isinstance(answer, tuple) or len(answer) != len(what.split(", ")):
            raise BrokenEnvironmentError(f"{self._where()}: {method} returned {shown(answer)}; it must return ({what})")
        return answer

    def _where(self, copy: int | None = None) -> str:
        which = "" if copy is None else f", copy {copy}"
        return f"{self._name}{which}, step {self._n_steps}"

    def _rows(self, batch: Any) -> Float[np.ndarray, "M o"]:
        """Observations of all copies, flat and checked."""
        space, n = self._observations.space, self._envs.num_envs
        if isinstance(space, gymnasium.spaces.Box):
            values = as_numbers(batch)
            if values is None or values.shape != (n, *space.shape):
                raise BrokenEnvironmentError(
                    f"{self._where()}: the observations are {shown(batch)}; they must be {(n, *space.shape)}"
                )
            parts = list(values)
        else:
            try:
                parts = list(iterate(batch_space(space, n), batch))
            except Exception as error:
                raise BrokenEnvironmentError(
                    f"{self._where()}: the observations are {shown(batch)}: {error!r}"
                ) from error
            if len(parts) != n:
                raise BrokenEnvironmentError(f"{self._where()}: there are {len(parts)} observations for {n} copies")
        return np.stack([self._row(i, part) for i, part in enumerate(parts)])

    def _row(self, copy: int, raw: Any) -> Float[np.ndarray, " o"]:
        return self._observations.flatten(raw, self._where(copy))

    def _final(self, following: np.ndarray, done: np.ndarray, raw: Callable[[int], Any], key: str) -> np.ndarray:
        """What the step led to: the last observations of the episodes that ended, from under that key of the infos."""
        if not done.any():
            return following
        final = following.copy()
        for i in map(int, np.flatnonzero(done)):
            try:
                last = raw(i)
            except (KeyError, IndexError, TypeError):
                last = None
            if last is None:
                raise BrokenEnvironmentError(f"{self._where(i)}: {key} is missing in info, where an episode ended")
            final[i] = self._row(i, last)
        return final

    def _numbers(self, values: Any, what: str, kind: type) -> Any:
        """One number per copy."""
        array, n = as_numbers(values), self._envs.num_envs
        if array is None or array.shape != (n,) or (kind is bool and array.dtype != bool):
            raise BrokenEnvironmentError(
                f"{self._where()}: {what} is {shown(values)}; it must be {n} of {kind.__name__}"
            )
        if kind is bool:
            return array.copy()
        return np.stack([as_float32(array[i, ...], what, self._where(i)) for i in range(n)])


class GymnasiumVector(_Vector):
    """A gymnasium.vector.VectorEnv in SAME_STEP mode."""

    def reset(self, seeds: Integer[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin episodes."""
        self._n_steps = 0
        return self._rows(self._call_for("observations, infos", "reset", seed=[int(seed) for seed in seeds])[0])

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act; the environment resets itself."""
        self._n_steps += 1
        raw, rewards, terminations, truncations, infos = self._call_for(
            "observations, rewards, terminations, truncations, infos", "step", self._actions.to_env(action)
        )
        following = self._rows(raw)
        terminated = self._numbers(terminations, "terminated", bool)
        truncated = self._numbers(truncations, "truncated", bool)
        final = self._final(following, terminated | truncated, lambda i: infos["final_obs"][i], "final_obs")
        return Steps(following, final, self._numbers(rewards, "the reward", float), terminated, truncated & ~terminated)


class SB3Vector(_Vector):
    """An SB3 VecEnv."""

    def reset(self, seeds: Integer[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin episodes; SB3 numbers the copies' seeds on from the first."""
        self._n_steps = 0
        self._call("seed", int(seeds[0]))
        return self._rows(self._call("reset"))

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act; the environment resets itself."""
        self._n_steps += 1
        raw, rewards, dones, infos = self._call_for(
            "observations, rewards, dones, infos", "step", self._actions.to_env(action)
        )
        following = self._rows(raw)
        done = self._numbers(dones, "dones", bool)
        key = "terminal_observation"
        final = self._final(following, done, lambda i: infos[i][key], key)
        truncated = np.array([ended and bool(infos[i].get("TimeLimit.truncated")) for i, ended in enumerate(done)])
        return Steps(following, final, self._numbers(rewards, "the reward", float), done & ~truncated, truncated)


def is_sb3(env: object) -> bool:
    """Whether it is an SB3 VecEnv, without importing SB3 for the question."""
    return is_instance_of(env, "stable_baselines3", "VecEnv")
