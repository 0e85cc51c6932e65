"""Multi-layer perceptrons as plain lists of {"kernel", "bias"}."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax.nn.initializers import orthogonal
from jaxtyping import Array, Float, Key

from galton.types import Params


def init_mlp(key: Key[Array, ""], sizes: Sequence[int], last_scale: float) -> list[Params]:
    """Orthogonal kernels of scale √2, the last of `last_scale`, and zero biases: layers sizes[0] → … → sizes[-1].

    Not under vmap: two batched QR kernels in one program can wait for each other for ever in jaxlib 0.10.2.
    """
    scales = [2**0.5] * (len(sizes) - 2) + [last_scale]
    keys = jax.random.split(key, len(scales))
    return [
        {"kernel": orthogonal(scale)(key, (n_in, n_out)), "bias": jnp.zeros(n_out)}
        for key, scale, n_in, n_out in zip(keys, scales, sizes[:-1], sizes[1:], strict=True)
    ]


def features(layers: list[Params], x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch hidden"]:
    """f_φ(s): what the last layer sees (§4.3)."""
    for layer in layers[:-1]:
        x = jnp.tanh(x @ layer["kernel"] + layer["bias"])
    return x


def mlp(layers: list[Params], x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch n_out"]:
    """Tanh layers and a linear one."""
    outputs: Array = features(layers, x) @ layers[-1]["kernel"] + layers[-1]["bias"]
    return outputs
