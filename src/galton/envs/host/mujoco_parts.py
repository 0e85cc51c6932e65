"""What Gymnasium's MuJoCo tasks have in common, as functions over N simulations.

Each says over N simulations what Gymnasium's class says over one, to the last bit. `c` is an instance of that class,
read for its constants alone, so every keyword argument of `gymnasium.make` works. `f` are the fields that the task
reads from the simulations.
"""

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
    """What N simulations of a task see and earn, and where their episodes begin and end."""

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


def place(c: Constants, f: Fields, body: str) -> Float[np.ndarray, "N 3"]:
    """Where a body is."""
    return f["xpos"][:, c.model.body(body).id]


def length(vector: Float[np.ndarray, "N 3"]) -> Rows:
    """The Euclidean norm, by BLAS's dot as in np.linalg.norm."""
    return np.sqrt(np.vecdot(vector, vector))


def inside(value: np.ndarray, bounds: tuple[float, float]) -> Bool[np.ndarray, "*batch"]:
    """Which values lie strictly between the bounds."""
    return (bounds[0] < value) & (value < bounds[1])


def unhealthy(healthy: Condition) -> Condition:
    """The end of an episode where robots must stay healthy, unless `terminate_when_unhealthy` is off."""
    return lambda c, f: np.logical_and(c._terminate_when_unhealthy, ~healthy(c, f))
