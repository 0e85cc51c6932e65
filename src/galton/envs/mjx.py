"""Gymnasium's robots that run, in MJX: on a device beside the policy, and so other tasks, "mjx:HalfCheetah"."""

import dataclasses
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from mujoco import mjx

TASKS = ("HalfCheetah", "Hopper", "Walker2d")
ANYWHERE = (-np.inf, np.inf)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class State:
    """A state as Brax's protocol has it."""

    data: Any
    obs: Float[Array, " o"]
    reward: Float[Array, ""]
    done: Float[Array, ""]
    metrics: dict[str, Float[Array, ""]]


class Runner:
    """Gymnasium's task of that name, version 5: its model, and the numbers of its rewards, ends and first states.

    The physics is MJX's in the place of MuJoCo's, so a step agrees with Gymnasium's, and an episode does not: contacts
    magnify what rounding leaves.
    """

    def __init__(self, name: str) -> None:
        env: Any = gymnasium.make(f"{name}-v5").unwrapped
        self.model, self.frame_skip, self.dt = mjx.put_model(env.model), env.frame_skip, float(env.dt)
        self.qpos, self.qvel = np.array(env.init_qpos), np.array(env.init_qvel)
        self.noise = float(env._reset_noise_scale)
        self.weights = float(env._forward_reward_weight), float(env._ctrl_cost_weight)
        self.falls = hasattr(env, "_healthy_reward")
        """True where a fall ends an episode, and each step before is paid for; the cheetah can't fall."""
        self.healthy_reward = float(env._healthy_reward) if self.falls else 0.0
        self.z_range, self.angle_range, self.state_range = (
            getattr(env, f"_healthy_{name}_range", ANYWHERE) for name in ("z", "angle", "state")
        )
        env.close()

    @property
    def action_size(self) -> int:
        """The motors, which take −1 to 1."""
        return int(self.model.nu)

    def reset(self, key: PRNGKeyArray) -> State:
        """The first pose with Gymnasium's noise: velocities of the cheetah are normal, all else is uniform."""
        of_pose, of_speed = jax.random.split(key)
        uniform = self.noise * jax.random.uniform(of_pose, (self.model.nq,), minval=-1.0)
        draw = jax.random.uniform(of_speed, (self.model.nv,), minval=-1.0)
        draw = draw if self.falls else jax.random.normal(of_speed, (self.model.nv,))
        data = mjx.make_data(self.model)
        data = mjx.forward(self.model, data.replace(qpos=self.qpos + uniform, qvel=self.qvel + self.noise * draw))
        nothing = jnp.zeros(())
        return State(data, self._observed(data), nothing, nothing, {"reward_forward": nothing, "reward_ctrl": nothing})

    def step(self, state: State, action: Float[Array, " d"]) -> State:
        """So many steps of the physics as Gymnasium has in one, with the same force."""
        before = state.data.replace(ctrl=action)
        data, _ = jax.lax.scan(lambda data, _: (mjx.step(self.model, data), None), before, None, self.frame_skip)
        forward = self.weights[0] * (data.qpos[0] - state.data.qpos[0]) / self.dt
        cost = self.weights[1] * jnp.square(action).sum()
        healthy = self._is_healthy(data)
        reward = forward - cost + self.healthy_reward * healthy
        metrics = {"reward_forward": forward, "reward_ctrl": -cost}
        return State(data, self._observed(data), reward, 1.0 - healthy, metrics)

    def _observed(self, data: Any) -> Float[Array, " o"]:
        """Pose without the way it has come, and velocities; those of robots that fall are cut off at 10."""
        speed = jnp.clip(data.qvel, -10, 10) if self.falls else data.qvel
        return jnp.concatenate([data.qpos[1:], speed])

    def _is_healthy(self, data: Any) -> Float[Array, ""]:
        rest = jnp.concatenate([data.qpos[2:], data.qvel])
        ranges = ((data.qpos[1], self.z_range), (data.qpos[2], self.angle_range), (rest, self.state_range))
        return jnp.array([jnp.all((low < x) & (x < high)) for x, (low, high) in ranges]).all().astype(float)
