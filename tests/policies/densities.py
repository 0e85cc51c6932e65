"""The policies over a box that have a density, and each as scipy and torch have it in one dimension and in float64."""

import jax.numpy as jnp
import numpy as np
import torch
from scipy import stats
from torch import distributions

from galton import POLICIES, Config, Hypers

BOXES = [(-1.0, 1.0), (-3.0, 1.0), (2.0, 2.5), (-1e-3, 1e-3), (0.0, 1e4), (-400.0, 1.0)]
NAMES = ("clipped-gaussian", "truncated-gaussian", "squashed-gaussian", "beta")
N_OUTPUTS = {"beta": 2}


def make(name, low, high, outputs, log_std=0.0, **numbers):
    """The distribution of a policy in units of its box: outputs `[..., d]`, or `[..., 2d]` for Beta."""
    low, high = (np.atleast_1d(np.asarray(bound, np.float32)) for bound in (low, high))
    policy = POLICIES[name].create(Config(loss="gaussian", policy=name), low, high)
    params = {"log_std": jnp.zeros(len(low)) + jnp.asarray(log_std, jnp.float32)}
    hypers = Hypers(box_units=1.0, **numbers)
    return policy, policy.distribution(jnp.asarray(outputs, jnp.float32), params, hypers)


class Reference:
    """One dimension of a policy in float64, from its outputs and log σ, which may be tensors with a gradient."""

    def __init__(self, name, low, high, outputs, log_std):
        self.name, self.low, self.high = name, low, high
        self.outputs, self.std = outputs, torch.exp(log_std)
        self.center, self.half = (high + low) / 2, (high - low) / 2
        self.mean = self.center + self.half * outputs[..., 0]

    def log_prob(self, action):
        """Of actions in the box; on a bound of the clipped Gaussian, the mass of the tail per half-width."""
        action = torch.as_tensor(action, dtype=torch.float64)
        sigma = self.half * self.std
        normal = distributions.Normal(self.mean, sigma)
        if self.name == "clipped-gaussian":
            low = torch.special.log_ndtr((self.low - self.mean) / sigma) - np.log(self.half)
            high = torch.special.log_ndtr((self.mean - self.high) / sigma) - np.log(self.half)
            inside = normal.log_prob(action)
            return torch.where(action <= self.low, low, torch.where(action >= self.high, high, inside))
        if self.name == "truncated-gaussian":
            ends = ((bound - self.mean) / sigma for bound in (self.low, self.high))
            low, high = (torch.special.ndtr(end) for end in ends)
            return normal.log_prob(action) - torch.log(high - low)
        steps = [distributions.AffineTransform(self.center, self.half)]
        if self.name == "squashed-gaussian":
            base = distributions.Normal(self.outputs[..., 0], self.std)
            return distributions.TransformedDistribution(base, [distributions.TanhTransform(), *steps]).log_prob(action)
        steps = [distributions.AffineTransform(self.low, self.high - self.low)]
        shapes = 1 + torch.nn.functional.softplus(self.outputs)
        base = distributions.Beta(shapes[..., 0], shapes[..., 1], validate_args=False)
        return distributions.TransformedDistribution(base, steps, validate_args=False).log_prob(action)

    def scipys(self):
        """A frozen distribution of scipy's, of the numbers that this one has; of the squashed one, that of artanh."""
        outputs, std = self.outputs.detach().numpy(), float(self.std)
        if self.name == "beta":
            shapes = 1 + np.logaddexp(0, outputs)
            return stats.beta(shapes[0], shapes[1], self.low, self.high - self.low)
        mean = self.center + self.half * outputs[0]
        if self.name == "squashed-gaussian":
            return stats.norm(outputs[0], std)
        if self.name == "clipped-gaussian":
            return stats.norm(mean, self.half * std)
        ends = ((bound - mean) / (self.half * std) for bound in (self.low, self.high))
        return stats.truncnorm(*ends, mean, self.half * std)


def reference(name, low, high, outputs, log_std):
    """The same with numbers for tensors."""
    return Reference(name, low, high, *(torch.as_tensor(np.asarray(x, np.float64)) for x in (outputs, log_std)))
