"""Gymnasium's MuJoCo tasks, many simulations at a time and equal to Gymnasium's to the last bit.

A task is a record in MUJOCO_TASKS: what it reads from the simulation, and four functions that say over N simulations
what Gymnasium's class says over one. Constants come from an instance of that class, so every keyword argument of
`gymnasium.make` works.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from galton.devices import n_cores
from galton.envs.base import Steps
from galton.envs.gym import generator_state, set_generator_state
from galton.envs.simulation import Batched, Fields, Looped, Simulations
from galton.envs.spaces import ActionBox, Observations, as_float32
from galton.errors import BrokenEnvironmentError, UsageError

Rows = Float[np.ndarray, " N"]
Matrix = Float[np.ndarray, "N n"]


class MujocoTask(NamedTuple):
    """What N simulations see and earn. `c` is Gymnasium's environment, for its constants."""

    fields: tuple[str, ...]
    """The fields of MjData that the functions read."""
    observe: Callable[[Any, Fields], Matrix]
    """(c, fields) → observations."""
    position: Callable[[Any, Fields], Rows]
    """(c, fields) → where the robot is, for its velocity."""
    reward: Callable[[Any, Fields, Rows, Matrix], Rows]
    """(c, fields, velocity, action) → rewards."""
    healthy: Callable[[Any, Fields], Bool[np.ndarray, " N"]] | None
    """(c, fields) → which episodes go on; None if they all do."""
    start: Callable[[Any, np.random.Generator], tuple[np.ndarray, np.ndarray]]
    """(c, generator) → qpos and qvel at the start of an episode."""


def control_cost(c: Any, action: Matrix) -> Rows:
    """W Σ a², in the action's precision, as Gymnasium."""
    cost: np.ndarray = c._ctrl_cost_weight * np.square(action).sum(1)
    return cost


def x_position(c: Any, f: Fields) -> Rows:
    """Of the root."""
    del c
    x: np.ndarray = f.qpos[:, 0]
    return x


def uniform_and_normal(c: Any, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positions uniformly around the pose of the model, velocities normal."""
    scale = c._reset_noise_scale
    qpos = c.init_qpos + generator.uniform(-scale, scale, c.model.nq)
    return qpos, c.init_qvel + scale * generator.standard_normal(c.model.nv)


def uniform(c: Any, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities uniformly around the pose of the model."""
    scale = c._reset_noise_scale
    qpos = c.init_qpos + generator.uniform(-scale, scale, c.model.nq)
    return qpos, c.init_qvel + generator.uniform(-scale, scale, c.model.nv)


def root_excluded(c: Any, f: Fields, root: int) -> Float[np.ndarray, "N q"]:
    """Positions, by default without where the root stands."""
    qpos: np.ndarray = f.qpos[:, root * c._exclude_current_positions_from_observation :]
    return qpos


def cheetah_observe(c: Any, f: Fields) -> Matrix:
    """Positions and velocities."""
    return np.concatenate([root_excluded(c, f, 1), f.qvel], axis=1)


def cheetah_reward(c: Any, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Speed less effort."""
    del f
    reward: np.ndarray = c._forward_reward_weight * velocity - control_cost(c, action)
    return reward


def walker_observe(c: Any, f: Fields) -> Matrix:
    """Positions and clipped velocities."""
    return np.concatenate([root_excluded(c, f, 1), np.clip(f.qvel, -10, 10)], axis=1)


def walker_reward(c: Any, f: Fields, velocity: Rows, action: Matrix, healthy: Any) -> Rows:
    """Speed and survival less effort."""
    reward: np.ndarray = c._forward_reward_weight * velocity + healthy(c, f) * c._healthy_reward
    reward = reward - control_cost(c, action)
    return reward


def inside(value: np.ndarray, bounds: tuple[float, float]) -> Bool[np.ndarray, "*batch"]:
    """Strictly between the bounds."""
    return (bounds[0] < value) & (value < bounds[1])


def walker_healthy(c: Any, f: Fields) -> Bool[np.ndarray, " N"]:
    """Upright."""
    upright: np.ndarray = inside(f.qpos[:, 1], c._healthy_z_range) & inside(f.qpos[:, 2], c._healthy_angle_range)
    return upright


def hopper_healthy(c: Any, f: Fields) -> Bool[np.ndarray, " N"]:
    """Upright, and no number out of hand."""
    state = np.concatenate([f.qpos, f.qvel], axis=1)[:, 2:]
    return walker_healthy(c, f) & inside(state, c._healthy_state_range).all(1)


def ant_observe(c: Any, f: Fields) -> Matrix:
    """Positions, velocities and clipped contact forces."""
    parts = [root_excluded(c, f, 2), f.qvel]
    if c._include_cfrc_ext_in_observation:
        parts.append(np.clip(f.cfrc_ext[:, 1:], *c._contact_force_range).reshape(len(f.qpos), -1))
    return np.concatenate(parts, axis=1)


def ant_position(c: Any, f: Fields) -> Rows:
    """Of the torso."""
    x: np.ndarray = f.xpos[:, c.model.body(c._main_body).id, 0]
    return x


def ant_healthy(c: Any, f: Fields) -> Bool[np.ndarray, " N"]:
    """Neither on the ground nor in the air."""
    low, high = c._healthy_z_range
    finite = np.isfinite(f.qpos).all(1) & np.isfinite(f.qvel).all(1)
    healthy: np.ndarray = finite & (low <= f.qpos[:, 2]) & (f.qpos[:, 2] <= high)
    return healthy


def ant_reward(c: Any, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Speed and survival less effort and contact."""
    forces = np.clip(f.cfrc_ext, *c._contact_force_range).reshape(len(velocity), -1)
    contact_cost = c._contact_cost_weight * np.square(forces).sum(1)
    reward: np.ndarray = velocity * c._forward_reward_weight + ant_healthy(c, f) * c._healthy_reward
    reward = reward - (control_cost(c, action) + contact_cost)
    return reward


def reacher_gap(c: Any, f: Fields) -> Float[np.ndarray, "N 3"]:
    """From the target to the fingertip."""
    gap: np.ndarray = f.xpos[:, c.model.body("fingertip").id] - f.xpos[:, c.model.body("target").id]
    return gap


def reacher_observe(c: Any, f: Fields) -> Matrix:
    """Joint angles, target, joint velocities and the gap."""
    angles = f.qpos[:, :2]
    return np.concatenate([np.cos(angles), np.sin(angles), f.qpos[:, 2:], f.qvel[:, :2], reacher_gap(c, f)[:, :2]], 1)


def reacher_reward(c: Any, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Closeness less effort."""
    del velocity
    gap = reacher_gap(c, f)
    near = -np.sqrt(np.vecdot(gap, gap)) * c._reward_dist_weight  # BLAS's dot, as np.linalg.norm
    reward: np.ndarray = near + -np.square(action).sum(1) * c._reward_control_weight
    return reward


def reacher_start(c: Any, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The arm nearly straight, the target within its reach."""
    qpos = generator.uniform(-0.1, 0.1, c.model.nq) + c.init_qpos
    goal = generator.uniform(-0.2, 0.2, 2)
    while np.linalg.norm(goal) >= 0.2:
        goal = generator.uniform(-0.2, 0.2, 2)
    qpos[-2:] = goal
    qvel = c.init_qvel + generator.uniform(-0.005, 0.005, c.model.nv)
    qvel[-2:] = 0
    return qpos, qvel


def _hopper_reward(c: Any, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    return walker_reward(c, f, velocity, action, hopper_healthy)


def _walker_reward(c: Any, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    return walker_reward(c, f, velocity, action, walker_healthy)


STATE = ("qpos", "qvel")
MUJOCO_TASKS = {
    "Reacher-v5": MujocoTask((*STATE, "xpos"), reacher_observe, x_position, reacher_reward, None, reacher_start),
    "HalfCheetah-v5": MujocoTask(STATE, cheetah_observe, x_position, cheetah_reward, None, uniform_and_normal),
    "Ant-v5": MujocoTask(
        (*STATE, "xpos", "cfrc_ext"), ant_observe, ant_position, ant_reward, ant_healthy, uniform_and_normal
    ),
    "Hopper-v5": MujocoTask(STATE, walker_observe, x_position, _hopper_reward, hopper_healthy, uniform),
    "Walker2d-v5": MujocoTask(STATE, walker_observe, x_position, _walker_reward, walker_healthy, uniform),
}


class MujocoSource:
    """One of MUJOCO_TASKS, with Gymnasium's keyword arguments.

    Raises:
        UsageError: an argument that Gymnasium refuses, or no MuJoCo.
    """

    given: int | None = None

    def __init__(self, name: str, **kwargs: Any) -> None:
        self.name, self.n_threads = name, n_cores()
        self.task = MUJOCO_TASKS[name]
        try:
            made = gymnasium.make(name, **kwargs)
        except Exception as error:
            raise UsageError(
                f"environment is {name!r}, which can't be made: {type(error).__name__}: {error}"
            ) from error
        self.constants: Any = made.unwrapped
        assert made.spec is not None
        self.max_episode_steps = made.spec.max_episode_steps
        self.action_space: Any = made.action_space
        self.observation_space: Any = made.observation_space

    def make(self, n_copies: int, n_threads: int = 1) -> "MujocoEnvs":
        """That many simulations, stepped on that many threads."""
        return MujocoEnvs(self, n_copies, n_threads)


class MujocoEnvs:
    """N simulations of one task."""

    def __init__(self, source: MujocoSource, n_copies: int, n_threads: int) -> None:
        self._source, self._task, self._constants = source, source.task, source.constants
        self._actions = ActionBox(source.name, source.action_space)
        self._observations = Observations(source.name, source.observation_space)
        n_threads = min(n_threads, n_copies)
        kind: type[Simulations] = Looped if "cfrc_ext" in source.task.fields else Batched
        self._simulations = kind(self._constants.model, n_copies, n_threads, source.task.fields)
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
        c, task, simulations = self._constants, self._task, self._simulations
        self._n_steps += 1
        clipped = self._actions.to_env(action)
        before = task.position(c, simulations.fields).copy()
        simulations.step(clipped, c.frame_skip)
        if simulations.was_reset.any():
            copy = int(np.flatnonzero(simulations.was_reset)[0])
            raise BrokenEnvironmentError(
                f"{self._where()}: MuJoCo found copy {copy} unstable (a position, velocity or acceleration that is "
                f"not finite or too large) and reset it; the action was {clipped[copy]}"
            )
        self._elapsed += 1
        f = simulations.fields
        velocity = (task.position(c, f) - before) / c.dt
        reward = task.reward(c, f, velocity, clipped)
        terminated = np.zeros(len(reward), bool)
        if task.healthy and c._terminate_when_unhealthy:
            terminated = ~task.healthy(c, f)
        limit = self._source.max_episode_steps
        truncated = (self._elapsed >= limit) if limit else np.zeros(len(reward), bool)
        return self._observe(), reward, terminated, truncated & ~terminated

    def get_state(self) -> dict[str, np.ndarray]:
        """Everything."""
        state = {f"field/{name}": np.array(value) for name, value in self._simulations.fields._asdict().items()}
        return state | {
            "physics": self._simulations.get_state(),
            "elapsed_steps": self._elapsed.copy(),
            "generator": np.stack([generator_state(generator) for generator in self._generators]),
        }

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on from there."""
        fields = {name.removeprefix("field/"): value for name, value in state.items() if name.startswith("field/")}
        self._simulations.set_state(state["physics"], fields)
        self._elapsed = np.array(state["elapsed_steps"])
        self._generators = [np.random.default_rng() for _ in self._elapsed]
        for generator, row in zip(self._generators, state["generator"], strict=True):
            set_generator_state(generator, row)

    def close(self) -> None:
        """Let go of threads."""
        self._simulations.close()

    def _begin(self, copies: Int[np.ndarray, " n"]) -> None:
        starts = [self._task.start(self._constants, self._generators[i]) for i in copies]
        self._simulations.reset(copies, np.stack([q for q, _ in starts]), np.stack([v for _, v in starts]))
        self._elapsed[copies] = 0

    def _observe(self) -> Matrix:
        return self._task.observe(self._constants, self._simulations.fields)

    def _checked(self, observation: Matrix) -> Float[np.ndarray, "N o"]:
        return as_float32(observation, "the observations", self._where())

    def _where(self) -> str:
        return f"{self._source.name}, step {self._n_steps}"
