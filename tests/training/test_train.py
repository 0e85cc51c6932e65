import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import LOSSES, UsageError, make_agent, train
from galton.envs import LQR
from galton.training import on_device as module

from ..swing import stateful_swing, swing
from .probes import Probe

FIRST = sorted(LOSSES, key=lambda loss: loss != "hl-gauss")
RATES = np.array([1e-3, 7e-4, 1e-2, 3e-4], np.float32)


def run(env=None, words=None, seeds=(0,), steps=400, **settings):
    agent = make_agent(**{"n_bins": 10, "net_arch": (8,)} | (words or {}))
    return train(env or LQR(), agent, seeds, steps, **{"n_logs": 4, "n_eval_episodes": 2} | settings)


def leaves(result, i):
    return [np.asarray(leaf[i]) for leaf in jax.tree.leaves((result.learner, result.log))]


def assert_same_bits(a, b):
    for x, y in zip(a, b, strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.mark.few
@pytest.mark.parametrize("loss", FIRST)
def test_the_same_seed_gives_the_same_bits_and_another_seed_others_and_a_run_alone_agrees_with_one_in_a_group(loss):
    first, second = (run(words={"loss": loss, "learning_rate": RATES}, seeds=range(4)) for _ in range(2))
    for i in range(4):
        assert_same_bits(leaves(first, i), leaves(second, i))
    assert any((x != y).any() for x, y in zip(leaves(first, 0), leaves(first, 1), strict=True))
    group = run(words={"loss": loss, "learning_rate": RATES}, seeds=range(4), steps=20, n_logs=1)
    for i in range(4):
        alone = run(words={"loss": loss, "learning_rate": float(RATES[i])}, seeds=[i], steps=20, n_logs=1)
        for x, y in zip(jax.tree.leaves(group.learner.params), jax.tree.leaves(alone.learner.params), strict=True):
            np.testing.assert_allclose(x[i], y[0], rtol=1e-5, atol=1e-6)


def test_how_often_is_logged_and_evaluated_does_not_touch_training():
    few = run(steps=480, n_logs=2, n_eval_episodes=0)
    many = run(steps=480, n_logs=24)
    assert_same_bits(jax.tree.leaves(few.learner), jax.tree.leaves(many.learner))


@pytest.mark.parametrize("env", [LQR(), stateful_swing])
def test_what_was_kept_at_a_log_point_goes_on_to_the_same_bits(env):
    words, kept = {"normalize_observation": True, "normalize_reward": True, "decay_steps": np.inf}, []
    whole = run(env, words, (0, 1), keep=lambda arrays: kept.append(arrays()))
    assert len(kept) == 3
    for i, arrays in enumerate(kept):
        later = []
        again = run(env, words, (0, 1), kept=arrays, keep=later.append)
        assert len(later) == 2 - i
        assert list(again.log.columns()) == list(whole.log.columns())
        for one in (0, 1):
            assert_same_bits(leaves(whole, one), leaves(again, one))
    for others, change in (((0, 1, 2), {}), ((7, 8), {}), ((0, 1), {"learning_rate": 0.5})):
        with pytest.raises(UsageError, match="kept is of other runs"):
            run(env, words | change, others, kept=kept[0])


def test_nothing_is_kept_of_environments_that_can_not_tell_their_states():
    kept = []
    run(swing, keep=lambda arrays: kept.append(arrays()))
    assert kept == [None] * 3


def test_a_run_that_turns_nan_is_flagged_and_its_neighbours_keep_their_bits():
    healthy = run(words={"learning_rate": RATES}, seeds=range(4))
    sick = RATES.copy()
    sick[1] = 1e38  # overflows in a few updates
    result = run(words={"learning_rate": sick}, seeds=range(4))
    assert result.diverged_at[1] > 0
    assert result.diverged_at[1] % result.agent.rollout.n_steps == 0
    assert (np.delete(result.diverged_at, 1) == -1).all()
    after = result.steps >= result.diverged_at[1]
    assert np.isnan(result.log.training_return[1, after]).all()
    assert np.isnan(result.log.evaluation_return[1, after]).all()
    assert np.isnan(result.final("training_return")[1])
    for i in (0, 2, 3):
        assert_same_bits(leaves(healthy, i), leaves(result, i))


def test_returns_count_whole_episodes_and_nothing_else_and_the_last_that_is_known_is_kept():
    # Reward 1 a step and seven steps an episode, over logs of 4 steps of 2 environments: a return is 7.
    result = run(Probe("constant", 7), {"n_envs": 2, "n_steps": 4}, steps=80, n_logs=10)
    ended = np.array([2 * ((4 * (i + 1)) // 7 - (4 * i) // 7) for i in range(10)])
    np.testing.assert_array_equal(result.log.n_episodes[0], ended)
    np.testing.assert_allclose(result.log.training_return[0], np.where(ended > 0, 7.0, np.nan))
    np.testing.assert_allclose(result.log.evaluation_return[0], 7.0)
    assert ended[-1] == 0
    assert result.final("training_return") == [7.0]


def test_steps_are_rounded_up_to_whole_updates_and_said_and_evaluation_can_be_turned_off():
    result = run(steps=410, n_logs=4, n_eval_episodes=0)
    np.testing.assert_array_equal(result.steps, [120, 240, 360, 480])
    assert np.isnan(result.log.evaluation_return).all()
    assert result.log.training_return.shape == (1, 4), "a group of one run is never squeezed"
    assert jnp.shape(result.learner.params["critic"][-1]["bias"]) == (1, 1)
    assert len(run(steps=30, n_logs=100).steps) == 2


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["hl-gauss", "hl-gauss-centred"])
@pytest.mark.parametrize(
    "words",
    [
        {"exploration": "gaussian", "bin_sample": "uniform", "deterministic_action": "median", "net_arch": ()},
        {"initial_policy": "gaussian"},
        {"deterministic_action": "mean", "normalize_advantage": True},
    ],
    ids=str,
)
def test_every_variant_trains(loss, words):
    result = run(words={"loss": loss, **words})
    assert (result.diverged_at == -1).all()
    assert np.isfinite(result.log.evaluation_return).all()


def test_numbers_are_data_and_do_not_compile_again():
    before = module._compile.cache_info().misses
    for rate, eta in ((1e-4, 0.1), (1e-3, 0.5)):
        run(words={"learning_rate": rate, "eta": eta})
    assert module._compile.cache_info().misses <= before + 1


BAD = [
    ({"seeds": []}, "seeds is empty"),
    ({"seeds": [-1]}, "seed is -1"),
    ({"steps": 0}, "total_timesteps is 0"),
    ({"n_logs": 0}, "n_logs is 0"),
    ({"n_eval_episodes": -1}, "n_eval_episodes is -1"),
    ({"words": {"eta": np.array([0.5, -1.0])}}, "eta is -1.0"),
    ({"words": {"learning_rate": float("inf")}}, "learning_rate is inf"),
    ({"words": {"vf_coef": np.ones(3)}}, r"vf_coef has shape \(3,\)"),
    ({"words": {"n_steps": 1, "normalize_advantage": True}}, "normalize_advantage needs"),
]


def test_bad_arguments_are_refused_by_name():
    for settings, message in BAD:
        with pytest.raises(UsageError, match=message):
            run(**settings)


def test_a_loss_that_changed_is_compiled_again(monkeypatch):
    before = run()
    monkeypatch.setitem(LOSSES, "hl-gauss", LOSSES["hl-gauss-centred"])
    after = run()
    assert any((x != y).any() for x, y in zip(leaves(before, 0), leaves(after, 0), strict=True))


def test_an_environment_that_can_not_be_copied_is_refused_before_training_where_evaluation_needs_copies():
    env, agent = swing(), make_agent(n_bins=10, net_arch=(8,))
    steps = []
    env.unwrapped.step = lambda action: steps.append(1) or (np.zeros(2, np.float32), 0.0, False, False, {})
    with pytest.raises(UsageError, match="only one copy of it was given"):
        train(env, agent, [0], 40)
    assert steps == []
    assert train(env, agent, [0], 40, n_eval_episodes=0).steps[-1] == 40
    assert len(steps) == 40


@pytest.mark.slow
@pytest.mark.parametrize("env", ["lqr", "Pendulum-v1"])
def test_every_algorithm_trains_where_jax_has_64_bits(env):
    lines = [
        "import galton, numpy as np",
        "for kind in (galton.PPO, galton.TRPO, galton.VMPO, galton.A2C):",
        f"    model = kind({env!r}, 'hl-gauss-centred', n_steps=64, n_envs=2, net_arch=(4,), n_bins=5)",
        "    assert np.isfinite(model.learn(128, progress_bar=False).evaluate(2)).all()",
    ]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        env=os.environ | {"JAX_ENABLE_X64": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
