"""A schedule of your own: a number that rises and falls again and again. A class, and a line in SCHEDULES.

Any number of an agent may be a schedule over environment steps. Here it is the learning rate, as a constant, as a
schedule of Galton's and as the new one.
"""

import jax.numpy as jnp

import galton
from galton.schedules import SCHEDULES, Linear, Schedule, Steps
from galton.types import Finite


class Cyclic(Schedule):
    """A triangle between two numbers (Smith, 2017)."""

    label = "cyclic"

    low: Finite = 0.0
    """The number at the start of each cycle."""
    high: Finite = 0.0
    """The number in the middle of each cycle."""
    length: Steps = 1_000.0
    """Environment steps of a cycle."""

    def values(self):
        return self.low, self.high

    def __call__(self, step):
        share = step / jnp.asarray(self.length) % 1.0
        return self.low + (jnp.asarray(self.high) - self.low) * (1 - jnp.abs(2 * share - 1))


SCHEDULES["cyclic"] = Cyclic

if __name__ == "__main__":
    galton.use_all_cores()
    for rate in (0.05, Linear(0.1, 0.0), Cyclic(0.0, 0.1, 500), "cyclic(0, 0.1, 500)"):
        agent = galton.make_agent(loss="hl-one-hot", n_bins=50, n_steps=5, net_arch=(), learning_rate=rate)
        result = galton.train("bandit", agent, range(20), total_timesteps=2_000)
        print(f"{rate}: final training return {result.final('training_return').mean():.2f} of 25")
