"""The MuJoCo tasks that run in batches, by Gymnasium's ids."""

from galton.envs.host.mujoco_arms import ARMS
from galton.envs.host.mujoco_robots import ROBOTS

MUJOCO_FUNCTIONS = ARMS | ROBOTS
