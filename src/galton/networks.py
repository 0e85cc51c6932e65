"""Networks by name: what becomes of an observation before the last, linear layer of an actor or a critic.

A new one is a class of this kind, with the settings that it needs, and a line in NETWORKS.
"""

import abc
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal

import jax
import jax.numpy as jnp
from jax import lax
from jax.nn.initializers import he_normal, lecun_normal, orthogonal
from jaxtyping import Array, Float, Key

from galton.parts import Part
from galton.theory import output_lipschitz
from galton.types import Count, Params

Layers = list[Any]
"""The parameters of a network, layer by layer, each a pytree; the last are those of the linear one (`linear`)."""
Activation = Callable[[Array], Array]
ACTIVATIONS: dict[str, Activation] = {"tanh": jnp.tanh, "relu": jax.nn.relu, "elu": jax.nn.elu, "silu": jax.nn.silu}


class Network(Part, abc.ABC):
    """Two networks of a kind, one for the actor and one for the critic, which share nothing."""

    @abc.abstractmethod
    def init(self, key: Key[Array, ""], n_in: int, n_out: int, last_scale: float, of_critic: bool) -> Layers:
        """New parameters of one of the two.

        Args:
            key: of all that is random in them.
            n_in: numbers of an observation.
            n_out: outputs.
            last_scale: of the last kernel, as `last_layer` takes it.
            of_critic: whether they are the critic's.
        """

    @abc.abstractmethod
    def features(self, layers: Layers, x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch hidden"]:
        """f_φ(s): what the last layer sees (§4.3)."""

    def __call__(self, layers: Layers, x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch n_out"]:
        """The network gives n_out numbers for each row of inputs."""
        return linear(layers[-1], self.features(layers, x))

    def lipschitz(self, layers: Layers, observation: Float[Array, " o"]) -> Float[Array, ""] | None:
        """The least l with ‖∇_φ w_jᵀ f_φ(s)‖ ≤ l for every output j; None for a network of which nobody has said it."""
        return None


class MLP(Network):
    """Hidden layers of units, each with its activation."""

    label: ClassVar[str] = "MLP"

    net_arch: tuple[Count, ...] = (64, 64)
    """Units of the hidden layers, the same for actor and critic unless critic_arch says otherwise; () is linear."""
    critic_arch: tuple[Count, ...] | None = None
    """Units of the critic's hidden layers; by default those of net_arch. With SimBa the critic is then such an MLP with
    tanh, and by default a SimBa too."""
    activation: Literal["tanh", "relu", "elu", "silu"] = "tanh"
    """The activation function of the hidden units."""
    kernel_init: Literal["orthogonal", "lecun"] = "orthogonal"
    """The initialisation of the kernels of hidden layers: orthogonal of scale √2, or LeCun's normal one."""

    def init(self, key: Key[Array, ""], n_in: int, n_out: int, last_scale: float, of_critic: bool) -> Layers:
        """New layers (see `init_mlp`)."""
        hidden = self.critic_arch if of_critic and self.critic_arch is not None else self.net_arch
        return init_mlp(key, (n_in, *hidden, n_out), last_scale, self.kernel_init)

    def features(self, layers: Layers, x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch hidden"]:
        """The units of the last hidden layer."""
        return features(layers, x, ACTIVATIONS[self.activation])

    def lipschitz(self, layers: Layers, observation: Float[Array, " o"]) -> Float[Array, ""]:
        """The l of Propositions 1 and 2, by backpropagation of all outputs at once."""
        return output_lipschitz(layers, observation, ACTIVATIONS[self.activation])


class SimBa(Network):
    """SimBa's body (Lee et al., 2024): a linear layer, residual blocks of a normalised MLP, and a layer norm.

    What it does besides to observations, running statistics, is `normalize_observation`.
    """

    label: ClassVar[str] = "SimBa"

    simba_width: Count = 128
    """Units of the actor's residual stream; each block has four times as many inside."""
    simba_blocks: Count = 1
    """Residual blocks of the actor."""
    simba_critic_width: Count = 512
    """Units of the critic's residual stream."""
    simba_critic_blocks: Count = 2
    """Residual blocks of the critic."""
    critic_arch: tuple[Count, ...] | None = None
    """Units of the critic's hidden layers, where it is to be an MLP with tanh."""

    def init(self, key: Key[Array, ""], n_in: int, n_out: int, last_scale: float, of_critic: bool) -> Layers:
        """The first layer orthogonal, blocks by He et al. (2015), norms neutral."""
        if of_critic and self.critic_arch is not None:
            return init_mlp(key, (n_in, *self.critic_arch, n_out), last_scale)
        width = self.simba_critic_width if of_critic else self.simba_width
        n_blocks = self.simba_critic_blocks if of_critic else self.simba_blocks
        first, last, *keys = jax.random.split(key, 2 + 2 * n_blocks)
        norm = {"scale": jnp.ones(width), "bias": jnp.zeros(width)}
        blocks = [
            {
                "norm": norm,
                "up": {"kernel": he_normal()(up, (width, 4 * width)), "bias": jnp.zeros(4 * width)},
                "down": {"kernel": he_normal()(down, (4 * width, width)), "bias": jnp.zeros(width)},
            }
            for up, down in zip(keys[::2], keys[1::2], strict=True)
        ]
        embedding = {"kernel": orthogonal()(first, (n_in, width)), "bias": jnp.zeros(width)}
        return [embedding, *blocks, norm, last_layer(last, width, n_out, last_scale)]

    def features(self, layers: Layers, x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch hidden"]:
        """The normalised sum of all blocks, or the last hidden units of a critic that is an MLP."""
        if all("kernel" in layer for layer in layers):
            return features(layers, x)
        embedding, *blocks, norm, _ = layers
        x = linear(embedding, x)
        for block in blocks:
            x = x + linear(block["down"], jax.nn.relu(linear(block["up"], layer_norm(block["norm"], x))))
        return layer_norm(norm, x)


class FlaxNetwork(Network):
    """A network whose body is a Flax module, of one kind for actor and critic."""

    @property
    @abc.abstractmethod
    def module(self) -> Any:
        """The module, which gives features `[*batch, hidden]` and draws nothing.

        Anything with `init(key, x)` and `apply(variables, x)` will do.
        """

    def init(self, key: Key[Array, ""], n_in: int, n_out: int, last_scale: float, of_critic: bool) -> Layers:
        """The module's own first variables, in float32 as all that is learnt, and a last layer on its features."""
        first, last = jax.random.split(key)
        x = jnp.zeros(n_in)
        variables = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), self.module.init(first, x))
        n_features = jax.eval_shape(self.module.apply, variables, x).shape[-1]
        return [variables, last_layer(last, n_features, n_out, last_scale)]

    def features(self, layers: Layers, x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch hidden"]:
        """The features are what the module makes of the inputs."""
        return jnp.asarray(self.module.apply(layers[0], x), float)


NETWORKS: dict[str, type[Network]] = {"mlp": MLP, "simba": SimBa}


def last_layer(key: Key[Array, ""], n_in: int, n_out: int, scale: float) -> Params:
    """A linear layer with an orthogonal kernel of this scale and zero biases.

    Not under vmap on a CPU: two batched QR kernels in one program can wait for each other for ever in jaxlib 0.10.2.
    """
    return {"kernel": orthogonal(scale)(key, (n_in, n_out)), "bias": jnp.zeros(n_out)}


def init_mlp(
    key: Key[Array, ""], sizes: Sequence[int], last_scale: float, kernel_init: str = "orthogonal"
) -> list[Params]:
    """Layers sizes[0] → … → sizes[-1]: hidden kernels orthogonal of scale √2 or LeCun's, and a last layer."""
    keys = jax.random.split(key, len(sizes) - 1)
    hidden = orthogonal(2**0.5) if kernel_init == "orthogonal" else lecun_normal()
    layers = [
        {"kernel": hidden(key, (n_in, n_out)), "bias": jnp.zeros(n_out)}
        for key, n_in, n_out in zip(keys[:-1], sizes[:-2], sizes[1:-1], strict=True)
    ]
    return [*layers, last_layer(keys[-1], sizes[-2], sizes[-1], last_scale)]


def features(
    layers: list[Params], x: Float[Array, "*batch n_in"], activation: Activation = jnp.tanh
) -> Float[Array, "*batch hidden"]:
    """f_φ(s) of an MLP: what its last layer sees (§4.3)."""
    for layer in layers[:-1]:
        x = activation(linear(layer, x))
    return x


def mlp(
    layers: list[Params], x: Float[Array, "*batch n_in"], activation: Activation = jnp.tanh
) -> Float[Array, "*batch n_out"]:
    """The outputs of an MLP: hidden layers, then a linear one."""
    return linear(layers[-1], features(layers, x, activation))


def layer_norm(layer: Params, x: Float[Array, "*batch n"]) -> Float[Array, "*batch n"]:
    """Each row with mean 0 and variance 1, scaled and moved as has been learnt (Ba et al., 2016), with ε = 1e-6."""
    centered = x - x.mean(-1, keepdims=True)
    normal: Array = centered * lax.rsqrt((centered**2).mean(-1, keepdims=True) + 1e-6)
    return normal * layer["scale"] + layer["bias"]


def linear(layer: Params, x: Float[Array, "*batch n_in"]) -> Float[Array, "*batch n_out"]:
    """The outputs of one layer without its activation."""
    product = _matmul if jax.default_backend() == "cpu" else jnp.matmul
    outputs: Array = product(jnp.asarray(x), jnp.asarray(layer["kernel"])) + layer["bias"]
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
