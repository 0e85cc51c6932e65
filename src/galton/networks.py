"""Multi-layer perceptrons as plain lists of {"kernel", "bias"}."""

from collections.abc import Sequence
from typing import ClassVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.nn.initializers import orthogonal
from jaxtyping import Array, Float, Key

from galton.parts import Part
from galton.types import Count, Params


class MLP(Part):
    """A multi-layer perceptron for the actor and another for the critic: hidden tanh layers, then a linear one."""

    label: ClassVar[str] = "MLP"

    net_arch: tuple[Count, ...] = (64, 64)
    """Units of the hidden layers, the same for actor and critic; () is linear."""

    def init(self, key: Key[Array, ""], n_in: int, n_out: int, last_scale: float) -> list[Params]:
        """New layers (see `init_mlp`)."""
        return init_mlp(key, (n_in, *self.net_arch, n_out), last_scale)

    def __call__(self, params: list[Params], x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch n_out"]:
        """The network gives n_out numbers for each row of inputs."""
        return mlp(params, x)


def init_mlp(key: Key[Array, ""], sizes: Sequence[int], last_scale: float) -> list[Params]:
    """Orthogonal kernels of scale √2, the last of `last_scale`, and zero biases: layers sizes[0] → … → sizes[-1].

    Not under vmap on a CPU: two batched QR kernels in one program can wait for each other for ever in jaxlib 0.10.2.
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
        x = jnp.tanh(linear(layer, x))
    return x


def mlp(layers: list[Params], x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch n_out"]:
    """The network's outputs: tanh layers, then a linear one."""
    return linear(layers[-1], features(layers, x))


def linear(layer: Params, x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch n_out"]:
    """The outputs of one layer without its activation."""
    outputs: Array = _matmul(jnp.asarray(x), jnp.asarray(layer["kernel"])) + layer["bias"]
    return outputs


@jax.custom_vjp
def _matmul(x: Float[Array, "*batch n"], kernel: Float[Array, "n m"]) -> Float[Array, "*batch m"]:
    """X W, whose backward pass is cheap on a CPU: XLA is slow at a product with a transposed kernel, not at a copy."""
    return x @ kernel


def _matmul_forward(
    x: Float[Array, "*batch n"], kernel: Float[Array, "n m"]
) -> tuple[Float[Array, "*batch m"], tuple[Array, Array]]:
    return x @ kernel, (x, kernel)


def _matmul_backward(saved: tuple[Array, Array], g: Float[Array, "*batch m"]) -> tuple[Array, Array]:
    x, kernel = saved
    g = lax.optimization_barrier(g)  # else it is computed again inside both products
    rows, columns = x.reshape(-1, x.shape[-1]), g.reshape(-1, g.shape[-1])
    return g @ lax.optimization_barrier(kernel.T), rows.T @ columns


_matmul.defvjp(_matmul_forward, _matmul_backward)
