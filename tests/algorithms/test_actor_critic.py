import jax
import jax.numpy as jnp
import numpy as np

from galton import Hypers
from galton.algorithms import actor_critic

from .rollouts import setup


def test_the_networks_start_orthogonal_with_sb3s_scales():
    _, learner, _ = setup("hl-one-hot")
    for name, last in (("actor", 0.01), ("critic", 1.0)):
        for layer, scale in zip(learner.params[name], (2**0.5, 2**0.5, last), strict=True):
            singular = np.linalg.svd(layer["kernel"], compute_uv=False)
            np.testing.assert_allclose(singular, scale, rtol=1e-4)
            assert (np.asarray(layer["bias"]) == 0).all()


def test_init_gaussian_enters_as_the_last_bias():
    agent, learner, _ = setup("hl-gauss", initial_policy="gaussian")
    bias, _ = agent.policy.init(Hypers())
    np.testing.assert_array_equal(learner.params["actor"][-1]["bias"], bias)
    assert float(jnp.abs(bias).max()) > 0


def test_a_step_along_a_gradient_that_is_not_finite_moves_no_parameter_and_the_norm_tells():
    agent, learner, _ = setup("gaussian")
    gradient = jax.tree.map(jnp.ones_like, learner.params)
    gradient["critic"][0]["bias"] = gradient["critic"][0]["bias"].at[0].set(jnp.inf)
    after, norm = actor_critic.step(agent, learner, gradient, Hypers())
    assert not np.isfinite(norm)
    jax.tree.map(np.testing.assert_array_equal, after.params, learner.params)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(after.optimizer))


def test_where_training_is_left_off_a_step_changes_nothing_at_all():
    agent, learner, _ = setup("gaussian")
    gradient = jax.tree.map(jnp.ones_like, learner.params)
    for going in (False, True):
        after, _ = actor_critic.step(agent, learner, gradient, Hypers(), jnp.array(going))
        same = jax.tree.map(lambda a, b: bool((a == b).all()), after, learner)
        assert all(jax.tree.leaves(same)) == (not going)


def test_actor_and_critic_are_clipped_apart_or_joined():
    """After one step Adam's first moment is a tenth of the gradient that it was given."""
    for separately, norms in ((False, {"actor": 5.0, "critic": 5.0}), (True, {"actor": 3.0, "critic": 4.0})):
        agent, learner, _ = setup("hl-gauss", clip_separately=separately)
        size = {name: sum(leaf.size for leaf in jax.tree.leaves(learner.params[name])) for name in norms}
        long = {"actor": 3.0, "critic": 4.0}
        gradient = {
            name: jax.tree.map(lambda leaf, x=long[name] / size[name] ** 0.5: jnp.full_like(leaf, x), part)
            for name, part in learner.params.items()
        }
        after, norm = actor_critic.step(agent, learner, gradient, Hypers(max_grad_norm=0.5))
        np.testing.assert_allclose(norm, 5.0, rtol=1e-5)
        for name, of in norms.items():
            moment = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(after.optimizer.mu[name])])
            np.testing.assert_allclose(np.linalg.norm(moment), 0.1 * 0.5 * long[name] / of, rtol=1e-4)
