"""An entropy that is held: what it is told as, what decides α, and that targets are reached in any unit of reward."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from galton import A2C, POLICIES, PPO, train
from galton.agents import read
from galton.algorithms import actor_critic
from galton.algorithms.entropy import Entropy, HeldEntropy, log_share
from galton.envs.registry import make

from ..agents import agent as agent_on
from .minibatches import agent_of, fit, moved, orders_of, prepare, rollout_of
from .rollouts import setup, update

HELD = {"entropy_target": True}
NEAR = {"gaussian": {"entropy_start": 1.5}, "hl-gauss-centred": {"entropy_start": 0.98}}
"""Targets that are near the shares with which these losses' policies start in the boxes of these tests."""


def dual_of(learner):
    """The dual variable of the entropy target, () where none is held."""
    return learner.memory["entropy"]


def test_the_share_of_the_box_means_the_same_for_every_policy():
    low, high = np.array([-1.0, 2.0]), np.array([1.0, 12.0])
    classes, density = (
        agent_on({"loss": loss, "n_bins": 20}, low=low, high=high).policy for loss in ("hl-one-hot", "gaussian")
    )
    uniform = classes.distribution(jnp.zeros(40), {}).entropy()
    assert float(jnp.exp(log_share(classes, uniform))) == pytest.approx(1, rel=1e-5)
    half = jnp.tile(jnp.r_[jnp.zeros(10), jnp.full(10, -1e9)], 2)
    told = log_share(classes, classes.distribution(half, {}).entropy())
    assert float(jnp.exp(told)) == pytest.approx(0.5, rel=1e-5)
    log_std = np.array([-1.5, 0.3])
    gaussian = density.distribution(jnp.zeros(2), {"log_std": jnp.asarray(log_std)}).entropy()
    filled = [math.exp(stats.norm(scale=math.exp(s)).entropy()) / w for s, w in zip(log_std, high - low, strict=True)]
    assert float(jnp.exp(log_share(density, gaussian))) == pytest.approx(math.prod(filled) ** 0.5, rel=1e-5)
    uniform_on_box = np.log(high - low).sum()
    assert float(log_share(density, jnp.asarray(uniform_on_box))) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("least", [-1.0, -0.25, 0.0])
@pytest.mark.parametrize(
    ("dual", "share"), [(0.0, 0.1), (1.0, 0.1), (-2.0, 0.12), (0.5, 0.08), (0.0, 1.0), (3.0, 1e-9)]
)
def test_alpha_and_its_step_are_the_documented_ones(dual, share, least):
    agent, _, _ = setup("hl-one-hot", entropy_start=0.1, entropy_rate=0.5, entropy_alpha_min=least, **HELD)
    policy, held, before = agent.policy, agent.entropy, jnp.float32(dual)
    nats, missing = jnp.float32(2 * math.log(10 * share)), math.log(0.1 / share)
    expected = np.clip(0.2 * math.sinh(np.clip(dual + 10 * missing, -20, 20)), least, 100)
    assert float(held.alpha(policy, before, nats)) == pytest.approx(expected, rel=1e-4, abs=1e-5)
    after = held.follow(policy, before, nats, jnp.array(True))
    at_bound = expected == (100 if missing > 0 else least)
    assert float(after) == pytest.approx(dual + 0.5 * missing * (not at_bound), abs=1e-5)
    assert held.follow(policy, before, nats, jnp.array(False)) == before


@pytest.mark.parametrize(
    ("steps", "step", "share"),
    [(1000.0, 0, 0.4), (1000.0, 500, 0.2), (1000.0, 1000, 0.1), (1000.0, 10**6, 0.1), (0.0, 0, 0.4), (0.0, 900, 0.4)],
)
def test_the_target_goes_from_start_to_end_linearly_in_its_logarithm(steps, step, share):
    held, free = HeldEntropy(entropy_start=0.4, entropy_end=0.1, entropy_steps=steps), Entropy()
    now = held.at(jnp.float32(step), jnp.array(False))
    assert float(now.entropy_start) == pytest.approx(share, rel=1e-6)
    assert free.at(jnp.float32(step), jnp.array(True)) is free


def actors_gradient(agent, learner, batch):
    """What Adam was given for the actor, and the learner after the step."""
    after, told = update(agent, learner, batch)
    given = {name: part for name, part in after.optimizer.mu.items() if name != "critic"}
    return given, after, told


@pytest.mark.parametrize(
    ("loss", "fields"),
    [("gaussian", {}), ("hl-gauss-centred", {"normalize_advantage": True})],
    ids=["raw", "normalised"],
)
def test_in_other_units_of_reward_the_bonus_weighs_the_same(loss, fields):
    agent, learner, batch = setup(loss, **NEAR[loss], max_grad_norm=1e30, **HELD, **fields)
    larger = batch._replace(reward=1024 * batch.reward)
    last = jax.tree.map(lambda x: 1024 * x, learner.params["critic"][-1])
    values_too = learner.params | {"critic": [*learner.params["critic"][:-1], last]}
    ours, after, told = actors_gradient(agent, learner, batch)
    theirs, other, _ = actors_gradient(agent, learner._replace(params=values_too), larger)
    factor = 1 if fields else 1024
    jax.tree.map(lambda a, b: np.testing.assert_allclose(b, factor * a, rtol=1e-4, atol=factor * 1e-8), ours, theirs)
    assert float(dual_of(other)) == float(dual_of(after)) != 0
    assert float(told["entropy_alpha"]) != 0


def _unheld(agent, learner):
    """The same agent and learner without a held entropy."""
    return agent.replace(entropy=Entropy()), learner.remembering(entropy=())


def test_the_bonus_is_alpha_standard_deviations_of_the_weights():
    agent, learner, batch = setup("gaussian", entropy_start=1.5, ent_coef=0.25, max_grad_norm=1e30, **HELD)
    held, _, told = actors_gradient(agent, learner, batch)
    plain, bare = _unheld(agent, learner)
    flat = actor_critic.flatten(batch.observation)
    values = actor_critic.value(agent, learner.params, flat)
    following = actor_critic.value(agent, learner.params, actor_critic.flatten(batch.next_observation))
    std = float(np.std(actor_critic.advantages(agent, values, following, batch)))
    fixed = plain.algorithm.replace(ent_coef=0.25 + float(told["entropy_alpha"]) * std)
    expected, _, _ = actors_gradient(plain.replace(algorithm=fixed), bare, batch)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6), held, expected)


def test_the_dual_variable_is_no_parameter():
    agent, learner, batch = setup("hl-gauss-centred", **NEAR["hl-gauss-centred"], learning_rate=0.0, **HELD)
    assert jax.tree.structure(learner.optimizer.mu) == jax.tree.structure(learner.params)
    _, after, _ = actors_gradient(agent, learner, batch)
    jax.tree.map(np.testing.assert_array_equal, after.params, learner.params)
    assert float(dual_of(after)) != float(dual_of(learner))
    _, unheld, _ = setup("hl-gauss-centred")
    assert dual_of(unheld) == ()
    assert jax.tree.structure(unheld) == jax.tree.structure(learner.remembering(entropy=()))


@pytest.mark.slow
def test_ppo_moves_it_in_every_minibatch_until_target_kl_leaves_off():
    agent = agent_of("histogram", "hl-one-hot", **HELD)
    learner = moved(agent)
    rows, orders = prepare(agent, learner, rollout_of(agent, learner)), orders_of(3)
    whole = actor_critic.distribution(agent, learner.params, rows.observation).entropy().mean()
    start = 1.02 * jnp.exp(log_share(agent.policy, whole))
    near = agent.replace(entropy=agent.entropy.replace(entropy_start=start, entropy_rate=0.01))
    after, told = fit(near.replace(optimizer=near.optimizer.replace(learning_rate=0.0)), learner, rows, orders)
    assert float(told["entropy"]) == pytest.approx(float(whole), rel=1e-5)
    n_minibatches = orders.size // agent.algorithm.batch_size
    assert float(dual_of(after)) == pytest.approx(n_minibatches * 0.01 * math.log(1.02), rel=1e-2)
    stopped, _ = fit(near.replace(algorithm=near.algorithm.replace(target_kl=1e-12)), learner, rows, orders)
    one, _ = fit(near, learner, rows, orders[:1, : agent.algorithm.batch_size])
    assert float(dual_of(stopped)) == pytest.approx(float(dual_of(one)), rel=1e-5)
    assert float(dual_of(one)) != 0


def shares(env, words, steps, seeds=range(3)):
    """The share of the last fifth of training, by run and log point."""
    result = train(env, read(HELD | words), seeds, steps, n_logs=20, n_eval_episodes=0)
    assert (result.diverged_at < 0).all()
    assert np.isfinite(np.asarray(result.log.columns()["entropy_alpha"])).all()
    return np.asarray(result.log.columns()["entropy_share"])[:, -4:]


ON_THE_BANDIT = {"n_bins": 50, "n_steps": 5, "n_envs": 4, "net_arch": ()}


@pytest.mark.slow
def test_a_run_with_a_held_entropy_logs_it_and_goes_on_exactly(tmp_path):
    settings = {"n_bins": 10, "net_arch": (8,), "n_steps": 8, "entropy_target": True, "entropy_steps": 200.0}
    logs = []
    quiet = {"progress_bar": False, "log_interval": 2}
    model = PPO("lqr", "hl-gauss", **settings, batch_size=4, seed=3).learn(48, lambda _, log: logs.append(log), **quiet)
    assert {"train/entropy_share", "train/entropy_alpha"} <= logs[0].keys()
    assert 0 < logs[0]["train/entropy_share"] <= 1
    path = model.save(tmp_path / "cut")
    whole = model.learn(48, **quiet).save(tmp_path / "whole")
    again = PPO.load(path, "lqr").learn(48, **quiet).save(tmp_path / "again")
    assert whole.read_bytes() == again.read_bytes()
    without = A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=8)
    assert "entropy_share" not in without.agent.scalars
    assert "run/learner/memory/entropy" in model._run.arrays
    assert "run/learner/memory/entropy" not in without._run.arrays


def paid(record, rate):
    """The record in another currency."""

    def step(self, *about):
        state, reward, terminated = super(kind, self).step(*about)
        return state, jnp.float32(rate) * reward, terminated

    kind = type("Paid", (record,), {"step": step})
    return kind()


@pytest.mark.optimised
@pytest.mark.parametrize("policy", ["gaussian", "beta", "spline", "histogram", "smoothed", "discretised-gaussian"])
def test_policies_of_every_kind_reach_the_target(policy):
    loss = "hl-one-hot" if POLICIES[policy].family == "histogram" else "gaussian"
    target = {"learning_rate": 0.02, "entropy_start": 0.3, "entropy_end": 0.2, "entropy_steps": 20_000.0}
    found = shares("bandit", ON_THE_BANDIT | {"policy": policy, "loss": loss} | target, 60_000)
    np.testing.assert_allclose(found.mean(1), 0.2, rtol=0.1)


RATES = {"bandit": 1e3, "lqr": 30.0, "acrobot": 1.0, "mountain-car": 1e-3}
"""What a reward of four tasks is multiplied by."""


@pytest.mark.optimised
@pytest.mark.parametrize(("loss", "standardised"), [("gaussian", True), ("hl-gauss-centred", False)])
@pytest.mark.parametrize("task", RATES)
def test_the_target_is_reached_without_retuning_where_rewards_differ_a_millionfold(task, loss, standardised, trust):
    """With raw advantages the unit of reward is in them, and α std(A) takes it out of the bonus alone.

    A run whose α is at its bound gets there late: the least accurate of 192 were off by a fifth, both on Acrobot.
    """
    words = {"loss": loss, "n_bins": 50, "clip_separately": True, "normalize_advantage": standardised}
    words |= {"learning_rate": 2e-3, "log_std_init": -0.5, "entropy_steps": 60_000.0}
    found = shares(paid(type(make(task)), RATES[task]), words, 200_000, range(8)).mean(1)
    np.testing.assert_allclose(found[:3], 0.05, rtol=0.1)
    np.testing.assert_allclose(np.median(found), 0.05, rtol=0.03)
    promise = "A held entropy is reached on four tasks whose rewards differ a millionfold, with one setting."
    error = float(np.max(np.abs(found[:3] / 0.05 - 1)))
    trust("held-entropy", promise, topic="numbers", figure=error, unit="of the target", at_most=0.1)
