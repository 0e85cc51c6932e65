"""What a small independent implementation reaches with room to spare: means over seeds, best of the learning rates."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import LOSSES, make_agent, networks, train
from galton.algorithms import actor_critic
from galton.envs import LQR, Acrobot, Bandit, RidgeBandit, XorBandit
from galton.parts import Box

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


ON_XOR = {"n_bins": 10, "n_steps": 200, "net_arch": (), "learning_rate": 0.03, "decay_steps": 200_000}


@pytest.mark.parametrize("policy", ["histogram", "joint", "autoregressive"])
def test_heads_that_correlate_actions_reach_the_optimum_and_the_factored_softmax_its_bound(policy):
    """E r + α H by enumeration; the best factored policy is .168 below the best of all."""
    env, alpha = XorBandit(), 0.25
    agent = make_agent(policy=policy, loss="hl-one-hot", ent_coef=alpha, **ON_XOR)
    learner = train(env, agent, range(5), 200_000, n_eval_episodes=0).learner
    agent = agent.on(Box.of(env.action_low, env.action_high))
    axis = (np.arange(10) - 4.5) / 5
    cells = jnp.asarray(np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 1, 2), jnp.float32)

    def log_probs(params):
        return jax.vmap(actor_critic.distribution(agent, params, jnp.ones((1, 1))).log_prob)(cells)[:, 0]

    found = np.asarray(jax.lax.map(log_probs, learner.params), np.float64)
    probs, worth = np.exp(found), np.prod(cells[:, 0], -1) < 0
    np.testing.assert_allclose(probs.sum(1), 1, rtol=1e-4)
    values = (probs * (worth - alpha * found)).sum(1)
    bound = env.factored_optimum(alpha, 10) if policy == "histogram" else env.soft_optimum(alpha, 10)
    assert (values < bound + 1e-4).all()
    assert (values > bound - 0.02).all()


@pytest.mark.parametrize("policy", ["gaussian", "full-gaussian"])
def test_a_full_covariance_finds_the_ridge_and_a_diagonal_one_its_bound(policy):
    """E r + α h in closed form; the best diagonal Gaussian is .075 below the best of all."""
    env, alpha = RidgeBandit(across=16.0), 0.1
    words = {"policy": policy, "loss": "gaussian", "ent_coef": alpha, "log_std_init": -1.0}
    numbers = {name: number for name, number in ON_XOR.items() if name != "n_bins"}
    result = train(env, make_agent(**words, **numbers), range(5), 200_000, n_eval_episodes=0)
    params = jax.device_get(result.learner.params)
    means = params["actor"][-1]["kernel"][:, 0] + params["actor"][-1]["bias"]
    for i, (mean, log_std) in enumerate(zip(means, params["log_std"], strict=True)):
        factor = np.diag(np.exp(log_std.astype(np.float64)))
        factor[1, 0] = params["lower"][i, 0] if policy == "full-gaussian" else 0.0
        cost = np.trace(env.curvature @ factor @ factor.T) + (mean - 0.2) @ env.curvature @ (mean - 0.2)
        value = -0.5 * cost + alpha * (np.log(2 * np.pi * np.e) + log_std.sum())
        bound = env.factored_optimum(alpha) if policy == "gaussian" else env.soft_optimum(alpha)
        assert bound - 0.005 < value < bound + 1e-6
