"""Gymnasium's MuJoCo tasks in which an arm reaches or pushes, or a pole is balanced (see mujoco_parts)."""

import numpy as np
from jaxtyping import Bool

from galton.envs.host.mujoco_parts import (
    STATE,
    Constants,
    Matrix,
    MujocoFunctions,
    Rows,
    Start,
    length,
    place,
    uniform_and_normal,
    x_position,
)
from galton.envs.host.simulation import Fields


def reacher_gap(c: Constants, f: Fields) -> Matrix:
    """The vector from the target to the fingertip."""
    return place(c, f, "fingertip") - place(c, f, "target")


def reacher_observe(c: Constants, f: Fields) -> Matrix:
    """Cosines and sines of the joint angles, the target, the joint velocities and the gap."""
    angles, target = f["qpos"][:, :2], f["qpos"][:, 2:]
    gap = reacher_gap(c, f)[:, :2]
    return np.concatenate([np.cos(angles), np.sin(angles), target, f["qvel"][:, :2], gap], axis=1)


def reacher_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Charge for the distance from the target, and for effort."""
    del velocity
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


def pusher_reward(c: Constants, f: Fields, velocity: Rows, action: Matrix) -> Rows:
    """Charge for the object's distance from the goal, for effort, and for the tip's distance from the object."""
    del velocity
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


def poles_observe(c: Constants, f: Fields) -> Matrix:
    """Where the cart is, sines and cosines of the angles, velocities and the cart's constraint force, both clipped."""
    del c
    angles, force = f["qpos"][:, 1:], np.clip(f["qfrc_constraint"], -10, 10)[:, :1]
    parts = [f["qpos"][:, :1], np.sin(angles), np.cos(angles), np.clip(f["qvel"], -10, 10), force]
    return np.concatenate(parts, axis=1)


def poles_fell(c: Constants, f: Fields) -> Bool[np.ndarray, " N"]:
    """Where the tip of the upper pole is at the height of 1 or below."""
    del c
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


POLES_FIELDS = (*STATE, "site_xpos", "qfrc_constraint")
ARMS = {
    "Reacher-v5": MujocoFunctions((*STATE, "xpos"), reacher_observe, x_position, reacher_reward, None, reacher_start),
    "Pusher-v5": MujocoFunctions((*STATE, "xpos"), pusher_observe, x_position, pusher_reward, None, pusher_start),
    "InvertedDoublePendulum-v5": MujocoFunctions(
        POLES_FIELDS, poles_observe, x_position, poles_reward, poles_fell, uniform_and_normal
    ),
}
