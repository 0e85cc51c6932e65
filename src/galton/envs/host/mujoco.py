"""Gymnasium's MuJoCo tasks, many simulations at a time and equal to Gymnasium's to the last bit."""

import functools
from typing import Any

import gymnasium
import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from galton.devices import n_cores
from galton.envs.host.actions import Actions
from galton.envs.host.answers import as_float32, try_to_make
from galton.envs.host.base import Steps
from galton.envs.host.moves import Moves
from galton.envs.host.mujoco_functions import MUJOCO_FUNCTIONS, Constants, Matrix, Rows
from galton.envs.host.observations import Observations
from galton.envs.host.simulation import Batched, Looped, Simulations
from galton.envs.host.state import generator_state, set_generator_state
from galton.errors import BrokenEnvironmentError


class MujocoTask:
    """One of MUJOCO_FUNCTIONS; UsageError for keyword arguments that Gymnasium refuses, or without MuJoCo."""

    given: int | None = None

    def __init__(self, name: str, *, action_scale: float = 1.0, **kwargs: Any) -> None:
        self.name, self.n_threads = name, n_cores()
        self.functions = MUJOCO_FUNCTIONS[name]
        made = try_to_make(name, functools.partial(gymnasium.make, name, **kwargs))
        self.constants: Constants = made.unwrapped
        assert made.spec is not None
        self.max_episode_steps = made.spec.max_episode_steps
        self.actions = Actions(name, made.action_space, action_scale)
        self.observations = Observations(name, made.observation_space)

    def make(self, n_copies: int, n_threads: int = 1) -> "MujocoEnvs":
        """So many simulations, stepped on so many threads."""
        return MujocoEnvs(self, n_copies, n_threads)


class MujocoEnvs:
    """N simulations of one task, stepped together."""

    moves: tuple[Moves, ...] = ()
    layers: tuple[list[Any], ...] = ()

    def __init__(self, task: MujocoTask, n_copies: int, n_threads: int) -> None:
        self._task, self._functions, self._constants = task, task.functions, task.constants
        self._actions = task.actions
        n_threads = min(n_threads, n_copies)
        kind: type[Simulations] = Looped if "cfrc_ext" in self._functions.fields else Batched
        self._simulations = kind(self._constants.model, n_copies, n_threads, self._functions.fields)
        self._elapsed = np.zeros(n_copies, np.int64)
        self._generators: list[np.random.Generator] = []
        self._n_steps = 0

    def reset(self, seeds: Integer[np.ndarray, " N"]) -> Float[np.ndarray, "N o"]:
        """Begin episodes as `reset(seed=seed)` of Gymnasium's environment would."""
        self._generators = [gymnasium.utils.seeding.np_random(int(seed))[0] for seed in seeds]
        self._n_steps = 0
        self._begin(np.arange(len(seeds)))
        return self._checked(self._observe())

    def step(self, action: Float[np.ndarray, "N d"]) -> Steps:
        """Act, and begin new episodes where one ended."""
        final, reward, terminated, truncated = self.simulate(action)
        following = self._checked(final)
        ended = np.flatnonzero(terminated | truncated)
        steps = Steps(following, following, as_float32(reward, "the reward", self._where()), terminated, truncated)
        if len(ended):
            self._begin(ended)
            steps = steps._replace(observation=self._checked(self._observe()))
        return steps

    def simulate(
        self, action: Float[np.ndarray, "N d"]
    ) -> tuple[Matrix, Rows, Bool[np.ndarray, " N"], Bool[np.ndarray, " N"]]:
        """One step in Gymnasium's own precision: observation, reward, terminated, truncated."""
        c, functions, simulations = self._constants, self._functions, self._simulations
        self._n_steps += 1
        clipped = self._actions.to_env(action)
        before = functions.position(c, simulations.fields).copy()
        simulations.step(clipped, c.frame_skip)
        if simulations.was_reset.any():
            copy = int(np.flatnonzero(simulations.was_reset)[0])
            raise BrokenEnvironmentError(
                f"{self._where()}: MuJoCo found copy {copy} unstable (a position, velocity or acceleration that is "
                f"not finite or too large) and reset it; the action was {clipped[copy]}"
            )
        self._elapsed += 1
        f = simulations.fields
        velocity = (functions.position(c, f) - before) / c.dt
        reward = functions.reward(c, f, velocity, clipped)
        terminated = functions.ended(c, f) if functions.ended else np.zeros(len(reward), bool)
        limit = self._task.max_episode_steps
        truncated = (self._elapsed >= limit) if limit else np.zeros(len(reward), bool)
        return self._observe(), reward, terminated, truncated & ~terminated

    def get_state(self) -> dict[str, np.ndarray]:
        """The state that the simulations, their clocks and their generators go on from."""
        state = {f"field/{name}": np.array(value) for name, value in self._simulations.fields.items()}
        return state | {
            "physics": self._simulations.get_state(),
            "elapsed_steps": self._elapsed.copy(),
            "generator": np.stack([generator_state(generator) for generator in self._generators]),
        }

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Put simulations, clocks and generators into what `get_state` told."""
        fields = {name.removeprefix("field/"): value for name, value in state.items() if name.startswith("field/")}
        self._simulations.set_state(state["physics"], fields)
        self._elapsed = np.array(state["elapsed_steps"])
        self._generators = [np.random.default_rng() for _ in self._elapsed]
        for generator, row in zip(self._generators, state["generator"], strict=True):
            set_generator_state(generator, row)

    def close(self) -> None:
        """End the threads that stepped the simulations."""
        self._simulations.close()

    def _begin(self, copies: Int[np.ndarray, " n"]) -> None:
        starts = [self._functions.start(self._constants, self._generators[i]) for i in copies]
        self._simulations.reset(copies, np.stack([q for q, _ in starts]), np.stack([v for _, v in starts]))
        self._elapsed[copies] = 0

    def _observe(self) -> Matrix:
        return self._functions.observe(self._constants, self._simulations.fields)

    def _checked(self, observation: Matrix) -> Float[np.ndarray, "N o"]:
        as_float32(observation, "the observations", self._where())
        return observation.copy()

    def _where(self) -> str:
        return f"{self._task.name}, step {self._n_steps}"
