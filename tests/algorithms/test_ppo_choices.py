"""PPO with each choice beside the loss: in its first minibatch A2C, later its own clipped surrogate. In float64."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.algorithms import ppo
from galton.losses import HLOneHot, cross_entropy
from galton.networks import mlp
from galton.types import Transition

from .minibatches import SIZE, N, T, agent_of, moved, rollout_of, with_a2c
from .test_ppo_gradients import check_equal, deep, first_moments, fit, gradient

CHOICES = {
    "awr": {"weighting": "awr"},
    "v-mpo": {"weighting": "v-mpo", "normalize_advantage": True},
    "split": {"negative_target": "one-hot"},
    "split, normalised": {"negative_target": "one-hot", "normalize_advantage": True},
    "width": {"eta_rule": "policy"},
    "width, split, held": {"eta_rule": "policy", "negative_target": "one-hot", "entropy_target": True},
    "held, v-mpo": {"entropy_target": True, "weighting": "v-mpo"},
}


def chosen(loss, ratio, name):
    """The agent with one of CHOICES."""
    temperature = {"temperature": 0.7} if "weighting" in CHOICES[name] else {}
    return agent_of("histogram", loss, eta=1.0, ratio=ratio, **temperature, **CHOICES[name])


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def some(cases, quick):
    """The cases, of which every one that is not among the quick ones is slow."""
    return [pytest.param(*case, marks=() if case in quick else pytest.mark.slow) for case in cases]


ALL = list(itertools.product(CHOICES, [("hl-gauss", "smoothed"), ("hl-gauss-centred", "true")]))
ALL += list(itertools.product(CHOICES, [("hl-gauss", "true"), ("hl-gauss-centred", "smoothed")]))


@pytest.mark.few
@pytest.mark.parametrize(("name", "kind"), some(ALL, ALL[: 2 * len(CHOICES) : 5]))
def test_the_first_minibatch_of_the_first_epoch_is_a2cs(name, kind):
    loss, ratio = kind
    agent = chosen(loss, ratio, name)
    learner = moved(agent)
    rows = ppo.prepare(agent, learner, rollout_of(agent, learner))
    drawn = jax.random.permutation(jax.random.key(5), T * N)[:SIZE]
    after, _ = fit(agent, learner, rows, drawn[None])

    ends = jnp.ones((SIZE, 1), bool)
    column = jax.tree.map(lambda x: x[drawn][:, None], rows)
    batch = Transition(column.observation, column.action, column.returns, column.observation, ends, ~ends)
    actor_critics = with_a2c(agent)
    update = actor_critics.algorithm.update
    a2cs, _ = jax.jit(lambda learner: update(actor_critics, learner, batch, jax.random.key(0)))(learner)
    check_equal(first_moments(learner, after), first_moments(learner, a2cs), 1e-9)
    assert after.memory["entropy"] == a2cs.memory["entropy"]


CLIPPED = list(itertools.product(["awr", "split", "split, normalised"], ["smoothed", "true"]))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "ratio"), some(CLIPPED, CLIPPED[-1:]))
def test_the_gradient_is_that_of_the_clipped_surrogate_of_these_weights_and_targets(name, ratio):
    agent = chosen("hl-gauss", ratio, name)
    batch, sampling, params = deep(agent)
    rows = ppo.prepare(agent, sampling, batch)
    weight, own = agent.credit.weights(rows.advantage), agent.algorithm
    splits = "negative_target" in CHOICES[name]
    assert bool((weight < 0).any()) == splits

    def clipped_surrogate(params):
        def measured(params):
            distribution = agent.policy.distribution(mlp(params["actor"], rows.observation), params)
            target = rows.target if ratio == "smoothed" else agent.loss.target(distribution, rows.action)
            loss = cross_entropy(distribution, jax.lax.stop_gradient(target))
            split = jnp.where(weight < 0, HLOneHot()(distribution, rows.action), loss) if splits else loss
            return split, distribution.log_prob(rows.action), distribution.entropy().mean()

        (ours, log_prob, entropy), (sampled, sampled_log_prob, _) = measured(params), measured(sampling.params)
        exponent = sampled - ours if ratio == "smoothed" else log_prob - sampled_log_prob
        value = jnp.exp(exponent)
        clipped = jnp.clip(value, 1 - own.clip_range, 1 + own.clip_range)
        if ratio == "smoothed":
            policy_loss = -jnp.minimum(value * weight, clipped * weight).mean()
        else:  # what is clipped is the action's own ratio, what is moved is the loss
            is_open = jnp.where(weight > 0, value <= 1 + own.clip_range, value >= 1 - own.clip_range)
            policy_loss = (jax.lax.stop_gradient(weight * value * is_open) * ours).mean()
        value_loss = ((mlp(params["critic"], rows.observation)[:, 0] - rows.returns) ** 2).mean()
        return policy_loss + own.vf_coef * value_loss - own.ent_coef * entropy

    found, told = gradient(agent, params, rows)
    assert 0 < told["clip_fraction"] < 1
    check_equal(found, jax.grad(clipped_surrogate)(params), 1e-9)


def test_a_positive_weight_is_never_clipped_from_below():
    ratio, weight = jnp.array([0.01, 0.85, 1.0, 1.15, 1.5]), jnp.full(5, 0.3)
    np.testing.assert_array_equal(ppo.gated(ratio, weight, 0.2), [0.01, 0.85, 1.0, 1.15, 0.0])
