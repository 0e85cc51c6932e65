"""A policy of your own: Laplace noise around the mean. A class and a line in POLICIES; losses of any density fit it."""

import dataclasses

import jax
import jax.numpy as jnp

import galton
from galton.types import Finite


@dataclasses.dataclass(frozen=True)
class Laplace:
    """Independent Laplace distributions of scale b; what lies outside the box the environment clips."""

    mean: jax.Array
    b: jax.Array
    low: jax.Array
    high: jax.Array

    def sample(self, noise):
        return self.mean + self.b * noise

    def log_prob(self, action):
        return (-jnp.abs(action - self.mean) / self.b - jnp.log(2 * self.b)).sum(-1)

    def deterministic_action(self):
        return jnp.clip(self.mean, self.low, self.high)

    def entropy(self):
        return jnp.broadcast_to(1 + jnp.log(2 * self.b), self.mean.shape).sum(-1)

    def std(self):
        return jnp.broadcast_to(jnp.sqrt(2.0) * self.b, self.mean.shape)

    def at_edge(self, action):
        return (action < self.low) | (action > self.high)


class LaplacePolicy(galton.Policy):
    """The network gives the mean; log b is a parameter of its own."""

    label = "Laplace"

    log_b_init: Finite = 0.0
    """The first log b."""

    @property
    def n_outputs(self):
        return len(self.low)

    def init(self):
        return jnp.zeros(self.n_outputs), {"log_b": jnp.zeros(self.n_outputs) + self.log_b_init}

    def noise(self, key, shape):
        return jax.random.laplace(key, (*shape, self.n_outputs))

    def distribution(self, outputs, params):
        return Laplace(outputs, jnp.exp(params["log_b"]), self.low, self.high)


galton.POLICIES["laplace"] = LaplacePolicy

if __name__ == "__main__":
    galton.use_all_cores()
    shared = {"loss": "gaussian", "n_steps": 5, "net_arch": (), "learning_rate": 0.05}  # −log π of whatever density
    for own in ({"policy": "gaussian"}, {"policy": "laplace"}, {"policy": "laplace", "log_b_init": 1.0}):
        result = galton.train("bandit", galton.make_agent(**shared, **own), range(20), total_timesteps=2_000)
        print(f"{own}: final training return {result.final('training_return').mean():.2f} of 25")
