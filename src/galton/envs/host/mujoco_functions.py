"""Gymnasium's MuJoCo tasks as functions over N simulations.

Each says over N simulations what Gymnasium's class says over one, to the last bit. `c` is an instance of that class,
read for its constants alone, so every keyword argument of `gymnasium.make` works. `f` are the fields that the task
reads from the simulations.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from galton.envs.host.simulation import Fields

Constants = Any
"""Gymnasium's environment of the task. Its class, and so which constants it has, differs from task to task."""
Rows = Float[np.ndarray, " N"]
"""One number for each simulation."""
Matrix = Float[np.ndarray, "N n"]
"""A vector for each simulation."""
Healthy = Callable[[Constants, Fields], Bool[np.ndarray, " N"]]
"""(c, fields) → which robots have not fallen."""
Start = tuple[Float[np.ndarray, " q"], Float[np.ndarray, " v"]]
"""qpos and qvel of one simulation."""


class MujocoFunctions(NamedTuple):
    """What N simulations of a task see and earn, and where their episodes begin."""

    fields: tuple[str, ...]
    """The fields of MjData that the functions read."""
    observe: Callable[[Constants, Fields], Matrix]
    """(c, fields) → observations."""
    position: Callable[[Constants, Fields], Rows]
    """(c, fields) → where the robot is, for its velocity."""
    reward: Callable[[Constants, Fields, Rows, Matrix], Rows]
    """(c, fields, velocity, action) → rewards."""
    healthy: Healthy | None
    """(c, fields) → which episodes go on; None if they all do."""
    start: Callable[[Constants, np.random.Generator], Start]
    """(c, generator) → qpos and qvel at the start of an episode."""


def control_cost(c: Constants, action: Matrix) -> Rows:
    """W Σ a², in the action's precision as in Gymnasium."""
    return c._ctrl_cost_weight * np.square(action).sum(1)


def x_position(c: Constants, f: Fields) -> Rows:
    """Where the root of the robot is, along the track."""
    del c
    return f["qpos"][:, 0]


def uniform_and_normal(c: Constants, generator: np.random.Generator) -> Start:
    """Positions uniformly around the pose of the model, velocities normal."""
    scale = c._reset_noise_scale
    qpos = c.init_qpos + generator.uniform(-scale, scale, c.model.nq)
    return qpos, c.init_qvel + scale * generator.standard_normal(c.model.nv)


def uniform(c: Constants, generator: np.random.Generator) -> Start:
    """Positions and velocities uniformly around the pose of the model."""
    scale = c._reset_noise_scale
    qpos = c.init_qpos + generator.uniform(-scale, scale, c.model.nq)
    return qpos, c.init_qvel + generator.uniform(-scale, scale, c.model.nv)


def root_excluded(c: Constants, f: Fields, root: int) -> Float[np.ndarray, "N q"]:
    """Positions, by default without where the root stands."""
    return f["qpos"][:, root * c._exclude_current_positions_from_observation :]


def cheetah_observe(c: Constants, f: Fields) -> Matrix:
    """The positions, then the velocities."""
    return np.concatenate([root_excluded(c, f, 1), f["qvel"]], axis=1)


def cheetah_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Pay for speed, and charge for effort."""
    del f
    return c._forward_reward_weight * velocity - control_cost(c, action)


def walker_observe(c: Constants, f: Fields) -> Matrix:
    """The positions, then the velocities clipped into [−10, 10]."""
    return np.concatenate([root_excluded(c, f, 1), np.clip(f["qvel"], -10, 10)], axis=1)


def walker_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix, healthy: Healthy) -> Rows:
    """Pay for speed and for being healthy, and charge for effort."""
    return c._forward_reward_weight * velocity + healthy(c, f) * c._healthy_reward - control_cost(c, action)


def inside(value: np.ndarray, bounds: tuple[float, float]) -> Bool[np.ndarray, "*batch"]:
    """Which values lie strictly between the bounds."""
    return (bounds[0] < value) & (value < bounds[1])


def walker_healthy(c: Constants, f: Fields) -> Bool[np.ndarray, " N"]:
    """Which robots stand upright."""
    return inside(f["qpos"][:, 1], c._healthy_z_range) & inside(f["qpos"][:, 2], c._healthy_angle_range)


def hopper_healthy(c: Constants, f: Fields) -> Bool[np.ndarray, " N"]:
    """Which robots stand upright with no number out of hand."""
    state = np.concatenate([f["qpos"], f["qvel"]], axis=1)[:, 2:]
    return walker_healthy(c, f) & inside(state, c._healthy_state_range).all(1)


def ant_observe(c: Constants, f: Fields) -> Matrix:
    """The positions, the velocities, and the clipped contact forces unless they are left out."""
    parts = [root_excluded(c, f, 2), f["qvel"]]
    if c._include_cfrc_ext_in_observation:
        parts.append(np.clip(f["cfrc_ext"][:, 1:], *c._contact_force_range).reshape(len(f["qpos"]), -1))
    return np.concatenate(parts, axis=1)


def ant_position(c: Constants, f: Fields) -> Rows:
    """Where the torso is, along the track."""
    return f["xpos"][:, c.model.body(c._main_body).id, 0]


def ant_healthy(c: Constants, f: Fields) -> Bool[np.ndarray, " N"]:
    """Which robots are neither on the ground nor in the air."""
    low, high = c._healthy_z_range
    finite = np.isfinite(f["qpos"]).all(1) & np.isfinite(f["qvel"]).all(1)
    return finite & (low <= f["qpos"][:, 2]) & (f["qpos"][:, 2] <= high)


def ant_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Pay for speed and for being healthy, and charge for effort and contact."""
    forces = np.clip(f["cfrc_ext"], *c._contact_force_range).reshape(len(velocity), -1)
    contact_cost = c._contact_cost_weight * np.square(forces).sum(1)
    earned = velocity * c._forward_reward_weight + ant_healthy(c, f) * c._healthy_reward
    return earned - (control_cost(c, action) + contact_cost)


def reacher_gap(c: Constants, f: Fields) -> Float[np.ndarray, "N 3"]:
    """The vector from the target to the fingertip."""
    return f["xpos"][:, c.model.body("fingertip").id] - f["xpos"][:, c.model.body("target").id]


def reacher_observe(c: Constants, f: Fields) -> Matrix:
    """Cosines and sines of the joint angles, the target, the joint velocities and the gap."""
    angles, target = f["qpos"][:, :2], f["qpos"][:, 2:]
    gap = reacher_gap(c, f)[:, :2]
    return np.concatenate([np.cos(angles), np.sin(angles), target, f["qvel"][:, :2], gap], axis=1)


def reacher_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Charge for the distance from the target, and for effort."""
    del velocity
    gap = reacher_gap(c, f)
    near = -np.sqrt(np.vecdot(gap, gap)) * c._reward_dist_weight  # BLAS's dot, as np.linalg.norm
    return near + -np.square(action).sum(1) * c._reward_control_weight


def reacher_start(c: Constants, generator: np.random.Generator) -> Start:
    """The arm nearly straight, and the target within its reach."""
    qpos = generator.uniform(-0.1, 0.1, c.model.nq) + c.init_qpos
    goal = generator.uniform(-0.2, 0.2, 2)
    while np.linalg.norm(goal) >= 0.2:
        goal = generator.uniform(-0.2, 0.2, 2)
    qpos[-2:] = goal
    qvel = c.init_qvel + generator.uniform(-0.005, 0.005, c.model.nv)
    qvel[-2:] = 0
    return qpos, qvel


HOPPER_REWARD = functools.partial(walker_reward, healthy=hopper_healthy)
WALKER_REWARD = functools.partial(walker_reward, healthy=walker_healthy)
STATE = ("qpos", "qvel")
MUJOCO_FUNCTIONS = {
    "Reacher-v5": MujocoFunctions((*STATE, "xpos"), reacher_observe, x_position, reacher_reward, None, reacher_start),
    "HalfCheetah-v5": MujocoFunctions(STATE, cheetah_observe, x_position, cheetah_reward, None, uniform_and_normal),
    "Ant-v5": MujocoFunctions(
        (*STATE, "xpos", "cfrc_ext"), ant_observe, ant_position, ant_reward, ant_healthy, uniform_and_normal
    ),
    "Hopper-v5": MujocoFunctions(STATE, walker_observe, x_position, HOPPER_REWARD, hopper_healthy, uniform),
    "Walker2d-v5": MujocoFunctions(STATE, walker_observe, x_position, WALKER_REWARD, walker_healthy, uniform),
}
