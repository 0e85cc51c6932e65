"""Both sides of the propositions, sample by sample, against finite differences and closed forms in float64."""

import functools
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

from galton import LOSSES, targets
from galton.algorithms import actor_critic
from galton.losses import surrogate
from galton.networks import features, mlp
from galton.theory import output_lipschitz
from galton.types import Learner, Transition
from studies.paper import gradients, norms, propositions
from studies.paper.gradients import READINGS, measure, sharpen
from studies.paper.norms import crossings, findings
from studies.paper.propositions import FIGURE
from studies.paper.trained import Trained
from tests.agents import agent

from .samples import SERIES

T, N, K = 4, 2, 6
LOW, HIGH = np.array([-1.0, 0.0], np.float32), np.array([1.0, 3.0], np.float32)
ETA = 0.7
SMALL = {"n_bins": K, "n_steps": T, "n_envs": N, "net_arch": (5, 4), "gamma": 0.9, "gae_lambda": 0.8, "eta": ETA}


def normal(rng, *shape):
    return jnp.asarray(rng.normal(size=shape), jnp.float32)


def network(rng, scale, *sizes):
    """Layers with entries of about scale / √(what they see)."""
    return [
        {"kernel": scale / n_in**0.5 * normal(rng, n_in, n_out), "bias": 0.3 * normal(rng, n_out)}
        for n_in, n_out in pairwise(sizes)
    ]


def setup(loss, seed=0, scale=1.0):
    """A learner, and a batch of any actions."""
    rng = np.random.default_rng(seed)
    policy = program(loss)[0].policy
    params = {"actor": network(rng, scale, 3, 5, 4, policy.n_outputs), "critic": network(rng, scale, 3, 5, 4, 1)}
    if loss == "gaussian":
        params["log_std"] = jnp.array([-0.7, 0.4])
        action = normal(rng, T, N, 2)
    else:
        action = policy.bins.decode(jnp.asarray(rng.integers(K, size=(T, N, 2))))
    ends = jnp.asarray(rng.random((2, T, N)) < 0.2)
    observation, reward, following = normal(rng, T, N, 3), normal(rng, T, N), normal(rng, T, N, 3)
    batch = Transition(observation, action, reward, following, ends[0], ends[1] & ~ends[0])
    return Learner(params, None, None, {}), batch


@functools.cache
def program(loss):
    """The agent; (learner, batch) → samples by reading."""
    own = agent(SMALL | {"loss": loss}, low=LOW, high=HIGH)

    def look(learner, batch):
        readings = [reading for name, reading in SERIES if name == loss]
        return {reading: measure(own, learner, batch, reading) for reading in readings}

    return own, jax.jit(look)


def loss_by_hand(name, reading, theta, bias, log_std, s, a):
    """Of one sample, in float64: θ is the list of what the gradient is taken in."""
    (w1, b1, w2, b2, w3), k = theta, K
    outputs = np.tanh(np.tanh(s @ w1 + b1) @ w2 + b2) @ w3 + bias
    if name == "gaussian":
        return ((a - outputs) ** 2 / (2 * np.exp(log_std) ** READINGS[reading])).sum()
    logits = outputs.reshape(2, k)
    log_probs = logits - np.log(np.exp(logits).sum(1, keepdims=True))
    centers = np.arange(k) + 0.5  # in bin widths
    cdf = norm.cdf((np.arange(k + 1) - centers[:, None]) / ETA)
    table = np.eye(k) if name == "hl-one-hot" else np.diff(cdf) / (cdf[:, -1:] - cdf[:, :1])
    target = table[((a - LOW) / ((HIGH - LOW) / k)).astype(int)]
    return -(target * log_probs).sum(), log_probs, table


def norm_by_hand(name, reading, learner, s, a, advantage):
    """By central differences in each entry of θ."""
    actor = jax.tree.map(lambda x: np.asarray(x, np.float64), learner.params["actor"])
    theta = [actor[0]["kernel"], actor[0]["bias"], actor[1]["kernel"], actor[1]["bias"], actor[2]["kernel"]]
    log_std = np.asarray(learner.params.get("log_std", 0.0), np.float64)
    expected = 0.0

    def value(theta):
        found = loss_by_hand(name, reading, theta, actor[2]["bias"], log_std, s, a)
        if name == "gaussian":
            return found
        loss, log_probs, _ = found
        # The centred target's second part is held fixed, at the policy as it is.
        return loss + (expected * log_probs).sum() if name == "hl-gauss-centred" else loss

    if name == "hl-gauss-centred":
        _, log_probs, table = loss_by_hand(name, reading, theta, actor[2]["bias"], log_std, s, a)
        expected = np.exp(log_probs) @ table
    squares = 0.0
    for part in theta:
        for i in np.ndindex(part.shape):
            here = part[i]
            sides = []
            for part[i] in (here + 1e-5, here - 1e-5):
                sides.append(value(theta))
            part[i] = here
            squares += ((sides[0] - sides[1]) / 2e-5) ** 2
    return abs(advantage) * squares**0.5


@pytest.mark.parametrize(("loss", "reading"), SERIES)
def test_the_norm_is_that_of_finite_differences(loss, reading):
    learner, batch = setup(loss)
    samples = program(loss)[1](learner, batch)[reading]
    s, a = (np.asarray(actor_critic.flatten(x), np.float64) for x in (batch.observation, batch.action))
    for i in range(T * N):
        expected = norm_by_hand(loss, reading, learner, s[i], a[i], float(samples.advantage[i]))
        np.testing.assert_allclose(samples.norm[i], expected, rtol=1e-4)


@pytest.mark.parametrize("loss", LOSSES)
def test_the_samples_gradients_average_to_the_surrogates(loss):
    own, look = program(loss)
    learner, batch = setup(loss)
    reading = "sigma^2" if loss == "gaussian" else ""
    advantage = look(learner, batch)[reading].advantage
    s, a = actor_critic.flatten(batch.observation), actor_critic.flatten(batch.action)
    params, actor = learner.params, learner.params["actor"]

    def loss_of(outputs, action):
        return own.loss(own.policy.distribution(outputs, params), action)

    @jax.jit
    def both():
        whole = jax.grad(lambda theta: surrogate(advantage, loss_of(mlp(theta, s), a)))(actor)
        each = jax.vmap(
            lambda s, a, advantage: gradients.sample_gradient(lambda o: loss_of(o, a), actor, s, advantage)[0]
        )(s, a, advantage)
        return whole, each

    whole, each = both()
    assert "bias" not in each[-1]
    del whole[-1]["bias"]
    jax.tree.map(lambda w, e: np.testing.assert_allclose(w, e.mean(0), atol=1e-5), whole, each)


@pytest.mark.parametrize(("loss", "reading"), SERIES)
def test_the_bound_is_never_crossed_and_its_factors_are_those_of_the_paper(loss, reading):
    _, look = program(loss)
    for seed in range(10):
        for scale in (0.3, 1.0, 3.0):
            learner, batch = setup(loss, seed, scale)
            samples = look(learner, batch)[reading]
            assert (np.asarray(samples.norm) <= np.asarray(samples.bound) * (1 + 1e-5)).all()
            assert np.median(np.asarray(samples.norm) / np.asarray(samples.bound)) > 0.1
    last = samples.last_factor
    if loss == "gaussian":
        outputs = mlp(learner.params["actor"], actor_critic.flatten(batch.observation))
        std = jnp.exp(learner.params["log_std"])
        distance = jnp.abs(actor_critic.flatten(batch.action) - outputs)
        np.testing.assert_allclose(last, distance.sum(-1), rtol=1e-5)
        np.testing.assert_allclose(samples.sigma, std.mean(), rtol=1e-6)
        last = (distance / std ** READINGS[reading]).sum(-1)
    shared = jnp.abs(samples.advantage) * (samples.lipschitz + samples.feature_norm)
    np.testing.assert_allclose(samples.bound, shared * last, rtol=1e-4)


@pytest.mark.parametrize("loss", ["hl-one-hot", "hl-gauss"])
def test_a_softmaxs_bound_is_proposition_1_summed_over_dimensions(loss):
    own, look = program(loss)
    policy = own.policy
    learner, batch = setup(loss)
    samples = look(learner, batch)[""]
    actor = learner.params["actor"]

    def eq_7(s, a, advantage):
        probs, index = policy.distribution(mlp(actor, s), {}).probs, policy.bins.encode(a)
        q = jax.nn.one_hot(index, K) if loss == "hl-one-hot" else targets.hl_gauss_of_center(K, index, ETA)
        shared = jnp.abs(advantage) * (output_lipschitz(actor, s) + jnp.linalg.norm(features(actor, s)))
        return sum(shared * jnp.abs(q[j] - probs[j]).sum() for j in range(2))

    expected = jax.jit(jax.vmap(eq_7))(*map(actor_critic.flatten, (batch.observation, batch.action)), samples.advantage)
    np.testing.assert_allclose(samples.bound, expected, rtol=1e-4)


def test_sharpening_scales_sigma_or_the_logits():
    learner, batch = setup("gaussian")
    np.testing.assert_allclose(
        jnp.exp(sharpen(learner, 0.01).params["log_std"]), 0.01 * jnp.exp(learner.params["log_std"]), rtol=1e-5
    )
    learner, batch = setup("hl-gauss")
    logits, sharper = (mlp(x.params["actor"], batch.observation) for x in (learner, sharpen(learner, 3.0)))
    np.testing.assert_allclose(sharper, 3 * logits, rtol=1e-5, atol=1e-6)


@pytest.mark.slow
def test_collect_measures_real_training():
    table = gradients.collect("smoke")
    assert crossings(table) == 0
    rows = norms.read(table)
    assert set(rows["step"]) == {0, 400}
    assert set(zip(rows["loss"], rows["reading"], strict=True)) == {*SERIES[:2], ("hl-gauss", "")}
    for _, look in norms.parts(rows, "loss", "reading", "step", "swept", "factor"):
        assert look["sample"].tolist() == list(range(20))
    assert findings(table)["mountain-car", "gaussian", "sigma^2"].exponent == pytest.approx([-1], abs=0.1)
    FIGURE.draw(Trained({}, {propositions.NAME: table}))
