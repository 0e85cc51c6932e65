"""A PPO update of the heads and critics that Stable-Baselines3 has not, against one written in torch. In float64."""

import math
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch
from torch import distributions
from torch.nn.functional import logsigmoid, softplus

from galton.words import vocabulary

from .minibatches import HIGH, LOW, NUMBERS, SIZE, K, N, T, agent_of, fit, moved, orders_of, prepare, rollout_of

pytestmark = pytest.mark.usefixtures("double")

HEADS = {"beta": "gaussian", "squashed-gaussian": "gaussian", "ordinal": "hl-one-hot", "rpo": "gaussian"}
"""Each with the loss that is −log π of it."""
N_VALUES = 15
OWN = {"max_grad_norm": 0.5, "learning_rate": 1e-2}
OF_VALUES = {"value_min": -0.5, "value_max": 1.0}
"""With a support that some of the rollout's returns lie outside of."""
H = types.SimpleNamespace(**vocabulary().usual | NUMBERS | OWN | OF_VALUES)
"""All numbers of theirs, by name."""
LOWS, HIGHS = torch.tensor(LOW), torch.tensor(HIGH)
NODES, WEIGHTS = (torch.tensor(x) for x in np.polynomial.hermite_e.hermegauss(120))


def beta(outputs, params):
    """The log-probability of actions and the entropy, from the network's outputs."""
    shapes = 1 + softplus(outputs.reshape(-1, 2, 2))
    base = distributions.Beta(shapes[..., 0], shapes[..., 1])
    steps = [distributions.AffineTransform(LOWS, HIGHS - LOWS)]
    whole = distributions.TransformedDistribution(base, steps, validate_args=False)
    entropy = base.entropy() + torch.log(HIGHS - LOWS)
    return lambda action: whole.log_prob(action).sum(-1), entropy.sum(-1)


def squashed(outputs, params):
    std = torch.exp(params["log_std"])
    base, half = distributions.Normal(outputs, std), (HIGHS - LOWS) / 2
    steps = [distributions.TanhTransform(), distributions.AffineTransform((HIGHS + LOWS) / 2, half)]
    whole = distributions.TransformedDistribution(base, steps)
    u = outputs[..., None] + std[:, None] * NODES
    slope = (2 * (math.log(2) - u - softplus(-2 * u)) * WEIGHTS).sum(-1) / math.sqrt(2 * math.pi)
    entropy = base.entropy() + torch.log(half) + slope
    return lambda action: whole.log_prob(action).sum(-1), entropy.sum(-1)


def ordinal(outputs, params):
    f = outputs.reshape(-1, 2, K)
    up, down = logsigmoid(f), logsigmoid(-f)
    logits = torch.stack([up[..., : i + 1].sum(-1) + down[..., i + 1 :].sum(-1) for i in range(K)], -1)
    bins = distributions.Categorical(logits=logits)
    index = lambda action: torch.floor((action - LOWS) / (HIGHS - LOWS) * K).long()  # noqa: E731
    return lambda action: bins.log_prob(index(action)).sum(-1), bins.entropy().sum(-1)


def rpo(outputs, params):
    gaussian = distributions.Normal(outputs, torch.exp(params["log_std"]))
    return lambda action: gaussian.log_prob(action).sum(-1), gaussian.entropy().sum(-1)


THEIRS = {"beta": beta, "squashed-gaussian": squashed, "ordinal": ordinal, "rpo": rpo}


EDGES = torch.linspace(H.value_min, H.value_max, N_VALUES + 1, dtype=float)
CENTERS, BIN = (EDGES[1:] + EDGES[:-1]) / 2, (H.value_max - H.value_min) / N_VALUES


def histogram(returns):
    """The masses of a Gaussian around each return in the bins, rescaled to their sum."""
    cdf = distributions.Normal(returns[:, None], H.value_eta * BIN).cdf(EDGES)
    return (cdf[:, 1:] - cdf[:, :-1]) / (cdf[:, -1:] - cdf[:, :1])


def two_hot(returns):
    return (1 - (returns[:, None] - CENTERS).abs() / BIN).clamp(min=0)


TARGETS = {"hl-gauss": histogram, "two-hot": two_hot}


def value_of(critic, outputs):
    return outputs[:, 0] if critic == "squared-error" else torch.softmax(outputs, -1) @ CENTERS


def value_loss_of(critic, outputs, returns):
    if critic == "squared-error":
        return ((outputs[:, 0] - returns) ** 2).mean()
    target = TARGETS[critic](returns.clamp(CENTERS[0], CENTERS[-1]))
    return torch.nn.functional.cross_entropy(outputs, target)


def moves_of(name, n):
    """What each of n minibatches adds to the network's outputs; RPO draws it, from a key for each count of Adam's."""
    if name != "rpo":
        return torch.zeros(n, 1, 1)
    keys = [jax.random.fold_in(jax.random.key(5), i) for i in range(n)]
    return torch.tensor(np.array([H.rpo_alpha * jax.random.uniform(key, (SIZE, 2), float, -1, 1) for key in keys]))


def network(layers, x):
    for layer in layers[:-1]:
        x = torch.tanh(x @ layer["kernel"] + layer["bias"])
    return x @ layers[-1]["kernel"] + layers[-1]["bias"]


def advantages(values, next_values, batch):
    """GAE, one environment and step at a time."""
    found, reward = np.zeros((T, N)), np.asarray(batch.reward)
    ended = np.asarray(batch.terminated), np.asarray(batch.terminated | batch.truncated)
    for n in range(N):
        later = 0.0
        for t in reversed(range(T)):
            error = reward[t, n] + H.gamma * next_values[t, n] * ~ended[0][t, n] - values[t, n]
            later = found[t, n] = error + H.gamma * H.gae_lambda * later * ~ended[1][t, n]
    return torch.tensor(found.ravel())


def update(head, critic, params, batch, orders, moves):
    """PPO's epochs over a rollout; the parameters afterwards."""
    leaves = [leaf.requires_grad_() for leaf in jax.tree.leaves(params)]
    adam = torch.optim.Adam(leaves, lr=H.learning_rate, eps=1e-5)
    flat = lambda x: torch.tensor(np.array(x).reshape(T * N, *x.shape[2:]))  # noqa: E731
    observation, action, following = (flat(x) for x in (batch.observation, batch.action, batch.next_observation))
    with torch.no_grad():
        values = value_of(critic, network(params["critic"], observation))
        next_values = value_of(critic, network(params["critic"], following))
        advantage = advantages(values.reshape(T, N).numpy(), next_values.reshape(T, N).numpy(), batch)
        returns = advantage + values
        assert critic not in TARGETS or (returns.min() < CENTERS[0] and returns.max() > CENTERS[-1])
        before = head(network(params["actor"], observation), params)[0](action)
    for rows, moved_by in zip(torch.tensor(np.array(orders)).reshape(-1, SIZE), moves, strict=True):
        log_prob, entropy = head(network(params["actor"], observation[rows]) + moved_by, params)
        ratio = torch.exp(log_prob(action[rows]) - before[rows])
        scaled = (advantage[rows] - advantage[rows].mean()) / (advantage[rows].std() + 1e-8)
        clipped = torch.clamp(ratio, 1 - H.clip_range, 1 + H.clip_range)
        policy_loss = -torch.minimum(ratio * scaled, clipped * scaled).mean()
        value_loss = value_loss_of(critic, network(params["critic"], observation[rows]), returns[rows])
        adam.zero_grad()
        (policy_loss + H.vf_coef * value_loss - H.ent_coef * entropy.mean()).backward()
        torch.nn.utils.clip_grad_norm_(leaves, H.max_grad_norm)
        adam.step()
    return params


CASES = [(name, "squared-error") for name in HEADS] + [("beta", critic) for critic in TARGETS]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "critic"), CASES)
def test_an_update_is_torchs(name, critic):
    of_critic = {"critic": critic, "n_value_bins": N_VALUES, **OF_VALUES} if critic in TARGETS else {}
    agent = agent_of(name, HEADS[name], normalize_advantage=True, **OWN, **of_critic)
    learner = moved(agent)
    batch = rollout_of(agent, learner)
    orders = orders_of(2)
    after, told = fit(agent, learner, prepare(agent, learner, batch), orders, jax.random.key(5))
    assert 0 < told["clip_fraction"] < 1
    params = jax.tree.map(lambda x: torch.tensor(np.array(x)), learner.params)
    theirs = update(THEIRS[name], critic, params, batch, orders, moves_of(name, orders.size // SIZE))
    for found, expected, first in zip(*map(jax.tree.leaves, (after.params, theirs, learner.params)), strict=True):
        assert float(jnp.abs(found - first).max()) > 1e-3
        np.testing.assert_allclose(found, expected.detach().numpy(), rtol=0, atol=1e-6)
