"""A softmax policy can start as the Gaussian policy does in these ways, one of which is a control of §5.2.3."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from galton.bins import Bins
from galton.policies.tails import LOG_SQRT_2PI, inside, log_tail

PerDimension = Float[Array, "*d 1"] | float


def init_gaussian_logits(bins: Bins, mean: PerDimension = 0.0, std: PerDimension = 1.0) -> Float[Array, "d k"]:
    """Init Gaussian: logits whose softmax follows N(mean, std²) on the bin centers, as the Gaussian policy starts."""
    return -0.5 * ((jnp.asarray(bins.centers) - mean) / std) ** 2


def init_clipped_gaussian_logits(bins: Bins, mean: PerDimension, std: PerDimension) -> Float[Array, "d k"]:
    """The log-mass of N(mean, std²) in each bin, all that lies below the box in the first and all above in the last.

    The softmax policy then starts with the actions that the environment makes of the Gaussian policy's.
    """
    edges = jnp.asarray(bins.edges)
    low, high = edges[:, 1:-2], edges[:, 2:-1]
    part = inside(jnp.broadcast_to(mean, low.shape), jnp.broadcast_to(std, low.shape), low, high)
    between = part.log_mass - 0.5 * part.zeta**2 - LOG_SQRT_2PI
    return jnp.concatenate(
        [log_tail((mean - edges[:, 1:2]) / std), between, log_tail((edges[:, -2:-1] - mean) / std)], -1
    )
