import jax
import jax.numpy as jnp
import numpy as np
import pytest

import galton
from galton.algorithms import actor_critic, minibatches
from galton.parts import Box
from galton.types import Transition

from .rollouts import setup

PARTS = actor_critic.Objective(*jnp.zeros(4))
"""Of the objective whose gradient is stepped along, which moves nothing by itself."""


@jax.jit
def step(agent, learner, gradient, going=None):
    return actor_critic.step(agent, learner, gradient, PARTS, *[] if going is None else [going])


def test_the_networks_start_orthogonal_with_sb3s_scales_and_apart():
    _, learner, _ = setup("hl-one-hot")
    for name, last in (("actor", 0.01), ("critic", 1.0)):
        for layer, scale in zip(learner.params[name], (2**0.5, 2**0.5, last), strict=True):
            singular = np.linalg.svd(layer["kernel"], compute_uv=False)
            np.testing.assert_allclose(singular, scale, rtol=1e-4)
            assert (np.asarray(layer["bias"]) == 0).all()
    for actor, critic in zip(learner.params["actor"][:-1], learner.params["critic"][:-1], strict=True):
        assert np.abs(actor["kernel"] - critic["kernel"]).min() > 0


def test_init_gaussian_enters_as_the_last_bias():
    agent, learner, _ = setup("hl-gauss", initial_policy="gaussian")
    bias, _ = agent.policy.init()
    np.testing.assert_array_equal(learner.params["actor"][-1]["bias"], bias)
    assert float(jnp.abs(bias).max()) > 0


def test_a_step_along_a_gradient_that_is_not_finite_moves_no_parameter_and_the_norm_tells():
    agent, learner, _ = setup("gaussian")
    gradient = jax.tree.map(jnp.ones_like, learner.params)
    learner, _ = step(agent, learner, gradient)  # Adam has some momentum
    gradient["critic"][0]["bias"] = gradient["critic"][0]["bias"].at[0].set(jnp.inf)
    after, told = step(agent, learner, gradient)
    assert not np.isfinite(told["grad_norm"])
    jax.tree.map(np.testing.assert_array_equal, after.params, learner.params)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(after.optimizer))


def test_where_training_is_left_off_a_step_changes_nothing_at_all():
    agent, learner, _ = setup("gaussian")
    gradient = jax.tree.map(jnp.ones_like, learner.params)
    for going in (False, True):
        after, _ = step(agent, learner, gradient, jnp.array(going))
        same = jax.tree.map(lambda a, b: bool((a == b).all()), after, learner)
        assert all(jax.tree.leaves(same)) == (not going)


def test_the_gaussians_sigma_is_clipped_with_the_actor():
    agent, learner, _ = setup("gaussian", max_grad_norm=0.5, clip_separately=True)
    gradient = jax.tree.map(jnp.zeros_like, learner.params) | {"log_std": jnp.array([3.0, 4.0])}
    after, _ = step(agent, learner, gradient)
    np.testing.assert_allclose(after.optimizer.mu["log_std"], [0.03, 0.04], rtol=1e-4)


def test_a_short_gradient_is_taken_as_it_is():
    agent, learner, _ = setup("gaussian", max_grad_norm=0.5)
    gradient = jax.tree.map(lambda leaf: jnp.full_like(leaf, 1e-4), learner.params)
    after, _ = step(agent, learner, gradient)
    jax.tree.map(lambda moment: np.testing.assert_allclose(moment, 1e-5, rtol=1e-5), after.optimizer.mu)


def test_actor_and_critic_are_clipped_apart_or_joined():
    """After one step Adam's first moment is a tenth of the gradient that it was given."""
    for separately, norms in ((False, {"actor": 5.0, "critic": 5.0}), (True, {"actor": 3.0, "critic": 4.0})):
        agent, learner, _ = setup("hl-gauss", max_grad_norm=0.5, clip_separately=separately)
        size = {name: sum(leaf.size for leaf in jax.tree.leaves(learner.params[name])) for name in norms}
        long = {"actor": 3.0, "critic": 4.0}
        gradient = {
            name: jax.tree.map(lambda leaf, x=long[name] / size[name] ** 0.5: jnp.full_like(leaf, x), part)
            for name, part in learner.params.items()
        }
        after, told = step(agent, learner, gradient)
        np.testing.assert_allclose(told["grad_norm"], 5.0, rtol=1e-5)
        for name, of in norms.items():
            moment = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(after.optimizer.mu[name])])
            np.testing.assert_allclose(np.linalg.norm(moment), 0.1 * 0.5 * long[name] / of, rtol=1e-4)


@pytest.mark.parametrize("algorithm", ["ppo", "trpo", "v-mpo"])
def test_nothing_is_learnt_from_what_comes_after_a_gradient_that_is_not_finite(algorithm, monkeypatch):
    words = {"algorithm": algorithm, "loss": "gaussian", "n_steps": 8, "batch_size": 2, "net_arch": ()}
    agent = galton.make_agent(**words, normalize_advantage=False).on(Box.of([-1.0], [1.0]))
    learner = actor_critic.init(jax.random.key(0), agent, 1)
    rows = jnp.linspace(0.1, 0.8, 8)[:, None, None]
    sick = rows.at[0].set(jnp.inf)  # the action of the first minibatch, which the policy's step of TRPO sees whole
    orders = jnp.arange(8)[None]
    monkeypatch.setattr(minibatches, "orders", lambda *_: orders)

    def update(action):
        over = jnp.ones((8, 1), bool)
        batch = Transition(rows, action, 1 - rows[..., 0], rows, over, ~over)
        return agent.algorithm.update(agent, learner, batch, jax.random.key(1))

    after, told = update(sick)
    assert not np.isfinite(told["grad_norm"])
    jax.tree.map(np.testing.assert_array_equal, after.params, learner.params)
    after, told = update(rows)
    assert np.isfinite(told["grad_norm"])
    for name in ("actor", "critic"):
        assert (np.asarray(after.params[name][-1]["bias"]) != learner.params[name][-1]["bias"]).any()
