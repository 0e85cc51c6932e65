"""TRPO's Fisher products in closed form, and what its step of the policy keeps to."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import UsageError, make_agent
from galton.algorithms import actor_critic
from galton.algorithms.trpo import fisher
from galton.training.log import Finished
from galton.training.run import begin, learn

from .rollouts import N, T, setup, update

OWN = {"algorithm": "trpo", "batch_size": T * N}


@pytest.mark.parametrize("loss", ["gaussian", "hl-one-hot"])
def test_a_fisher_product_is_that_of_the_closed_form(loss):
    """F is the mean over states of Jᵀ M J, where M is 1/σ² and 2 for a Gaussian's mean and log σ, else diag π − ππᵀ."""
    with jax.enable_x64(True):
        agent, learner, batch = setup(loss, net_arch=(4,), **OWN)
        learner, batch = jax.tree.map(lambda x: x.astype(float) if x.dtype == np.float32 else x, (learner, batch))
        own = {name: part for name, part in learner.params.items() if name != "critic"}
        own = jax.tree.map(lambda x: x + 0.3 * jax.random.normal(jax.random.key(x.size), x.shape, float), own)
        observation = actor_critic.flatten(batch.observation)
        flat, unravel = jax.flatten_util.ravel_pytree(own)

        def outputs(flat):
            params = unravel(flat)
            return agent.network(params["actor"], observation), params.get("log_std", jnp.zeros(0))

        of_outputs, of_params = (jax.jacrev(lambda x, i=i: outputs(x)[i])(flat) for i in (0, 1))
        of_params = np.broadcast_to(np.array(of_params), (T * N, *of_params.shape))
        jacobians = np.concatenate([np.array(of_outputs), of_params], 1)
        metric = np.zeros((T * N, *[jacobians.shape[1]] * 2))
        if loss == "gaussian":
            metric[:] = np.diag(np.concatenate([np.exp(-2 * own["log_std"]), [2.0, 2.0]]))
        else:
            probs = np.array(agent.policy.distribution(outputs(flat)[0], own).probs)
            for i in range(2):
                here, p = slice(i * 10, (i + 1) * 10), probs[:, i, :, None]
                metric[:, here, here] = p * np.eye(10) - p * p.swapaxes(1, 2)
        expected = np.einsum("bip,bij,bjq->pq", jacobians, metric, jacobians) / (T * N)
        v = np.random.default_rng(0).normal(size=flat.size)
        product = fisher(agent, own, observation, actor_critic.flatten(batch.action), 0.1)
        found = jax.flatten_util.ravel_pytree(product(unravel(jnp.asarray(v))))[0]
        np.testing.assert_allclose(found, expected @ v + 0.1 * v, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("loss", ["gaussian", "hl-gauss", "hl-gauss-centred"])
def test_a_step_stays_within_the_bound_and_uses_most_of_it(loss):
    agent, learner, batch = setup(loss, max_kl=0.02, cg_damping=1e-3, **OWN)
    after, told = update(agent, learner, batch)
    policies = (actor_critic.distribution(agent, one.params, batch.observation) for one in (learner, after))
    kl = float(next(policies).kl(next(policies)).mean())
    assert 0.005 < kl < 0.02
    np.testing.assert_allclose(told["kl"], kl, rtol=1e-3)


def test_without_anything_to_gain_the_policy_stays_and_the_critic_learns():
    agent, learner, batch = setup("gaussian", normalize_advantage=False, gae_lambda=0.0, gamma=0.0, **OWN)
    critic = jax.tree.map(jnp.zeros_like, learner.params["critic"])
    learner = learner._replace(params=learner.params | {"critic": critic})
    after, told = update(agent, learner, batch._replace(reward=jnp.zeros((T, N))))
    jax.tree.map(np.testing.assert_array_equal, after.params, learner.params)
    assert told["kl"] == told["step_share"] == 0
    after, _ = update(agent, learner, batch._replace(reward=jnp.ones((T, N))))
    assert after.params["critic"][-1]["bias"][0] > 1e-3


def test_the_entropy_bonus_is_no_part_of_the_policy_loss():
    losses = []
    for bonus in (0.0, 0.1):
        agent, learner, batch = setup("gaussian", ent_coef=bonus, normalize_advantage=False, **OWN)
        losses.append(float(update(agent, learner, batch)[1]["policy_loss"]))
    assert losses[0] == losses[1] != 0


def test_a_line_search_goes_back_until_the_bound_holds():
    """Where all actions are the mean, and better than expected, a step takes s from both log σ, 1 at first.

    The divergence is e²ˢ − 1 − 2s, above its approximation 2s²: 4.39 for s = 1, and 0.72 for a half.
    """
    far = {"max_kl": 2.0, "cg_damping": 0.0, "line_search_shrinking_factor": 0.5}
    far |= {"normalize_advantage": False, "gae_lambda": 0.0, "gamma": 0.0}
    agent, learner, batch = setup("gaussian", **far, **OWN)
    critic = jax.tree.map(jnp.zeros_like, learner.params["critic"])
    learner = learner._replace(params=learner.params | {"critic": critic})
    mean = actor_critic.distribution(agent, learner.params, batch.observation).mean
    batch = batch._replace(action=mean, reward=jnp.ones((T, N)))
    after, told = update(agent, learner, batch)
    assert told["step_share"] == 0.5
    np.testing.assert_allclose(told["kl"], np.e - 2, rtol=1e-5)
    np.testing.assert_allclose(after.params["log_std"], learner.params["log_std"] - 0.5, rtol=1e-5)
    once, told = update(setup("gaussian", line_search_max_iter=1, **far, **OWN)[0], learner, batch)
    assert told["step_share"] == told["kl"] == 0
    jax.tree.map(np.testing.assert_array_equal, once.params["actor"], learner.params["actor"])
    np.testing.assert_array_equal(once.params["log_std"], learner.params["log_std"])


def test_a_run_that_has_diverged_stays_where_it_is():
    agent, _, batch = setup("gaussian", **OWN)
    run, _ = begin(agent, batch.observation.shape[-1], jnp.uint32(0))
    none = jnp.zeros((T, N), int)
    finished = Finished(none > 0, none.astype(float), none)
    step = jax.jit(lambda run, batch: learn(agent, run, run.learner.normalizer, batch, finished))
    gone = step(run, batch._replace(reward=jnp.full((T, N), jnp.nan)))
    assert gone.diverged_at == 1
    for later in (gone, step(gone, batch)):
        jax.tree.map(np.testing.assert_array_equal, later.learner.params, run.learner.params)
    moved = step(run, batch).learner.params["actor"]
    assert (np.array(moved[-1]["kernel"]) != run.learner.params["actor"][-1]["kernel"]).any()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            {"policy": "beta"},
            "policy is 'beta', which has no KL divergence for TRPO to bound; choose from gaussian",
        ),
        ({"batch_size": 7}, "batch_size is 7, but a rollout has n_steps · n_envs = 2048 · 1 = 2048 steps"),
        ({"weighting": "awr"}, "weighting is 'awr', which algorithm 'trpo' does not carry out"),
        (
            {"line_search_shrinking_factor": 1.0},
            "line_search_shrinking_factor is 1.0; it must be greater than 0",
        ),
    ],
)
def test_what_it_cant_do_is_refused_by_name(words, message):
    with pytest.raises(UsageError, match=message):
        make_agent(**{"algorithm": "trpo", "loss": "gaussian"} | words)
