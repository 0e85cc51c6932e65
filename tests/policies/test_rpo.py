"""RPO moves the Gaussian's mean in updates, and nowhere else."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch
from scipy.stats import kstest, uniform

from galton.algorithms import actor_critic
from galton.networks import mlp
from galton.parts import Box
from galton.policies import GaussianPolicy, RpoPolicy

from ..algorithms.minibatches import (
    HIGH,
    LOW,
    N,
    T,
    agent_of,
    first_moments,
    fit,
    moved,
    prepare,
    rollout_of,
    update,
    with_a2c,
)

ALPHA = {"rpo_alpha": 0.8, "ent_coef": 0.0}
KEY = jax.random.key(11)


def test_it_acts_as_the_gaussian():
    ours, plain = (kind(box=Box.of(LOW, HIGH), box_units=1.0) for kind in (RpoPolicy, GaussianPolicy))
    outputs, params = jnp.array([[0.3, -1.0]]), {"log_std": jnp.array([-0.5, 0.1])}
    noise = plain.noise(KEY, (1,))
    np.testing.assert_array_equal(ours.noise(KEY, (1,)), noise)
    found, expected = (one.distribution(outputs, params) for one in (ours, plain))
    np.testing.assert_array_equal(found.sample(noise), expected.sample(noise))
    np.testing.assert_array_equal(ours.init()[1]["log_std"], plain.init()[1]["log_std"])


def test_moves_are_uniform_and_new_for_each_output_and_key():
    outputs = jnp.full((5000, 2), 3.0)
    first, second = (RpoPolicy(rpo_alpha=ALPHA["rpo_alpha"]).moved(outputs, key) for key in jax.random.split(KEY))
    assert kstest(np.ravel(first), uniform(3 - 0.8, 1.6).cdf).pvalue > 1e-3
    assert len(np.unique(np.concatenate([first, second]))) > 0.99 * 2 * first.size


def torchs(params, rows, key, objective):
    """The actor's gradient by torch in float64, of the Gaussian whose means are moved by hand."""
    moves = jax.random.uniform(key, rows.action.shape, minval=-0.8, maxval=0.8)
    theirs = {name: jax.tree.map(tracked, params[name]) for name in ("actor", "log_std")}
    x = tensor(rows.observation)
    for layer in theirs["actor"][:-1]:
        x = torch.tanh(x @ layer["kernel"] + layer["bias"])
    mean = x @ theirs["actor"][-1]["kernel"] + theirs["actor"][-1]["bias"] + tensor(moves)
    log_prob = torch.distributions.Normal(mean, theirs["log_std"].exp()).log_prob(tensor(rows.action)).sum(-1)
    (-objective(log_prob, tensor(rows.advantage)).mean()).backward()
    return jax.tree.map(lambda leaf: leaf.grad.numpy(), theirs)


def tensor(array):
    return torch.tensor(np.asarray(array), dtype=torch.float64)


def tracked(array):
    return tensor(array).requires_grad_()


def check(found, expected):
    for name in expected:
        for ours, theirs in zip(jax.tree.leaves(found[name]), jax.tree.leaves(expected[name]), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5 * float(np.abs(theirs).max()))


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 7])
def test_ppos_gradient_is_that_of_means_moved_by_the_minibatchs_own_key(count):
    agent = agent_of("rpo", "gaussian", **ALPHA, batch_size=T * N)
    learner = moved(agent)
    rows = prepare(agent, learner, rollout_of(agent, learner))
    params = jax.tree.map(lambda x: x + 0.01, learner.params)
    counted = learner._replace(params=params, optimizer=learner.optimizer._replace(count=jnp.int32(count)))
    order, clip_range = jnp.arange(T * N)[None], agent.algorithm.clip_range
    after, _ = fit(agent, counted, rows, order, KEY)
    assert int(after.optimizer.count) == count + 1
    found = jax.tree.map(lambda moment: moment / 0.1, after.optimizer.mu)

    def clipped(log_prob, advantage):
        ratio = (log_prob - tensor(rows.log_prob)).exp()
        return torch.minimum(ratio * advantage, ratio.clamp(1 - clip_range, 1 + clip_range) * advantage)

    check(found, torchs(params, rows, jax.random.fold_in(KEY, count), clipped))
    with pytest.raises(AssertionError):
        check(found, torchs(params, rows, jax.random.fold_in(KEY, count + 1), clipped))


def test_a2cs_gradient_is_that_of_means_moved_by_the_updates_key():
    agent = agent_of("rpo", "gaussian", **ALPHA)
    learner = moved(agent)
    batch = rollout_of(agent, learner)
    rows = prepare(agent, learner, batch)
    found = first_moments(learner, update(with_a2c(agent), learner, batch, KEY)[0])
    check(found, torchs(learner.params, rows, KEY, lambda log_prob, advantage: log_prob * advantage))


def test_every_rollouts_update_has_moves_of_its_own():
    agent = agent_of("rpo", "gaussian", **ALPHA)
    learner = moved(agent)
    outputs = mlp(learner.params["actor"], rollout_of(agent, learner).observation.reshape(T * N, -1))
    given = (outputs, learner.params, outputs)
    seen = [actor_critic.as_update_sees(agent, *given, key).mean for key in jax.random.split(KEY)]
    assert (seen[0] != seen[1]).mean() > 0.99
    plain = agent_of("gaussian", "gaussian")
    np.testing.assert_array_equal(actor_critic.as_update_sees(plain, *given, KEY).mean, outputs)
