"""Vector environments that the user made: Gymnasium's and Stable-Baselines3's."""

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from galton.envs.host.action_box import ActionBox
from galton.envs.host.base import Steps
from galton.envs.host.observations import Observations
from galton.envs.host.vector_envs import VectorEnvs
from galton.errors import require
from galton.foreign import is_instance_of


def is_sb3(env: object) -> bool:
    """Whether it is an SB3 VecEnv, without importing SB3 for the question."""
    return is_instance_of(env, "stable_baselines3", "VecEnv")


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
        self.actions, self.observations = ActionBox(self.name, spaces[0]), Observations(self.name, spaces[1])

    def make(self, n_copies: int, n_threads: int = 1) -> VectorEnvs:
        """The vector environment itself, which has as many copies as it has."""
        del n_threads
        require(
            n_copies == self.given,
            f"{n_copies} copies are wanted of {self.name}, which has {self.given}, and it can't be copied; set n_envs "
            "to that, and evaluate on an environment of its own: evaluate(env=...) or Evaluate(env=...) takes an id or "
            "a function that makes it",
        )
        of_gymnasium = isinstance(self.source, VectorEnv)
        reset, step = (reset_gymnasium, step_gymnasium) if of_gymnasium else (reset_sb3, step_sb3)
        return VectorEnvs(self.name, self.source, self.actions, self.observations, reset, step)


def reset_gymnasium(envs: VectorEnvs, seeds: list[int]) -> object:
    """Begin episodes in a gymnasium.vector.VectorEnv."""
    return envs.call_for("observations, infos", "reset", seed=seeds)[0]


def step_gymnasium(envs: VectorEnvs, action: np.ndarray) -> Steps:
    """Step a gymnasium.vector.VectorEnv in SAME_STEP mode."""
    raw, rewards, terminations, truncations, infos = envs.call_for(
        "observations, rewards, terminations, truncations, infos", "step", action
    )
    following = envs.rows(raw)
    terminated = envs.flags(terminations, "terminated")
    truncated = envs.flags(truncations, "truncated")
    key, listed = "final_obs", isinstance(infos, list)  # as DictInfoToList makes it
    final = envs.last_rows(following, terminated | truncated, lambda i: infos[i][key] if listed else infos[key][i], key)
    return Steps(following, final, envs.numbers(rewards, "the reward"), terminated, truncated & ~terminated)


def reset_sb3(envs: VectorEnvs, seeds: list[int]) -> object:
    """Begin episodes in an SB3 VecEnv, which numbers the copies' seeds on from the first."""
    envs.call("seed", seeds[0])
    return envs.call("reset")


def step_sb3(envs: VectorEnvs, action: np.ndarray) -> Steps:
    """Step an SB3 VecEnv, whose infos tell time limits from terminations."""
    raw, rewards, dones, infos = envs.call_for("observations, rewards, dones, infos", "step", action)
    following = envs.rows(raw)
    done = envs.flags(dones, "dones")
    key = "terminal_observation"
    final = envs.last_rows(following, done, lambda i: infos[i][key], key)
    truncated = np.array([ended and bool(infos[i].get("TimeLimit.truncated")) for i, ended in enumerate(done)])
    return Steps(following, final, envs.numbers(rewards, "the reward"), done & ~truncated, truncated)
