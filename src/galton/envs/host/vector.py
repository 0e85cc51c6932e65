"""Vector environments that the user made, Gymnasium's and Stable-Baselines3's, every answer checked."""

import dataclasses
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space, iterate
from jaxtyping import Bool, Float, Integer

from galton.envs.host import masks
from galton.envs.host.actions import Actions
from galton.envs.host.answers import as_float32, as_numbers, blame, parts, shown
from galton.envs.host.base import Steps
from galton.envs.host.layers import copies_in, layers_of_copies
from galton.envs.host.moves import moves_of
from galton.envs.host.observations import Observations
from galton.errors import AliasedObservation, BrokenEnvironmentError, UsageError, require

_MANY = 5
"""So many episodes must have ended alike before it is no coincidence."""


class VectorTask:
    """A gymnasium.vector.VectorEnv in SAME_STEP mode or an SB3 VecEnv as it is: its copies are all that there are.

    Raises:
        UsageError: another autoreset mode, or spaces that Galton can't use.
    """

    n_threads = 1

    def __init__(self, source: Any) -> None:
        self.source = source
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
        self.actions = Actions(self.name, spaces[0])
        self.observations = Observations(self.name, spaces[1])
        self.has_masks = _has_method(source)
        """True if its copies have a method `action_masks`."""
        first = VectorEnvs(self).first_mask() if self.actions.box.choices or self.has_masks else None
        if first is not None:
            n_mask = masks.n_entries(self.name, first, self.actions.box)
            self.actions = dataclasses.replace(self.actions, n_mask=n_mask)
            self.observations = dataclasses.replace(self.observations, n_mask=n_mask)

    def make(self, n_copies: int, n_threads: int = 1) -> "VectorEnvs":
        """The vector environment itself, which has as many copies as it has."""
        require(
            n_copies == self.given,
            f"{n_copies} copies are wanted of {self.name}, which has {self.given}, and it can't be copied; set n_envs "
            "to that, and evaluate on an environment of its own: evaluate(env=...) or Evaluate(env=...) takes an id or "
            "a function that makes it",
        )
        return VectorEnvs(self)


class VectorEnvs:
    """The M copies of a vector environment, spoken to as its library wants."""

    def __init__(self, task: VectorTask) -> None:
        self._name, self._envs = task.name, task.source
        self._actions, self._observations, self._has_method = task.actions, task.observations, task.has_masks
        of_gymnasium = isinstance(self._envs, VectorEnv)
        self._reset, self._step = (reset_gymnasium, step_gymnasium) if of_gymnasium else (reset_sb3, step_sb3)
        # Nobody else can hold those in other processes.
        self.moves = moves_of([self._envs, *copies_in(self._envs.unwrapped)])
        self._n_steps = 0
        self._observation = np.zeros((0, 0), np.float32)
        self._n_alike = 0
        """The number of episodes that ended with the first observation of the next, as long as all did; −1 once one did
        not, or after the warning."""

    @property
    def reset_infos(self) -> Any:
        """The infos of an SB3 VecEnv's last resets, which the wrappers around it have empty."""
        return getattr(self._envs.unwrapped, "reset_infos", [{}] * self._envs.num_envs)

    @property
    def takes_seeds(self) -> bool:
        """True for Gymnasium's own, which take a seed for each copy; the reset of any other takes one for all."""
        return isinstance(self._envs.unwrapped, SyncVectorEnv | AsyncVectorEnv)

    @property
    def layers(self) -> list[list[Any]]:
        """For each copy the wrappers around all of them, and its own where it lives in this process."""
        return layers_of_copies(self._envs)

    def reset(self, seeds: Integer[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin an episode in every copy."""
        self._n_steps = 0
        raw, infos = self._reset(self, [int(seed) for seed in seeds])
        self._observation = self._with_masks(self.rows(raw), infos)
        return self._observation

    def first_mask(self) -> object:
        """The mask of the first copy after a reset, or None."""
        _, infos = self._reset(self, list(range(self._envs.num_envs)))
        return self._masks(infos)[0]

    def _masks(self, infos: Any) -> Any:
        """The masks of all copies in their present states; None for one that tells none."""
        if self._has_method:
            vector = isinstance(self._envs, VectorEnv)
            ask = self._envs.unwrapped.call if vector else self._envs.env_method
            with blame(f"{self._where()}: {masks.METHOD}"):
                return ask(masks.METHOD)
        if isinstance(infos, dict):
            return infos.get(masks.KEY, [None] * self._envs.num_envs)
        return [info.get(masks.KEY) for info in infos]

    def _with_masks(self, rows: Float[np.ndarray, "M n"], infos: Any = None) -> Float[np.ndarray, "M o"]:
        """The observations, and behind each its mask where the environment tells masks; else all is allowed."""
        if not self._actions.n_mask:
            return rows
        told = np.ones((len(rows), self._actions.n_mask)) if infos is None else self._masks(infos)
        own = [masks.checked(one, self._actions.box, self._where(i)) for i, one in enumerate(told)]
        return np.concatenate([rows, np.stack(own).astype(rows.dtype)], -1)

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act; the environment resets itself."""
        self._n_steps += 1
        steps, infos = self._step(self, self._actions.to_env(action))
        following, final = self._with_masks(steps.observation, infos), self._with_masks(steps.final_observation)
        steps = steps._replace(observation=following, final_observation=final)
        self._look_for_aliases(steps)
        self._observation = steps.observation
        return steps

    def get_state(self) -> None:
        """None, since vector environments don't tell their states."""

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Always a UsageError, since `get_state` tells none."""
        raise UsageError(f"{self._name} can't be put into a state; vector environments don't tell theirs")

    def close(self) -> None:
        """Nothing: the user made the environment and closes it."""

    def call(self, method: str, *arguments: object, **keywords: object) -> Any:
        """The answer of a method of the vector environment."""
        with blame(f"{self._where()}: {method}"):
            return getattr(self._envs, method)(*arguments, **keywords)

    def call_for(self, names: str, method: str, *arguments: object, **keywords: object) -> tuple[Any, ...]:
        """The parts of the tuple that a method must return."""
        return parts(self.call(method, *arguments, **keywords), names, method, self._where())

    def rows(self, batch: object) -> Float[np.ndarray, "M o"]:
        """The observations of all copies, flat and checked."""
        space, n = self._observations.space, self._envs.num_envs
        if isinstance(space, Box):
            values = as_numbers(batch)
            if values is None or values.shape != (n, *space.shape):
                raise BrokenEnvironmentError(
                    f"{self._where()}: the observations are {shown(batch)}; they must be {(n, *space.shape)}"
                )
            copies = list(values)
        else:
            try:
                copies = list(iterate(batch_space(space, n), batch))
            except Exception as error:
                raise BrokenEnvironmentError(
                    f"{self._where()}: the observations are {shown(batch)}: {error!r}"
                ) from error
            if len(copies) != n:
                raise BrokenEnvironmentError(f"{self._where()}: there are {len(copies)} observations for {n} copies")
        return np.stack([self._observations.flatten(raw, self._where(i)) for i, raw in enumerate(copies)])

    def last_rows(
        self,
        following: Float[np.ndarray, "M o"],
        ended: Bool[np.ndarray, " M"],
        last: Callable[[int], object],
        key: str,
    ) -> Float[np.ndarray, "M o"]:
        """The observations after the step: `last(i)`, under that key of the infos, where copy i's episode ended."""
        if not ended.any():
            return following
        final = following.copy()
        for i in map(int, np.flatnonzero(ended)):
            try:
                raw = last(i)
            except (KeyError, IndexError, TypeError):
                raw = None
            if raw is None:
                raise BrokenEnvironmentError(f"{self._where(i)}: {key} is missing in info, where an episode ended")
            final[i] = self._observations.flatten(raw, self._where(i))
        return final

    def _look_for_aliases(self, steps: Steps) -> None:
        """Warn where the first episodes all end with the first observation of the next, which was not there before."""
        ended = steps.terminated | steps.truncated
        if self._n_alike < 0 or not ended.any():
            return
        new = ended & (self._observation != steps.observation).any(1)  # what never changes tells nothing
        alike = (steps.final_observation == steps.observation).all(1)
        self._n_alike = -1 if (new & ~alike).any() else self._n_alike + int(new.sum())
        if self._n_alike >= _MANY:
            self._n_alike = -1
            warnings.warn(
                f"{self._name}: each of the first episodes ended with the very observation that the next began with. "
                "If the environment returns one and the same array, its reset overwrites what the episode led to, and "
                "training takes the value of a wrong state: return a copy (observation.copy()), or give Galton a "
                "function that makes one environment, with n_envs",
                AliasedObservation,
                stacklevel=2,
            )

    def numbers(self, values: object, what: str) -> Float[np.ndarray, " M"]:
        """One finite number for each copy."""
        array = self._array(values, what, "float")
        return np.stack([as_float32(array[i, ...], what, self._where(i)) for i in range(len(array))])

    def flags(self, values: object, what: str) -> Bool[np.ndarray, " M"]:
        """True or False for each copy, which may come as the integers 1 and 0."""
        return self._array(values, what, "bool").astype(bool)

    def _array(self, values: object, what: str, kind: str) -> np.ndarray:
        array, n = as_numbers(values), self._envs.num_envs
        if array is None or array.shape != (n,) or (kind == "bool" and not _are_flags(array)):
            raise BrokenEnvironmentError(f"{self._where()}: {what} is {shown(values)}; it must be {n} of {kind}")
        return array

    def _where(self, copy: int | None = None) -> str:
        which = "" if copy is None else f", copy {copy}"
        return f"{self._name}{which}, step {self._n_steps}"


def _has_method(source: Any) -> bool:
    """Say whether the copies of a vector environment have a method `action_masks`."""
    if isinstance(source, VectorEnv):
        copies: Any = source.unwrapped
        return all(copies.call("has_wrapper_attr", masks.METHOD)) if hasattr(copies, "call") else False
    return bool(source.has_attr(masks.METHOD))


def reset_gymnasium(envs: VectorEnvs, seeds: list[int]) -> tuple[object, Any]:
    """Begin episodes in a gymnasium.vector.VectorEnv: what it observes, and its infos."""
    seed = seeds if envs.takes_seeds else seeds[0]
    observations, infos = envs.call_for("observations, infos", "reset", seed=seed)
    return observations, infos


def step_gymnasium(envs: VectorEnvs, action: Any) -> tuple[Steps, Any]:
    """Step a gymnasium.vector.VectorEnv in SAME_STEP mode; its infos are those of the states that follow."""
    raw, rewards, terminations, truncations, infos = envs.call_for(
        "observations, rewards, terminations, truncations, infos", "step", action
    )
    following = envs.rows(raw)
    terminated = envs.flags(terminations, "terminated")
    truncated = envs.flags(truncations, "truncated")
    key, listed = "final_obs", isinstance(infos, list)  # as DictInfoToList makes it
    final = envs.last_rows(following, terminated | truncated, lambda i: infos[i][key] if listed else infos[key][i], key)
    steps = Steps(following, final, envs.numbers(rewards, "the reward"), terminated, truncated & ~terminated)
    return steps, infos


def reset_sb3(envs: VectorEnvs, seeds: list[int]) -> tuple[object, Any]:
    """Begin episodes in an SB3 VecEnv, which numbers the copies' seeds on from the first."""
    envs.call("seed", seeds[0])
    return envs.call("reset"), envs.reset_infos


def step_sb3(envs: VectorEnvs, action: Any) -> tuple[Steps, Any]:
    """Step an SB3 VecEnv, whose infos tell time limits from terminations."""
    raw, rewards, dones, infos = envs.call_for("observations, rewards, dones, infos", "step", action)
    following = envs.rows(raw)
    done = envs.flags(dones, "dones")
    key = "terminal_observation"
    final = envs.last_rows(following, done, lambda i: infos[i][key], key)
    truncated = np.array([ended and bool(infos[i].get("TimeLimit.truncated")) for i, ended in enumerate(done)])
    now = [again if ended else info for ended, info, again in zip(done, infos, envs.reset_infos, strict=True)]
    return Steps(following, final, envs.numbers(rewards, "the reward"), done & ~truncated, truncated), now


def _are_flags(array: np.ndarray) -> bool:
    return array.dtype == bool or (array.dtype.kind in "iu" and bool(((array == 0) | (array == 1)).all()))
