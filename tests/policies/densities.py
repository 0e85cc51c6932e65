"""The policies over a box that have a density, and each as torch has it, in float64."""

import jax.numpy as jnp
import numpy as np
import torch
from torch import distributions
from torch.special import log_ndtr

from ..agents import agent

NAMES = ("clipped-gaussian", "truncated-gaussian", "squashed-gaussian", "beta")


def make(name, low, high, outputs, log_std=0.0, **numbers):
    """A policy over the box, and its distribution in units of the box: outputs as of `outputs_of`, log σ for each d.

    Under `jax.enable_x64` it computes in float64.
    """
    low, high = (np.atleast_1d(np.asarray(bound, np.float32)) for bound in (low, high))
    policy = agent({"loss": "gaussian", "policy": name, "box_units": 1.0, **numbers}, low=low, high=high).policy
    params = {"log_std": jnp.zeros(len(low)) + jnp.asarray(log_std, float)}
    return policy, policy.distribution(jnp.asarray(outputs, float), params)


def outputs_of(name, mean):
    """The network's outputs for means `[..., d]` in units of the box; Beta has two for each."""
    mean = np.asarray(mean, np.float32)
    return mean if name != "beta" else np.stack([2 * mean, 1 - mean], -1).reshape(*mean.shape[:-1], -1)


class Reference:
    """A policy over d boxes in float64, with an entry for each; the outputs and log σ may be asked for gradients."""

    def __init__(self, name, low, high, outputs, log_std):
        self.name, self.outputs, self.std = name, outputs, torch.exp(log_std)
        self.low, self.high = (torch.as_tensor(np.float32(bound).astype(np.float64)) for bound in (low, high))
        self.center, self.half = (self.low + self.high) / 2, (self.high - self.low) / 2

    def log_prob(self, action):
        """Of actions in the box; on a bound of the clipped Gaussian, the mass of the tail per half-width."""
        action = torch.as_tensor(np.asarray(action, np.float64))
        if self.name == "beta":
            steps, base = [distributions.AffineTransform(self.low, 2 * self.half)], self.beta()
            return distributions.TransformedDistribution(base, steps, validate_args=False).log_prob(action)
        if self.name == "squashed-gaussian":
            base = distributions.Normal(self.outputs, self.std)
            steps = [distributions.TanhTransform(), distributions.AffineTransform(self.center, self.half)]
            return distributions.TransformedDistribution(base, steps, validate_args=False).log_prob(action)
        mean, sigma = self.center + self.half * self.outputs, self.half * self.std
        density = distributions.Normal(mean, sigma).log_prob(action)
        below, above = (self.low - mean) / sigma, (mean - self.high) / sigma
        if self.name == "truncated-gaussian":  # from the side on which float64 has digits left
            more = torch.where(below > 0, log_ndtr(-below), log_ndtr(-above))
            less = torch.where(below > 0, log_ndtr(above), log_ndtr(below))
            return density - more - torch.log1p(-torch.exp(less - more))
        low, high = (log_ndtr(tail) - torch.log(self.half) for tail in (below, above))
        return torch.where(action <= self.low, low, torch.where(action >= self.high, high, density))

    def beta(self):
        """On [0, 1]."""
        shapes = 1 + torch.nn.functional.softplus(self.outputs.reshape(*self.outputs.shape[:-1], -1, 2))
        return distributions.Beta(shapes[..., 0], shapes[..., 1], validate_args=False)


def reference(name, low, high, outputs, log_std):
    """The same from numpy's arrays."""
    tensors = (torch.as_tensor(np.float32(x).astype(np.float64)) for x in (outputs, log_std))
    return Reference(name, np.atleast_1d(low), np.atleast_1d(high), *tensors)
