"""A network of your own: random Fourier features below one hidden layer. A class, and a line in NETWORKS.

Smooth networks learn slowly what changes fast with the state; features of several wavelengths help (Tancik et al.,
2020).
"""

import jax
import jax.numpy as jnp

import galton
from galton.networks import last_layer, linear
from galton.types import Count, Positive


class Fourier(galton.Network):
    """Sines and cosines of random directions, whose wavelengths are learnt too, and a layer of rectified units."""

    label = "Fourier features"

    n_waves: Count = 32
    """Random directions, each with a sine and a cosine."""
    frequency: Positive = 1.0
    """The standard deviation of the first frequencies."""
    n_units: Count = 64
    """Units of the hidden layer."""

    def init(self, key, n_in, n_out, last_scale, of_critic):
        of_waves, of_hidden, of_last = jax.random.split(key, 3)
        waves = {"kernel": self.frequency * jax.random.normal(of_waves, (n_in, self.n_waves))}
        hidden = last_layer(of_hidden, 2 * self.n_waves, self.n_units, 2**0.5)
        return [waves, hidden, last_layer(of_last, self.n_units, n_out, last_scale)]

    def features(self, layers, x):
        waves, hidden, _ = layers
        phase = x @ waves["kernel"]
        return jax.nn.relu(linear(hidden, jnp.concatenate([jnp.sin(phase), jnp.cos(phase)], -1)))


galton.NETWORKS["fourier"] = Fourier

if __name__ == "__main__":
    galton.use_all_cores()
    shared = {"loss": "hl-gauss-centred", "n_bins": 30, "eta": 2.0, "learning_rate": 2e-3, "gamma": 0.9, "n_envs": 4}
    for own in ({"network": "mlp"}, {"network": "fourier"}, {"network": "fourier", "frequency": 3.0}):
        result = galton.train("lqr", galton.make_agent(**shared, **own), range(8), total_timesteps=100_000, n_logs=10)
        print(f"{own}: final training return {result.final('training_return').mean():.2f}, the optimum is -9.77")
