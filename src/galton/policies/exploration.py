"""The two controls of §5.2.3: does classification win by exploring differently?"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from galton.bins import Bins


def init_gaussian_logits(bins: Bins, mean: float = 0.0, std: float = 1.0) -> Float[Array, "d k"]:
    """Init Gaussian: logits whose softmax follows N(mean, std²) on the bin centers, as the Gaussian policy starts."""
    return -0.5 * ((jnp.asarray(bins.centers) - mean) / std) ** 2


def gaussian_action(
    bins: Bins, probs: Float[Array, "*batch d k"], noise: Float[Array, "*batch d"]
) -> Float[Array, "*batch d"]:
    """Gaussian Exploration: an action from the Gaussian with the mean and variance of the bin centers under the policy.

    Unclipped; `noise` is standard normal.
    """
    mean = (probs * bins.centers).sum(-1)
    variance = (probs * (bins.centers - mean[..., None]) ** 2).sum(-1)
    return mean + jnp.sqrt(variance) * noise
