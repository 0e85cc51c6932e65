import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import LOSSES, Config, Hypers
from galton.algorithms import a2c
from galton.types import Transition

LOW, HIGH = np.array([-1.0, -2.0]), np.array([1.0, 2.0])


def setup(loss, **settings):
    config = Config(loss=loss, n_bins=10, n_steps=4, n_envs=3, **settings)
    policy = a2c.make_policy(config, LOW, HIGH)
    learner = a2c.init(jax.random.key(0), config, policy, 5)
    keys = jax.random.split(jax.random.key(1), 4)
    observation = jax.random.normal(keys[0], (4, 3, 5))
    batch = Transition(
        observation,
        a2c.act(policy, learner.params, observation, policy.noise(keys[1], (4, 3))),
        jax.random.normal(keys[2], (4, 3)),
        jax.random.normal(keys[3], (4, 3, 5)),
        jnp.zeros((4, 3), bool),
        jnp.zeros((4, 3), bool),
    )
    return config, policy, learner, batch


@pytest.mark.parametrize("loss", LOSSES)
def test_an_update_keeps_structure_shapes_and_dtypes(loss):
    config, policy, learner, batch = setup(loss)
    after, diagnostics = a2c.update(config, policy, learner, batch, Hypers())
    assert jax.tree.map(lambda x: (x.shape, x.dtype), after) == jax.tree.map(lambda x: (x.shape, x.dtype), learner)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((after, diagnostics)))
    assert all(
        (a != b).any() for a, b in zip(jax.tree.leaves(after.params), jax.tree.leaves(learner.params), strict=True)
    )


def test_the_networks_start_orthogonal_with_sb3s_scales():
    _, _, learner, _ = setup("hl-one-hot")
    for name, last in (("actor", 0.01), ("critic", 1.0)):
        for layer, scale in zip(learner.params[name], (2**0.5, 2**0.5, last), strict=True):
            singular = np.linalg.svd(layer["kernel"], compute_uv=False)
            np.testing.assert_allclose(singular, scale, rtol=1e-4)
            assert (np.asarray(layer["bias"]) == 0).all()


def test_init_gaussian_enters_as_the_last_bias():
    _, policy, learner, _ = setup("hl-gauss", initial_policy="gaussian")
    np.testing.assert_array_equal(learner.params["actor"][-1]["bias"], policy.init()[0])
    assert float(jnp.abs(policy.init()[0]).max()) > 0


def test_the_step_is_bounded_by_max_grad_norm():
    config, policy, learner, batch = setup("gaussian")
    huge = batch._replace(reward=1e6 * batch.reward)
    after, diagnostics = a2c.update(config, policy, learner, huge, Hypers(max_grad_norm=0.5))
    assert float(diagnostics.grad_norm) > 1e3
    clipped = jax.tree.map(lambda moment: moment / 0.1, after.optimizer.mu)  # the first moment after one step is 0.1 g
    norm = float(jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(clipped))))
    assert norm == pytest.approx(0.5, rel=1e-4)


@pytest.mark.parametrize("loss", ["gaussian", "hl-gauss"])
def test_the_entropy_bonus_raises_entropy(loss):
    config, policy, learner, batch = setup(loss)
    still = batch._replace(reward=jnp.zeros_like(batch.reward))
    entropies = []
    for ent_coef in (0.0, 1.0):
        after = learner
        for _ in range(20):
            after, diagnostics = a2c.update(config, policy, after, still, Hypers(ent_coef=ent_coef, learning_rate=1e-2))
        entropies.append(float(diagnostics.entropy))
    assert entropies[1] > entropies[0]
