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
Condition = Callable[[Constants, Fields], Bool[np.ndarray, " N"]]
"""(c, fields) → of which simulations something is true."""
Start = tuple[Float[np.ndarray, " q"], Float[np.ndarray, " v"]]
"""qpos and qvel of one simulation."""

STATE = ("qpos", "qvel")


class MujocoFunctions(NamedTuple):
    """The functions of a task: observations and rewards of its N simulations, beginnings and ends of episodes."""

    fields: tuple[str, ...]
    """The fields of MjData that the functions read."""
    observe: Callable[[Constants, Fields], Matrix]
    """(c, fields) → observations."""
    position: Callable[[Constants, Fields], Rows]
    """(c, fields) → where the robot is, for its velocity."""
    reward: Callable[[Constants, Fields, Rows, Matrix], Rows]
    """(c, fields, velocity, action) → rewards."""
    ended: Condition | None
    """(c, fields) → which episodes terminate here; None if none ever does."""
    start: Callable[[Constants, np.random.Generator], Start]
    """(c, generator) → qpos and qvel at the start of an episode."""


def control_cost(c: Constants, action: Matrix) -> Rows:
    """W Σ a², in the action's precision as in Gymnasium."""
    return c._ctrl_cost_weight * np.square(action).sum(1)


def x_position(_: Constants, f: Fields) -> Rows:
    """The position of the robot's root along the track."""
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


def place(c: Constants, f: Fields, body: str) -> Float[np.ndarray, "N 3"]:
    """The position of a body."""
    return f["xpos"][:, c.model.body(body).id]


def length(vector: Float[np.ndarray, "N 3"]) -> Rows:
    """The Euclidean norm, by BLAS's dot as in np.linalg.norm."""
    return np.sqrt(np.vecdot(vector, vector))


def inside(value: np.ndarray, bounds: tuple[float, float]) -> Bool[np.ndarray, "*batch"]:
    """True for the values that lie strictly between the bounds."""
    return (bounds[0] < value) & (value < bounds[1])


def unhealthy(healthy: Condition) -> Condition:
    """The end of an episode where robots must stay healthy, unless `terminate_when_unhealthy` is off."""
    return lambda c, f: np.logical_and(c._terminate_when_unhealthy, ~healthy(c, f))


def reacher_gap(c: Constants, f: Fields) -> Matrix:
    """The vector from the target to the fingertip."""
    return place(c, f, "fingertip") - place(c, f, "target")


def reacher_observe(c: Constants, f: Fields) -> Matrix:
    """Cosines and sines of the joint angles, the target, the joint velocities and the gap."""
    angles, target = f["qpos"][:, :2], f["qpos"][:, 2:]
    gap = reacher_gap(c, f)[:, :2]
    return np.concatenate([np.cos(angles), np.sin(angles), target, f["qvel"][:, :2], gap], axis=1)


def reacher_reward(c: Constants, f: Fields, _: Rows, action: Matrix) -> Rows:
    """Charge for the distance from the target, and for effort."""
    near = -length(reacher_gap(c, f)) * c._reward_dist_weight
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


def pusher_observe(c: Constants, f: Fields) -> Matrix:
    """The joint angles and velocities of the arm, and where its tip, the object and the goal are."""
    bodies = [place(c, f, body) for body in ("tips_arm", "object", "goal")]
    return np.concatenate([f["qpos"][:, :7], f["qvel"][:, :7], *bodies], axis=1)


def pusher_reward(c: Constants, f: Fields, _: Rows, action: Matrix) -> Rows:
    """Charge for the object's distance from the goal, for effort, and for the tip's distance from the object."""
    thing = place(c, f, "object")
    near = -length(thing - place(c, f, "tips_arm")) * c._reward_near_weight
    far = -length(thing - place(c, f, "goal")) * c._reward_dist_weight
    return far + -np.square(action).sum(1) * c._reward_control_weight + near


def pusher_start(c: Constants, generator: np.random.Generator) -> Start:
    """The arm at rest in its pose, and the object not too close to the goal."""
    where = _beside_the_goal(generator)
    while np.linalg.norm(where) <= 0.17:
        where = _beside_the_goal(generator)
    qpos = c.init_qpos.copy()
    qpos[-4:] = *where, 0, 0
    qvel = c.init_qvel + generator.uniform(-0.005, 0.005, c.model.nv)
    qvel[-4:] = 0
    return qpos, qvel


def _beside_the_goal(generator: np.random.Generator) -> np.ndarray:
    return np.concatenate([generator.uniform(-0.3, 0, 1), generator.uniform(-0.2, 0.2, 1)])


def poles_observe(_: Constants, f: Fields) -> Matrix:
    """The cart's position, sines and cosines of angles, velocities and the cart's constraint force, both clipped."""
    angles, force = f["qpos"][:, 1:], np.clip(f["qfrc_constraint"], -10, 10)[:, :1]
    parts = [f["qpos"][:, :1], np.sin(angles), np.cos(angles), np.clip(f["qvel"], -10, 10), force]
    return np.concatenate(parts, axis=1)


def poles_fell(_: Constants, f: Fields) -> Bool[np.ndarray, " N"]:
    """True where the tip of the upper pole is at the height of 1 or below."""
    return f["site_xpos"][:, 0, 2] <= 1


def poles_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Pay for standing, and charge for the tip's distance from upright and for turning."""
    del velocity, action
    x, y = _squares(f["site_xpos"][:, 0, 0]), _squares(f["site_xpos"][:, 0, 2] - 2)
    lower, upper = _squares(f["qvel"][:, 1]), _squares(f["qvel"][:, 2])
    standing = c._healthy_reward * (~poles_fell(c, f)).astype(int)
    return standing - (0.01 * x + y) - (1e-3 * lower + 5e-3 * upper)


def _squares(values: Rows) -> Rows:
    """Each value ** 2 by C's pow, as for Gymnasium's single numbers: arrays are multiplied, which rounds otherwise."""
    return np.array([value**2 for value in values.tolist()])


def cheetah_observe(c: Constants, f: Fields, root: int = 1) -> Matrix:
    """The positions, then the velocities."""
    return np.concatenate([root_excluded(c, f, root), f["qvel"]], axis=1)


def cheetah_reward(c: Constants, _: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Pay for speed, and charge for effort."""
    return c._forward_reward_weight * velocity - control_cost(c, action)


def walker_observe(c: Constants, f: Fields) -> Matrix:
    """The positions, then the velocities clipped into [−10, 10]."""
    return np.concatenate([root_excluded(c, f, 1), np.clip(f["qvel"], -10, 10)], axis=1)


def walker_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix, healthy: Condition) -> Rows:
    """Pay for speed and for being healthy, and charge for effort."""
    return c._forward_reward_weight * velocity + healthy(c, f) * c._healthy_reward - control_cost(c, action)


def walker_healthy(c: Constants, f: Fields) -> Bool[np.ndarray, " N"]:
    """True for the robots that stand upright."""
    return inside(f["qpos"][:, 1], c._healthy_z_range) & inside(f["qpos"][:, 2], c._healthy_angle_range)


def hopper_healthy(c: Constants, f: Fields) -> Bool[np.ndarray, " N"]:
    """True for the robots that stand upright with no number out of hand."""
    state = np.concatenate([f["qpos"], f["qvel"]], axis=1)[:, 2:]
    return walker_healthy(c, f) & inside(state, c._healthy_state_range).all(1)


def ant_observe(c: Constants, f: Fields) -> Matrix:
    """The positions, the velocities, and the clipped contact forces unless they are left out."""
    parts = [root_excluded(c, f, 2), f["qvel"]]
    if c._include_cfrc_ext_in_observation:
        parts.append(np.clip(f["cfrc_ext"][:, 1:], *c._contact_force_range).reshape(len(f["qpos"]), -1))
    return np.concatenate(parts, axis=1)


def ant_position(c: Constants, f: Fields) -> Rows:
    """The position of the torso along the track."""
    return f["xpos"][:, c.model.body(c._main_body).id, 0]


def ant_healthy(c: Constants, f: Fields) -> Bool[np.ndarray, " N"]:
    """True for the robots that are neither on the ground nor in the air."""
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
    """The center of mass along the track; summed for each robot by itself, as the order of a sum rounds."""
    mass = c.model.body_mass
    moment = [np.einsum("b,bj->j", mass, centers)[0] for centers in f["xipos"]]
    return np.array(moment) / mass.sum()


def humanoid_healthy(c: Constants, f: Fields) -> Bool[np.ndarray, " N"]:
    """True for the robots that neither lie nor fly."""
    return inside(f["qpos"][:, 2], c._healthy_z_range)


def humanoid_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Pay for speed and for being healthy, and charge for effort, in double precision, and for contact."""
    squares = np.square(f["cfrc_ext"]).reshape(len(velocity), -1).sum(1)
    contact_cost = np.clip(c._contact_cost_weight * squares, *c._contact_cost_range)
    earned = c._forward_reward_weight * velocity + humanoid_healthy(c, f) * c._healthy_reward
    return earned - (control_cost(c, action.astype(np.float64)) + contact_cost)


POLES_FIELDS = (*STATE, "site_xpos", "qfrc_constraint")
SWIMMER_OBSERVE = functools.partial(cheetah_observe, root=2)
HOPPER_REWARD = functools.partial(walker_reward, healthy=hopper_healthy)
WALKER_REWARD = functools.partial(walker_reward, healthy=walker_healthy)
HUMANOID_FIELDS = (*STATE, "xipos", "cinert", "cvel", "qfrc_actuator", "cfrc_ext")
MUJOCO_FUNCTIONS = {
    "Reacher-v5": MujocoFunctions((*STATE, "xpos"), reacher_observe, x_position, reacher_reward, None, reacher_start),
    "Pusher-v5": MujocoFunctions((*STATE, "xpos"), pusher_observe, x_position, pusher_reward, None, pusher_start),
    "InvertedDoublePendulum-v5": MujocoFunctions(
        POLES_FIELDS, poles_observe, x_position, poles_reward, poles_fell, uniform_and_normal
    ),
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
"""The tasks that run in batches, by Gymnasium's ids."""
