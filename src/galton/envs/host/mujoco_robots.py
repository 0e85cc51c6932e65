"""Gymnasium's MuJoCo tasks in which a robot is to move forwards (see mujoco_parts)."""

import functools

import numpy as np
from jaxtyping import Bool

from galton.envs.host.mujoco_parts import (
    STATE,
    Condition,
    Constants,
    Matrix,
    MujocoFunctions,
    Rows,
    control_cost,
    inside,
    root_excluded,
    unhealthy,
    uniform,
    uniform_and_normal,
    x_position,
)
from galton.envs.host.simulation import Fields


def cheetah_observe(c: Constants, f: Fields, root: int = 1) -> Matrix:
    """The positions, then the velocities."""
    return np.concatenate([root_excluded(c, f, root), f["qvel"]], axis=1)


def cheetah_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Pay for speed, and charge for effort."""
    del f
    return c._forward_reward_weight * velocity - control_cost(c, action)


def walker_observe(c: Constants, f: Fields) -> Matrix:
    """The positions, then the velocities clipped into [−10, 10]."""
    return np.concatenate([root_excluded(c, f, 1), np.clip(f["qvel"], -10, 10)], axis=1)


def walker_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix, healthy: Condition) -> Rows:
    """Pay for speed and for being healthy, and charge for effort."""
    return c._forward_reward_weight * velocity + healthy(c, f) * c._healthy_reward - control_cost(c, action)


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


def humanoid_observe(c: Constants, f: Fields) -> Matrix:
    """The positions and velocities, and what is not left out of inertias, body velocities, torques and contacts."""
    parts = [root_excluded(c, f, 2), f["qvel"]]
    if c._include_cinert_in_observation is True:
        parts.append(f["cinert"][:, 1:])
    if c._include_cvel_in_observation is True:
        parts.append(f["cvel"][:, 1:])
    if c._include_qfrc_actuator_in_observation is True:
        parts.append(f["qfrc_actuator"][:, 6:])
    if c._include_cfrc_ext_in_observation is True:
        parts.append(f["cfrc_ext"][:, 1:])
    return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)


def humanoid_position(c: Constants, f: Fields) -> Rows:
    """Where the center of mass is, along the track; summed for each robot by itself, as the order of a sum rounds."""
    mass = c.model.body_mass
    moment = [np.einsum("b,bj->j", mass, centers)[0] for centers in f["xipos"]]
    return np.array(moment) / mass.sum()


def humanoid_healthy(c: Constants, f: Fields) -> Bool[np.ndarray, " N"]:
    """Which robots neither lie nor fly."""
    return inside(f["qpos"][:, 2], c._healthy_z_range)


def humanoid_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Pay for speed and for being healthy, and charge for effort, in double precision, and for contact."""
    squares = np.square(f["cfrc_ext"]).reshape(len(velocity), -1).sum(1)
    contact_cost = np.clip(c._contact_cost_weight * squares, *c._contact_cost_range)
    earned = c._forward_reward_weight * velocity + humanoid_healthy(c, f) * c._healthy_reward
    return earned - (control_cost(c, action.astype(np.float64)) + contact_cost)


SWIMMER_OBSERVE = functools.partial(cheetah_observe, root=2)
HOPPER_REWARD = functools.partial(walker_reward, healthy=hopper_healthy)
WALKER_REWARD = functools.partial(walker_reward, healthy=walker_healthy)
HUMANOID_FIELDS = (*STATE, "xipos", "cinert", "cvel", "qfrc_actuator", "cfrc_ext")
ROBOTS = {
    "HalfCheetah-v5": MujocoFunctions(STATE, cheetah_observe, x_position, cheetah_reward, None, uniform_and_normal),
    "Ant-v5": MujocoFunctions(
        (*STATE, "xpos", "cfrc_ext"), ant_observe, ant_position, ant_reward, unhealthy(ant_healthy), uniform_and_normal
    ),
    "Hopper-v5": MujocoFunctions(STATE, walker_observe, x_position, HOPPER_REWARD, unhealthy(hopper_healthy), uniform),
    "Walker2d-v5": MujocoFunctions(
        STATE, walker_observe, x_position, WALKER_REWARD, unhealthy(walker_healthy), uniform
    ),
    "Swimmer-v5": MujocoFunctions(STATE, SWIMMER_OBSERVE, x_position, cheetah_reward, None, uniform),
    "Humanoid-v5": MujocoFunctions(
        HUMANOID_FIELDS, humanoid_observe, humanoid_position, humanoid_reward, unhealthy(humanoid_healthy), uniform
    ),
}
