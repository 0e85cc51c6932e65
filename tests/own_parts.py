"""A critic and an optimizer of one's own, each with a setting, as somebody would register them in a file of theirs."""

import jax.numpy as jnp
import optax

import galton
from galton.critics import SquaredErrorCritic
from galton.types import Positive, Share


class Huber(SquaredErrorCritic):
    """One output, the value. Large errors count linearly."""

    label = "Huber"

    huber_delta: Positive = 1.0
    """The error from which on the loss is linear."""

    def loss(self, outputs, returns):
        error = jnp.abs(returns - self.value(outputs))
        inside = jnp.minimum(error, self.huber_delta)
        return inside * (2 * error - inside)


class Lion(galton.Optimizer):
    """Lion of Optax, which keeps a count of steps, with a memory of its own."""

    label = "Lion"

    lion_memory: Share = 0.99
    """The share of the momentum that stays."""

    @property
    def transformation(self):
        return optax.scale_by_lion(b2=self.lion_memory)


galton.CRITICS["huber"] = Huber
galton.OPTIMIZERS["lion"] = Lion
