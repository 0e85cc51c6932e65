"""The bounds on the gradient norm of one sample's loss, for one action dimension (§4.3, Apps A and B).

The parameters θ are those of the hidden layers, φ, and the kernel of the last, w; biases of the last layer are
not among them, as in the paper.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from galton.types import Params

Scalar = float | Float[Array, ""]


def output_lipschitz(
    layers: list[Params], observation: Float[Array, " o"], activation: Callable[[Array], Array] = jnp.tanh
) -> Float[Array, ""]:
    """The least l with ‖∇_φ w_jᵀ f_φ(s)‖ ≤ l for every output j of an MLP at this observation.

    Backpropagation of all outputs at once: layer by layer, the gradient of output j is an outer product of row j times
    the slopes and what the layer saw, and its norm is that of its factors.
    """
    hidden, slopes = [observation], []
    for layer in layers[:-1]:
        total = hidden[-1] @ layer["kernel"] + layer["bias"]
        hidden.append(activation(total))
        slopes.append(1 - hidden[-1] ** 2 if activation is jnp.tanh else jax.vmap(jax.grad(activation))(total))
    backward = layers[-1]["kernel"].T
    squares = jnp.zeros(len(backward))
    for layer, below, slope in zip(layers[-2::-1], hidden[-2::-1], slopes[::-1], strict=True):
        squares = squares + backward**2 @ slope**2 * (1 + below @ below)
        backward = backward @ (slope[:, None] * layer["kernel"].T)
    return jnp.sqrt(squares.max())


def gradient_bound(
    advantage: Float[Array, ""],
    lipschitz: Float[Array, ""],
    features: Float[Array, " hidden"],
    output_gradient: Float[Array, " outputs"],
) -> Float[Array, ""]:
    """Both propositions, for any loss: ``|A| (l + ‖f‖) ‖∂loss/∂outputs‖₁`` bounds the gradient.

    With a softmax's logits as the outputs their gradient is π − q, and this is Proposition 1, eq. 7, summed over
    action dimensions: ``|A| (l + ‖f‖) Σ_i |q_i − π_i|``. With a Gaussian's mean it is Proposition 2 with scale σ².
    """
    bound: Array = jnp.abs(advantage) * (lipschitz + jnp.linalg.norm(features)) * jnp.abs(output_gradient).sum()
    return bound


def regression_bound(
    advantage: Scalar,
    lipschitz: Scalar,
    features: Float[Array, " hidden"],
    action: Scalar,
    mean: Scalar,
    scale: Scalar,
) -> Float[Array, ""]:
    """Proposition 2, eq. 8: ``|A| (l + ‖f‖) |a − μ| / scale`` bounds the gradient.

    The paper divides the squared error by 2σ, so its scale is σ; for the Gaussian's own log-likelihood, which
    divides by 2σ², it is σ².
    """
    return gradient_bound(
        jnp.asarray(advantage), jnp.asarray(lipschitz), features, jnp.asarray([(action - mean) / scale])
    )
