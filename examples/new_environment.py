"""An environment of your own in pure JAX: a frozen record with reset, noise, step and observe."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

import galton
from galton.envs import box


@dataclasses.dataclass(frozen=True)
class Pendulum:
    """Gymnasium's Pendulum-v1: swing up and balance; state (angle, velocity), torque in [−2, 2]."""

    gravity: float = 10.0

    max_episode_steps = 200
    action_low = box(-2.0, 1)
    action_high = box(2.0, 1)
    observation_low = -np.array([1.0, 1.0, 8.0], np.float32)
    observation_high = np.array([1.0, 1.0, 8.0], np.float32)
    optimal_return = None
    random_return = None

    def reset(self, key):
        """Any angle, a small velocity."""
        bound = jnp.array([jnp.pi, 1.0])
        return jax.random.uniform(key, (2,), minval=-bound, maxval=bound)

    def noise(self, key):
        """None."""
        return ()

    def step(self, state, action, noise):
        """0.05 s."""
        angle, velocity = state
        wrapped = (angle + jnp.pi) % (2 * jnp.pi) - jnp.pi
        cost = wrapped**2 + 0.1 * velocity**2 + 0.001 * action[0] ** 2
        velocity = jnp.clip(velocity + (1.5 * self.gravity * jnp.sin(angle) + 3 * action[0]) * 0.05, -8, 8)
        return jnp.stack([angle + velocity * 0.05, velocity]), -cost, jnp.array(False)

    def observe(self, state):
        """Cosine, sine, velocity."""
        angle, velocity = state
        return jnp.stack([jnp.cos(angle), jnp.sin(angle), velocity])


if __name__ == "__main__":
    galton.use_all_cores()
    head = {"loss": "hl-gauss-centred", "n_bins": 30, "eta": 2.0}
    learning = {"n_envs": 4, "n_steps": 8, "learning_rate": 1.5e-3, "gamma": 0.9, "gae_lambda": 0.95, "ent_coef": 1e-3}
    agent = galton.make_agent(**head, **learning)
    result = galton.train(Pendulum(), agent, range(4), total_timesteps=200_000, n_logs=20)
    first, last = result.log.training_return[:, 0].mean(), result.final("training_return").mean()
    print(f"training return {first:.0f} → {last:.0f}")
