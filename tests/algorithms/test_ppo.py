"""PPO as a user meets it: what it refuses, where target_kl leaves off, and that a run can be cut and resumed."""

import inspect
import os
import types

import jax
import numpy as np
import pytest
from safetensors.numpy import load_file

from galton import A2C, PPO, UsageError, make_agent, train
from galton.algorithms import minibatches, ppo
from galton.critics import SquaredErrorCritic
from galton.schedules import Step

from ..swing import stateful_swing
from .minibatches import SIZE, N, T, agent_of, fit, moved, orders_of, prepare, rollout_of

ROLLOUT = 16
SETTINGS = {
    "n_bins": 10,
    "net_arch": (8,),
    "n_steps": 8,
    "n_envs": 2,
    "batch_size": 4,
    "n_epochs": 3,
    "learning_rate": 1e-2,
    "target_kl": 0.05,
    "decay_steps": 20 * ROLLOUT,
    "normalize_observation": True,
    "normalize_reward": True,
}
QUIET = {"progress_bar": False, "log_interval": 3}


def with_target_kl(agent, target_kl):
    return agent.replace(algorithm=agent.algorithm.replace(target_kl=target_kl))


@pytest.mark.parametrize("loss", [pytest.param("gaussian", marks=pytest.mark.slow), "hl-gauss-centred"])
def test_target_kl_leaves_everything_as_it_was_from_the_first_minibatch_over_it_on(loss):
    agent = agent_of("auto", loss)
    learner = moved(agent)
    rows, orders = prepare(agent, learner, rollout_of(agent, learner)), orders_of(5)

    strict, one_by_one, steps = with_target_kl(agent, 0.006), learner, 0
    for minibatch in orders.reshape(-1, 1, SIZE):
        following, told = fit(strict, one_by_one, rows, minibatch)
        if told["approx_kl"] > 1.5 * 0.006:
            break
        one_by_one, steps = following, steps + 1
    assert SIZE < steps * SIZE < orders.size - SIZE

    # What was over it moved nothing, and nothing that comes after it has a part in the result.
    jax.tree.map(np.testing.assert_array_equal, following, one_by_one)
    whole, _ = fit(strict, learner, rows, orders)
    assert int(whole.optimizer.count) == steps
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-7), whole, one_by_one)
    fewer, _ = fit(strict, learner, rows, orders.at[-1].set(orders[0]))
    jax.tree.map(np.testing.assert_array_equal, fewer, whole)
    without, _ = fit(with_target_kl(agent, np.inf), learner, rows, orders)
    assert int(without.optimizer.count) == orders.size // SIZE

    # The norm is the mean over what moved something.
    _, once = fit(strict, learner, rows, orders[:1, :SIZE])
    twice = np.tile(orders[:1, :SIZE], 2)
    _, told = fit(with_target_kl(agent, 1e-12), learner, rows, twice)
    assert float(told["n_minibatches"]) == 1
    np.testing.assert_allclose(told["grad_norm"], once["grad_norm"], rtol=1e-6)


@pytest.mark.skipif("CHECKED" in os.environ, reason="there is no learner")
def test_every_epoch_has_an_order_of_its_own(monkeypatch):
    seen = []

    def keep(agent, learner, rows, orders, key):
        seen.append(orders)
        return learner, {}

    monkeypatch.setattr(ppo, "fit", keep)
    monkeypatch.setattr(ppo, "prepare", lambda *_: types.SimpleNamespace(advantage=np.zeros(T * N)))
    agent = agent_of("auto", "gaussian", n_epochs=5)
    agent.algorithm.update(agent, None, None, jax.random.key(3))
    orders = np.asarray(seen[0])
    assert len({tuple(order) for order in orders.tolist()}) == 5
    np.testing.assert_array_equal(np.sort(orders), np.tile(np.arange(T * N), (5, 1)))


def test_minibatches_that_do_not_divide_a_rollout_are_refused():
    for make in (
        lambda: PPO("lqr", n_steps=10, n_envs=3, batch_size=8),
        lambda: train("lqr", make_agent(algorithm="ppo", n_steps=10, n_envs=3, batch_size=8), [0], 100),
    ):
        with pytest.raises(UsageError, match=r"batch_size is 8, .* n_steps · n_envs = 10 · 3 = 30 steps"):
            make()
    with pytest.raises(UsageError, match=r"batch_size is 64, but .* = 20 · 1 = 20 steps"):
        PPO("lqr", preset="paper", n_steps=20)
    with pytest.raises(UsageError, match="normalize_advantage needs more than one step in a minibatch"):
        PPO("lqr", n_steps=4, batch_size=1)


@pytest.mark.parametrize("option", [{"n_epochs": 3}, {"batch_size": 5}, {"clip_range": 0.1}, {"target_kl": 0.1}])
def test_ppos_options_are_refused_where_a2c_trains(option):
    ((name, value),) = option.items()
    with pytest.raises(TypeError, match=rf"A2C\(\) got an unexpected keyword argument '{name}'"):
        A2C("lqr", **option)
    with pytest.raises(UsageError, match=rf"{name} is {value}; it goes with algorithm .*'ppo'.*, not 'a2c'"):
        train("lqr", make_agent(**option), [0], 100)
    assert name in inspect.signature(PPO).parameters


def tell(logs):
    """Keep the log points that come at every interval, and not those of the ends of `learn`."""

    def note(model, log):
        if model.num_timesteps % model.log_interval == 0:
            logs.append({k: v for k, v in log.items() if not k.startswith("time/time")})

    return note


@pytest.mark.slow
def test_the_run_is_the_same_however_it_is_cut_into_calls(tmp_path):
    files, logs = [], []
    for i, cuts in enumerate(([6], [1, 2, 3], [1] * 6)):
        logs.append([])
        model = PPO("lqr", "hl-gauss-centred", **SETTINGS, seed=5)
        for n in cuts:
            model.learn(n * ROLLOUT, tell(logs[-1]), **QUIET)
        files.append(model.save(tmp_path / f"{i}").read_bytes())
        model.close()
    assert files[0] == files[1] == files[2]
    assert len(logs[0]) == 2
    for other in logs[1:]:
        assert [without_fps(log) for log in other] == [without_fps(log) for log in logs[0]]


def without_fps(log):
    return {name: repr(value) for name, value in log.items() if name != "time/fps"}


@pytest.mark.parametrize(
    ("env", "loss"),
    [
        ("lqr", "hl-gauss-centred"),
        pytest.param(stateful_swing, "hl-gauss", marks=pytest.mark.slow),
        pytest.param("Reacher-v5", "gaussian", marks=pytest.mark.slow),
    ],
    ids=["jax", "gymnasium", "mujoco"],
)
def test_a_saved_run_goes_on_exactly(env, loss, tmp_path):
    if env == "Reacher-v5":
        pytest.importorskip("mujoco")
    model = PPO(env, loss, **SETTINGS, seed=5).learn(4 * ROLLOUT, **QUIET)
    path, logs = model.save(tmp_path / "cut"), ([], [])
    whole = model.learn(4 * ROLLOUT, tell(logs[0]), **QUIET).save(tmp_path / "whole")
    model.close()

    loaded = PPO.load(path, env)
    assert (loaded.num_timesteps, loaded.settings) == (4 * ROLLOUT, model.settings)
    again = loaded.learn(4 * ROLLOUT, tell(logs[1]), **QUIET).save(tmp_path / "again")
    loaded.close()
    before, after = (load_file(file)["run/learner/params/actor/0/kernel"] for file in (path, whole))
    assert (before != after).any()
    assert whole.read_bytes() == again.read_bytes()
    assert [without_fps(log) for log in logs[0]] == [without_fps(log) for log in logs[1]]
    assert len(logs[0]) == 1
    with pytest.raises(UsageError, match=r"which holds a model of PPO; load it with galton.PPO.load"):
        A2C.load(path)


@pytest.mark.parametrize(
    ("loss", "usual"),
    [
        ("hl-gauss", "smoothed"),
        ("hl-gauss-centred", "true"),
        *(pytest.param(loss, "true", marks=pytest.mark.slow) for loss in ("gaussian", "hl-one-hot")),
    ],
)
def test_the_usual_ratio_is_smoothed_for_a_loss_with_a_bias_alone(loss, usual):
    learner = moved(agent_of("auto", loss))
    batch, found = rollout_of(agent_of("auto", loss), learner), {}
    for ratio in ("auto", "smoothed", "true"):
        agent = agent_of("auto", loss, ratio=ratio)
        _, told = fit(agent, learner, prepare(agent, learner, batch), orders_of(3))
        found[ratio] = {name: float(value) for name, value in told.items()}
    assert found["auto"] == found[usual]
    assert (found["smoothed"] == pytest.approx(found["true"], rel=1e-3)) == (loss in ("gaussian", "hl-one-hot"))


class Hundredfold(SquaredErrorCritic):
    """Its value is not its output."""

    label = "hundredfold"

    def value(self, outputs):
        return 100 * super().value(outputs)


def test_the_change_of_a_value_is_clipped_for_the_squared_error_alone():
    told = r"^clip_range_vf is 0\.2, but critic 'HL-Gauss' has no one value to clip; leave it at inf or take critic='sq"
    for clipped in (0.2, Step(np.inf, 0.2, 9)):
        with pytest.raises(UsageError, match=told):
            agent_of("histogram", "hl-one-hot", critic="hl-gauss", normalize_reward=True, clip_range_vf=clipped)
    with pytest.raises(UsageError, match=r"clip_range_vf is 0.2, but critic 'hundredfold'"):
        make_agent(loss="gaussian", algorithm="ppo", critic=Hundredfold(), clip_range_vf=0.2)
    for off in ({}, {"clip_range_vf": np.inf}):  # which leaves no trace in programs
        agent = agent_of("histogram", "hl-one-hot", critic="hl-gauss", normalize_reward=True, **off)
        assert agent.algorithm.clip_range_vf is None


@pytest.mark.few
@pytest.mark.parametrize("size", [1, 2, 64, 1625, 1626, 2048, 9000])
def test_minibatches_are_in_the_order_that_jax_draws(size):
    """Some sizes are sorted once, some twice; models of earlier versions go on with these orders."""
    keys = jax.random.split(jax.random.key(size), 3)
    drawn = jax.jit(jax.vmap(lambda key: minibatches.permutation(key, size)))(keys)
    theirs = jax.vmap(lambda key: jax.random.permutation(key, size))(keys)
    np.testing.assert_array_equal(drawn, theirs)
    assert drawn.dtype == theirs.dtype
