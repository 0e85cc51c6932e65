"""The bounds on the gradient norm of one sample's loss, for one action dimension (§4.3, Apps A and B).

The parameters θ are those of the hidden layers, φ, and the kernel of the last, w; biases of the last layer are
not among them, as in the paper.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from galton.networks import mlp
from galton.types import Params

Scalar = float | Float[Array, ""]


def output_lipschitz(layers: list[Params], observation: Float[Array, " o"]) -> Float[Array, ""]:
    """The least l with ‖∇_φ w_jᵀ f_φ(s)‖ ≤ l for every output j at this observation."""
    jacobian = jax.jacrev(lambda hidden: mlp([*hidden, layers[-1]], observation))(layers[:-1])
    flat = jnp.concatenate([leaf.reshape(len(leaf), -1) for leaf in jax.tree.leaves(jacobian)], axis=1)
    return jnp.max(jnp.linalg.norm(flat, axis=1))


def classification_bound(
    advantage: Scalar,
    lipschitz: Scalar,
    features: Float[Array, " hidden"],
    target: Float[Array, " k"],
    probs: Float[Array, " k"],
) -> Float[Array, ""]:
    """Proposition 1, eq. 7: |A| (l + ‖f‖) Σ_i |q_i − π_i|; the last factor is at most 2."""
    distance = jnp.abs(target - probs).sum()
    bound: Array = distance * jnp.abs(advantage) * (lipschitz + jnp.linalg.norm(features))
    return bound


def regression_bound(
    advantage: Scalar,
    lipschitz: Scalar,
    features: Float[Array, " hidden"],
    action: Scalar,
    mean: Scalar,
    scale: Scalar,
) -> Float[Array, ""]:
    """Proposition 2, eq. 8: |A| (l + ‖f‖) |a − μ| / scale.

    The paper divides the squared error by 2σ, so its scale is σ; for the Gaussian's own log-likelihood, which
    divides by 2σ², it is σ².
    """
    bound: Array = (
        jnp.abs(jnp.asarray(action - mean) / scale) * jnp.abs(advantage) * (lipschitz + jnp.linalg.norm(features))
    )
    return bound
