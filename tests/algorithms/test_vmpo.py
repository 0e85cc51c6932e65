"""V-MPO: its dual variables against numpy and scipy, its updates against torch, in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch
from scipy.optimize import minimize_scalar
from torch import distributions

from galton import UsageError, make_agent
from galton.algorithms.vmpo import multiplier_loss, temperature_loss

from .rollouts import HIGH, LOW, N, T, setup

pytestmark = pytest.mark.usefixtures("double")

OWN = {"algorithm": "v-mpo", "batch_size": T * N}
ADVANTAGE = np.random.default_rng(0).gamma(1.5, 2.0, 64) - 3
BETTER = np.sort(ADVANTAGE)[32:]


def divergence_of_weights(temperature):
    psi = np.exp(BETTER / temperature) / np.exp(BETTER / temperature).sum()
    return psi @ np.log(psi * len(BETTER))


@pytest.mark.parametrize("weights_kl", [0.02, 0.1, 0.5])
def test_the_temperature_is_learnt_for_the_divergence_of_the_weights(weights_kl):
    dual = lambda x: np.exp(x) * (weights_kl + np.log(np.mean(np.exp(BETTER / np.exp(x)))))  # noqa: E731
    best = minimize_scalar(dual, bounds=(-3, 5), method="bounded", options={"xatol": 1e-10}).x
    np.testing.assert_allclose(divergence_of_weights(np.exp(best)), weights_kl, rtol=1e-5)
    of_dual = jax.value_and_grad(lambda x: temperature_loss(x, jnp.asarray(ADVANTAGE), weights_kl)[0])
    value, slope = of_dual(best)
    np.testing.assert_allclose(value, dual(best), rtol=1e-12)
    np.testing.assert_allclose(slope, 0.0, atol=1e-6)
    for x in (-1.0, 0.0, 2.0):
        weight = np.exp(BETTER / np.exp(x))
        expected = np.exp(x) * (weights_kl + np.log(weight.mean())) - BETTER @ (weight / weight.sum())
        np.testing.assert_allclose(of_dual(x)[1], expected, rtol=1e-10)


def test_weights_are_the_better_halfs_softmax_and_let_no_gradient_through():
    weight = temperature_loss(jnp.log(0.7), jnp.asarray(ADVANTAGE), 0.1)[1]
    expected = np.where(BETTER[0] <= ADVANTAGE, np.exp(ADVANTAGE / 0.7), 0.0)
    np.testing.assert_allclose(weight, 64 * expected / expected.sum(), rtol=1e-10)
    assert jax.grad(lambda x: temperature_loss(x, jnp.asarray(ADVANTAGE), 0.1)[1] @ ADVANTAGE)(0.0) == 0


def test_a_multiplier_grows_where_its_divergence_is_over_its_bound_and_the_policy_sees_it_fixed():
    logs = {"mean": jnp.log(2.0), "std": jnp.log(3.0)}
    loss = lambda logs, kl: multiplier_loss(logs, kl, {"std": 0.001}, 0.01)  # noqa: E731
    of_logs, of_kl = jax.grad(loss, (0, 1))(logs, {"mean": jnp.asarray(0.04), "std": jnp.asarray(0.0005)})
    np.testing.assert_allclose([of_logs["mean"], of_logs["std"]], [2 * (0.01 - 0.04), 3 * (0.001 - 0.0005)], rtol=1e-7)
    np.testing.assert_allclose([of_kl["mean"], of_kl["std"]], [2.0, 3.0], rtol=1e-7)


class Torch:
    """V-MPO written in torch, with the whole rollout as its one minibatch."""

    def __init__(self, agent, learner, loss):
        self.agent, self.loss, algorithm = agent, loss, agent.algorithm
        self.params = jax.tree.map(lambda x: torch.tensor(np.array(x, float), requires_grad=True), learner.params)
        names = ("temperature", "mean", "std") if loss == "gaussian" else ("temperature", "bins")
        self.duals = {name: torch.zeros((), dtype=float, requires_grad=True) for name in names}
        self.bounds = {"mean": algorithm.max_kl, "bins": algorithm.max_kl, "std": algorithm.max_kl_std}
        self.leaves = jax.tree.leaves(self.params)
        self.adam = torch.optim.Adam(self.leaves, lr=agent.optimizer.learning_rate, eps=1e-5)
        self.of_duals = torch.optim.Adam(list(self.duals.values()), lr=algorithm.dual_learning_rate, eps=1e-8)

    def network(self, name, x):
        *hidden, last = self.params[name]
        for layer in hidden:
            x = torch.tanh(x @ layer["kernel"] + layer["bias"])
        return x @ last["kernel"] + last["bias"]

    def policy(self, observation):
        outputs = self.network("actor", observation)
        if self.loss == "gaussian":
            return distributions.Normal(outputs, torch.exp(self.params["log_std"]).expand(outputs.shape))
        return distributions.Categorical(logits=outputs.reshape(-1, 2, 10))

    def divergences(self, old, new):
        kl = distributions.kl_divergence
        if self.loss != "gaussian":
            return {"bins": kl(old, new).sum(-1).mean()}
        moved = distributions.Normal(new.loc, old.scale), distributions.Normal(old.loc, new.scale)
        return {name: kl(old, one).sum(-1).mean() for name, one in zip(("mean", "std"), moved, strict=True)}

    def train(self, batch, steps):
        flat = lambda x: torch.tensor(np.array(x, float).reshape(T * N, *x.shape[2:]))  # noqa: E731
        observation, action, following = (flat(x) for x in (batch.observation, batch.action, batch.next_observation))
        if self.loss != "gaussian":
            low, high = torch.tensor(LOW), torch.tensor(HIGH)
            action = ((action - low) / (high - low) * 10).floor().clamp(0, 9)
        with torch.no_grad():
            values, later = (self.network("critic", x)[:, 0].reshape(T, N) for x in (observation, following))
            gain, found = torch.zeros(N, dtype=float), torch.zeros(T, N, dtype=float)
            for t in reversed(range(T)):
                error = torch.tensor(np.array(batch.reward[t], float)) + 0.9 * later[t] - values[t]
                gain = found[t] = error + 0.9 * 0.8 * gain
            advantage, returns, old = found.ravel(), (found + values).ravel(), self.policy(observation)
        for _ in range(steps):
            new, duals = self.policy(observation), {name: torch.exp(dual) for name, dual in self.duals.items()}
            top = torch.topk(advantage, T * N // 2).indices
            psi = torch.softmax(advantage[top] / duals["temperature"].detach(), 0)
            total = -(psi * new.log_prob(action).sum(-1)[top]).sum()
            spread = torch.logsumexp(advantage[top] / duals["temperature"], 0) - np.log(len(top))
            total = total + duals["temperature"] * (self.agent.algorithm.weights_kl + spread)
            for name, kl in self.divergences(old, new).items():
                total = total + duals[name] * (self.bounds[name] - kl.detach()) + duals[name].detach() * kl
            total = total + 0.5 * ((self.network("critic", observation)[:, 0] - returns) ** 2).mean()
            self.adam.zero_grad()
            self.of_duals.zero_grad()
            total.backward()
            torch.nn.utils.clip_grad_norm_(self.leaves, 0.5)
            self.adam.step()
            self.of_duals.step()


@pytest.mark.parametrize("max_kl", [10.0, 1e-3])
@pytest.mark.parametrize("loss", ["gaussian", pytest.param("hl-one-hot", marks=pytest.mark.slow)])
def test_an_update_is_torchs_as_far_as_its_bounds_go(loss, max_kl):
    words = {"net_arch": (8,), "gamma": 0.9, "gae_lambda": 0.8, "learning_rate": 0.02, "n_epochs": 4, **OWN}
    bounds = {"max_kl": max_kl, "max_kl_std": max_kl / 5}
    agent, learner, batch = setup(loss, dual_learning_rate=0.1, **words, **bounds)
    learner, batch = jax.tree.map(lambda x: x.astype(float) if x.dtype == np.float32 else x, (learner, batch))
    theirs = Torch(agent, learner, loss)
    theirs.train(batch, 4)
    after, told = jax.jit(agent.algorithm.update)(agent, learner, batch, jax.random.key(0))
    for name, params in after.params.items():
        share = 1 if name == "critic" else told["step_share"]
        for found, expected, first in zip(
            *map(jax.tree.leaves, (params, theirs.params[name], learner.params[name])), strict=True
        ):
            assert np.abs(found - first).max() > 1e-3
            np.testing.assert_allclose(found, first + share * (expected.detach().numpy() - first), rtol=0, atol=1e-8)
    moved = Torch(agent, after, loss)
    observation = torch.tensor(np.array(batch.observation, float).reshape(T * N, -1))
    with torch.no_grad():
        old, new = (side.policy(observation) for side in (Torch(agent, learner, loss), moved))
        parts = theirs.divergences(old, new)
    over = max(float(kl) / theirs.bounds[name] for name, kl in parts.items())
    assert told["step_share"] == 1 if max_kl == 10 else told["step_share"] < 1 and 0.5 < over <= 1
    np.testing.assert_allclose(told["kl"], distributions.kl_divergence(old, new).sum(-1).mean(), rtol=1e-7)
    duals = after.memory["algorithm"].duals
    ours = {"temperature": duals["temperature"], **duals["multipliers"]}
    for name, dual in theirs.duals.items():
        assert abs(ours[name]) > 1e-3
        np.testing.assert_allclose(ours[name], dual.detach(), atol=1e-8)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            {"policy": "rpo"},
            "policy is 'rpo', which has no KL divergence for VMPO to bound; choose from gaussian, histog",
        ),
        ({"batch_size": 7}, "batch_size is 7, but a rollout has n_steps · n_envs = 2048 · 1 = 2048 steps"),
        ({"batch_size": 1}, "batch_size is 1; V-MPO learns from the better half of a minibatch"),
        ({"weighting": "v-mpo"}, "weighting is 'v-mpo', which algorithm 'v-mpo' does not carry out"),
    ],
)
def test_what_it_cant_do_is_refused_by_name(words, message):
    with pytest.raises(UsageError, match=message):
        make_agent(**{"algorithm": "v-mpo", "loss": "gaussian"} | words)
