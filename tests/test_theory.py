import jax
import jax.numpy as jnp
import pytest

from galton import targets, theory
from galton.networks import features, init_mlp, mlp

K = 25


def network(seed, outputs):
    return init_mlp(jax.random.key(seed), (3, 16, 16, outputs), last_scale=1.0)


def gradient_norm(loss, layers):
    """In the hidden layers and the last kernel: the paper's θ."""
    gradient = jax.grad(loss)(layers)
    leaves = jax.tree.leaves((gradient[:-1], gradient[-1]["kernel"]))
    return float(jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in leaves)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("eta", [0.1, 0.75, 4.0])
def test_proposition_1_holds(seed, eta):
    layers, s = network(seed, K), jax.random.normal(jax.random.key(seed), (3,))
    q = targets.hl_gauss_of_center(K, jnp.array(seed), eta)
    norm = gradient_norm(lambda p: -2.5 * jnp.sum(q * jax.nn.log_softmax(mlp(p, s))), layers)
    slope = jax.nn.softmax(mlp(layers, s)) - q  # eq. 7's last factor is the sum of its sizes
    bound = theory.gradient_bound(jnp.array(-2.5), theory.output_lipschitz(layers, s), features(layers, s), slope)
    assert 0 < norm <= float(bound) * (1 + 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("sigma", [0.05, 1.0, 3.0])
def test_proposition_2_holds_in_both_readings(seed, sigma):
    layers, s, action = network(seed, 1), jax.random.normal(jax.random.key(seed), (3,)), 0.7
    lipschitz, f, mean = theory.output_lipschitz(layers, s), features(layers, s), mlp(layers, s)[0]
    for scale in (sigma, sigma**2):
        norm = gradient_norm(lambda p, scale=scale: 3.0 * (action - mlp(p, s)[0]) ** 2 / (2 * scale), layers)
        bound = theory.regression_bound(3.0, lipschitz, f, action, mean, scale)
        assert 0 < norm <= float(bound) * (1 + 1e-5)
