"""A Gaussian whose dimensions are correlated: its covariance is a parameter, the same in every state."""

import dataclasses
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float

from galton.policies.gaussian import Gaussian, GaussianHead
from galton.types import Params


@dataclasses.dataclass(frozen=True)
class FullGaussian(Gaussian):
    """N(mean, L Lᵀ) with the lower triangular factor L, unbounded: the environment clips what leaves the box.

    `log_std` is the logarithm of the diagonal of L; where no two dimensions are correlated this is log σ, and
    `sigma` is σ.
    """

    lower: Float[Array, " n"] = dataclasses.field(kw_only=True)
    """The d (d − 1) / 2 entries of L below its diagonal, row after row, in units of `unit`."""

    @property
    def factor(self) -> Float[Array, "*states d d"]:
        """L in units of `unit`."""
        d = self.mean.shape[-1]
        diagonal = jnp.exp(self.log_std)[..., None] * jnp.eye(d)
        return diagonal + jnp.zeros((d, d)).at[np.tril_indices(d, -1)].set(self.lower)

    def in_sigmas(self, distance: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """The z of a distance L z, which is standard normal for what `sample` gives."""
        factor = self.factor
        inverse = solve_triangular(factor, jnp.broadcast_to(jnp.eye(factor.shape[-1]), factor.shape), lower=True)
        return _product(inverse, distance / self.unit)

    def sample(self, noise: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """The mean plus L times standard normal noise."""
        return self.mean + _product(self.factor, noise) * self.unit

    def std(self) -> Float[Array, "*batch d"]:
        """The standard deviation of each dimension, whatever the others are."""
        std = jnp.sqrt((self.factor**2).sum(-1)) * self.unit
        return jnp.broadcast_to(std, self.mean.shape)

    def _kl_of_std(self, other: "FullGaussian") -> Float[Array, "*states"]:
        """½ (‖M‖² − d) + Σ_l log L'_ll − log L_ll with M = L'⁻¹ L."""
        columns = jnp.moveaxis(self.factor * jnp.reshape(self.unit, (-1, 1)), -1, 0)
        squares = sum((other.in_sigmas(column) ** 2).sum(-1) for column in columns)
        return 0.5 * (squares - self.mean.shape[-1]) + (other.log_sigma - self.log_sigma).sum(-1)


def _product(matrix: Float[Array, "*#batch d d"], vector: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
    """The product in full precision, which a matrix product of an accelerator hasn't."""
    return (matrix * vector[..., None, :]).sum(-1)


class FullGaussianPolicy(GaussianHead):
    """A Gaussian with a full covariance matrix, which starts as the Gaussian policy; the environment clips its actions.

    The covariance L Lᵀ is learned by its Cholesky factor L: `log_std`, the logarithm of the diagonal, and `lower`, the
    entries below it, which start at 0. With state_dependent_std the network gives the diagonal.
    """

    label: ClassVar[str] = "full Gaussian"
    has_kl: ClassVar[bool] = True

    def init(self) -> tuple[Float[Array, " n_outputs"], Params]:
        """Mean 0 and L = exp(log_std_init) times the identity, in the policy's units."""
        outputs, params = super().init()
        d = len(self._box.low)
        return outputs, params | {"lower": jnp.zeros(d * (d - 1) // 2)}

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> FullGaussian:
        """The Gaussian with these means, as the parameters say."""
        own = self.gaussian(outputs, params)
        return FullGaussian(own.mean, own.log_std, self.low, self.high, own.unit, lower=params["lower"])
