import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import DummyVecEnv

import galton
from galton import A2C, DivergenceError, UsageError
from galton.envs import LQR

SMALL = {"preset": "paper", "n_bins": 10, "net_arch": (8,)}


def bits(tree):
    return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(tree)]


@pytest.fixture(scope="module")
def model():
    return A2C("lqr", **SMALL).learn(200, progress_bar=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "n_envs"),
    [
        (lambda: "lqr", 1),
        (lambda: "galton/LQR-v0", 1),
        (LQR, 1),
        (lambda: "Pendulum-v1", 1),
        (lambda: gymnasium.make("Pendulum-v1"), 1),
        (lambda: lambda: gymnasium.make("Pendulum-v1"), 1),
        (
            lambda: gymnasium.make_vec(
                "Pendulum-v1", num_envs=3, vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP}
            ),
            3,
        ),
        (lambda: DummyVecEnv([lambda: gymnasium.make("Pendulum-v1")] * 3), 3),
    ],
    ids=["name", "own id", "record", "id", "instance", "function", "vector", "SB3"],
)
def test_any_kind_of_environment_trains(make, n_envs):
    model = A2C(make(), **SMALL).learn(61, progress_bar=False)
    assert model.settings["n_envs"] == n_envs
    assert model.num_timesteps == -(-61 // (20 * n_envs)) * 20 * n_envs
    action, _ = model.predict(model.observation_space.sample())
    assert model.action_space.contains(action)


def test_keyword_arguments_reach_the_environment():
    assert A2C("lqr", **SMALL, env_kwargs={"max_episode_steps": 7}).env.record == LQR(max_episode_steps=7)


def test_learn_rounds_up_to_whole_updates_and_adds_up():
    model = A2C("lqr", **SMALL, n_steps=5, n_envs=3)
    for wanted, steps in ((16, 30), (15, 45), (29, 75)):
        assert model.learn(wanted, progress_bar=False) is model
        assert model.num_timesteps == steps


def test_the_same_seed_gives_the_same_bits_and_another_others():
    first, second, other = (A2C("lqr", **SMALL, seed=seed).learn(200, progress_bar=False) for seed in (1, 1, 2))
    assert bits(first.learner) == bits(second.learner)
    assert bits(first.learner) != bits(other.learner)


@pytest.mark.slow
@pytest.mark.parametrize("env", [pytest.param("lqr", marks=pytest.mark.slow), "Pendulum-v1"])
def test_evaluations_predictions_and_cuts_do_not_touch_training(env):
    plain = A2C(env, **SMALL, normalize_observation=True).learn(120, progress_bar=False)
    busy = A2C(env, **SMALL, normalize_observation=True)
    for steps in (40, 20, 60):
        busy.learn(steps, progress_bar=False, log_interval=1)
        busy.evaluate(2)
        busy.evaluate(1, env)
        busy.predict(busy.observation_space.sample())
    assert bits(plain.learner) == bits(busy.learner)


@pytest.mark.slow
def test_evaluation_plays_on_another_environment(model):
    assert model.evaluate(3).shape == (3,)
    short = model.evaluate(4, LQR(max_episode_steps=1, noise_std=0.0))
    assert short.shape == (4,)
    assert (short > model.evaluate(4, LQR(noise_std=0.0))).all()
    np.testing.assert_array_equal(model.evaluate(2, LQR()), model.evaluate(2, LQR()))
    assert model.evaluate(2, "galton/LQR-v0").shape == (2,)
    with pytest.raises(UsageError, match="env has actions"):
        model.evaluate(2, "mountain-car")


def test_an_evaluation_in_jax_is_compiled_once(model):
    steps = []

    class Traced(LQR):
        def step(self, *arguments):
            steps.append(arguments)
            return super().step(*arguments)

    first = model.evaluate(2, Traced())
    traced = len(steps)
    np.testing.assert_array_equal(model.evaluate(2, Traced()), first)
    assert len(steps) == traced > 0


def test_a_given_environment_is_not_evaluated_on_without_another():
    env = DummyVecEnv([lambda: gymnasium.make("Pendulum-v1")])
    model = A2C(env, **SMALL)
    with pytest.raises(UsageError, match="evaluate on an environment of its own"):
        model.evaluate(2)
    assert model.evaluate(2, "Pendulum-v1").shape == (2,)


def test_it_is_the_algorithm_that_trains_populations():
    model = A2C("lqr", **SMALL, learning_rate=1e-2, seed=3).learn(400, progress_bar=False)
    agent = galton.make_agent(n_bins=10, net_arch=(8,), learning_rate=1e-2)
    result = galton.train("lqr", agent, [3], 400, n_logs=4, n_eval_episodes=0)
    for ours, theirs in zip(jax.tree.leaves(model.learner), jax.tree.leaves(result.learner), strict=True):
        np.testing.assert_allclose(ours, theirs[0], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("env", ["lqr", "Pendulum-v1"])
def test_divergence_is_raised_with_its_step_and_the_parameters_stay_finite(env, tmp_path):
    model = A2C(env, **SMALL, learning_rate=1e38)
    with pytest.raises(DivergenceError, match=r"at step (\d+); .*learning_rate") as caught:
        model.learn(400, progress_bar=False)
    step = int(str(caught.value).split("step ")[1].split(";")[0].replace(",", ""))
    assert 0 < step <= model.num_timesteps
    assert step % 20 == 0
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(model.learner.params))
    assert model.action_space.contains(model.predict(model.observation_space.sample())[0])
    before = bits(model.learner.params)
    with pytest.raises(DivergenceError, match=str(step)):
        model.learn(20, progress_bar=False)
    assert bits(model.learner.params) == before
    assert A2C.load(model.save(tmp_path / "model")).predict(model.observation_space.sample())[0].shape


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"total_timesteps": 0}, "total_timesteps is 0"),
        ({"total_timesteps": 2**31}, "total_timesteps is 2147483648"),
        ({"log_interval": 0}, "log_interval is 0"),
        ({"callback": [print, 7]}, "callback is 7"),
    ],
)
def test_bad_arguments_of_learn_are_named_and_change_nothing(model, settings, message):
    step = model.num_timesteps
    with pytest.raises(UsageError, match=message):
        model.learn(**{"total_timesteps": 20, "progress_bar": False} | settings)
    assert model.num_timesteps == step
    with pytest.raises(UsageError, match="n_episodes is 0"):
        model.evaluate(0)
