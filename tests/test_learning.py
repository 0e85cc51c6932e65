"""What a small independent implementation reaches with room to spare: means over seeds, best of the learning rates."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import LOSSES, make_agent, networks, train
from galton.envs import LQR, Acrobot, Bandit

pytestmark = pytest.mark.optimised

RATES = (1e-4, 3e-4, 7e-4, 1e-3)


def best_mean(env, rates, n_seeds, steps, **words):
    """The mean final training return over seeds at the best learning rate (App. C.2's rule), no run diverged there."""
    agent = make_agent(learning_rate=np.repeat(rates, n_seeds), **words)
    seeds = list(range(n_seeds)) * len(rates)
    final = train(env, agent, seeds, steps, n_eval_episodes=0).final("training_return")
    return np.max(np.nan_to_num(final.reshape(len(rates), n_seeds).mean(1), nan=-np.inf))


@pytest.mark.parametrize("loss", LOSSES)
def test_every_loss_solves_the_bandit(loss):
    words = {"loss": loss, "eta": 0.75, "n_steps": 5, "net_arch": ()}
    assert best_mean(Bandit(), (0.01, 0.05, 0.1, 1.0), 20, 2_000, **words) > 25 - 1.5


@pytest.mark.parametrize(("loss", "floor"), [("gaussian", -18.0), ("hl-one-hot", -32.0)])
def test_lqr(loss, floor):
    assert best_mean(LQR(), RATES, 4, 300_000, loss=loss, eta=0.25) > floor


@pytest.mark.parametrize(("loss", "floor"), [("gaussian", -110.0), ("hl-one-hot", -260.0)])
def test_acrobot(loss, floor):
    assert best_mean(Acrobot(), RATES, 4, 500_000, loss=loss) > floor


@pytest.mark.parametrize("loss", ["gaussian", "hl-gauss-centred"])
def test_products_with_fewer_digits_learn_as_well(monkeypatch, loss):
    """On an accelerator one may ask for products of bfloat16, with sums in float32; by default TF32 has 3 bits more.

    In float32 the Gaussian ends at −11.0 and the head at −12.1, doing nothing is −26, and the best −9.8.
    """
    rounded = functools.partial(jax.lax.reduce_precision, exponent_bits=8, mantissa_bits=7)

    @jax.custom_vjp
    def product(x, kernel):
        return rounded(x) @ rounded(kernel)

    product.defvjp(
        lambda x, kernel: (product(x, kernel), (x, kernel)),
        lambda saved, g: (
            rounded(g) @ rounded(saved[1]).T,
            jnp.reshape(rounded(saved[0]), (-1, saved[0].shape[-1])).T @ jnp.reshape(rounded(g), (-1, g.shape[-1])),
        ),
    )
    monkeypatch.setattr(networks, "_matmul", product)
    size = (64, 61)  # of no other test, whose program would be found again
    words = {"algorithm": "ppo", "loss": loss, "n_envs": 8, "n_steps": 256, "net_arch": size}
    assert best_mean(LQR(), (1e-3,), 4, 200_000, **words) > -13.5
