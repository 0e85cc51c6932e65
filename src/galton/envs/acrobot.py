"""Continuous Acrobot (App. C.1): Gymnasium's Acrobot-v1 with any torque in [−1, 1]."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from galton.envs.base import box

DT, GRAVITY = 0.2, 9.8
MAX_VELOCITY_1, MAX_VELOCITY_2 = 4 * np.pi, 9 * np.pi


@dataclasses.dataclass(frozen=True)
class Acrobot:
    """Two unit links, torque on the joint between them, −1 a step until the tip is one link above the pivot.

    State (θ1, θ2, dθ1, dθ2); both links have mass, length and moment of inertia 1 and their center at ½. The best
    return is not known in closed form.
    """

    max_episode_steps = 500
    action_low = box(-1.0, 1)
    action_high = box(1.0, 1)
    observation_high = np.array([1, 1, 1, 1, MAX_VELOCITY_1, MAX_VELOCITY_2], np.float32)
    observation_low = -observation_high
    optimal_return = None
    random_return = None

    def reset(self, key: Key[Array, ""]) -> Float[Array, " 4"]:
        """Hanging down, each entry ~ U(−0.1, 0.1)."""
        return jax.random.uniform(key, (4,), minval=-0.1, maxval=0.1)

    def noise(self, key: Key[Array, ""]) -> tuple[()]:
        """No noise, (), since the dynamics are deterministic."""
        return ()

    def step(
        self, state: Float[Array, " 4"], action: Float[Array, " 1"], noise: tuple[()]
    ) -> tuple[Float[Array, " 4"], Float[Array, ""], Bool[Array, ""]]:
        """One Runge-Kutta step of 0.2 s."""
        torque = jnp.clip(action[0], -1.0, 1.0)
        k1 = _derivative(state, torque)
        k2 = _derivative(state + DT / 2 * k1, torque)
        k3 = _derivative(state + DT / 2 * k2, torque)
        k4 = _derivative(state + DT * k3, torque)
        theta1, theta2, velocity1, velocity2 = state + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        state = jnp.stack(
            [
                _wrap(theta1),
                _wrap(theta2),
                jnp.clip(velocity1, -MAX_VELOCITY_1, MAX_VELOCITY_1),
                jnp.clip(velocity2, -MAX_VELOCITY_2, MAX_VELOCITY_2),
            ]
        )
        terminated = -jnp.cos(theta1) - jnp.cos(theta2 + theta1) > 1.0
        return state, jnp.where(terminated, 0.0, -1.0), terminated

    def observe(self, state: Float[Array, " 4"]) -> Float[Array, " 6"]:
        """Cosine and sine of both angles, both velocities."""
        theta1, theta2, velocity1, velocity2 = state
        return jnp.stack([jnp.cos(theta1), jnp.sin(theta1), jnp.cos(theta2), jnp.sin(theta2), velocity1, velocity2])


def _wrap(angle: Float[Array, ""]) -> Float[Array, ""]:
    """The angle moved into [−π, π] by whole turns."""
    return angle - 2 * jnp.pi * jnp.round(angle / (2 * jnp.pi))


def _derivative(state: Float[Array, " 4"], torque: Float[Array, ""]) -> Float[Array, " 4"]:
    """Sutton and Barto's equations of motion ("book" in Gymnasium); cos(x − π/2) is sin x."""
    theta1, theta2, velocity1, velocity2 = state
    cos2, sin2 = jnp.cos(theta2), jnp.sin(theta2)
    d1 = 0.25 + (1.25 + cos2) + 2.0
    d2 = (0.25 + 0.5 * cos2) + 1.0
    phi2 = 0.5 * GRAVITY * jnp.sin(theta1 + theta2)
    phi1 = -0.5 * velocity2**2 * sin2 - velocity2 * velocity1 * sin2 + 1.5 * GRAVITY * jnp.sin(theta1) + phi2
    acceleration2 = (torque + d2 / d1 * phi1 - 0.5 * velocity1**2 * sin2 - phi2) / (1.25 - d2**2 / d1)
    acceleration1 = -(d2 * acceleration2 + phi1) / d1
    return jnp.stack([velocity1, velocity2, acceleration1, acceleration2])
