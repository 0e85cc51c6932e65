import gymnasium
import jax
import numpy as np
import pytest
from stable_baselines3.common.vec_env import DummyVecEnv

import galton
from galton import A2C, DivergenceError, UsageError
from galton.envs import LQR

from ..envs.host.walks import Tall, Walk

SMALL = {"preset": "paper", "n_bins": 10, "net_arch": (8,), "n_steps": 5}
QUIET = {"progress_bar": False}


def bits(tree):
    return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(tree)]


@pytest.fixture(scope="module")
def model():
    return A2C("lqr", **SMALL).learn(200, **QUIET)


def test_learn_rounds_up_to_whole_updates_and_adds_up():
    model = A2C("lqr", **SMALL)
    assert model.env.record == LQR()
    for wanted, steps in ((6, 10), (5, 15), (9, 25)):
        assert model.learn(wanted, **QUIET) is model
        assert model.num_timesteps == steps


@pytest.mark.filterwarnings("ignore::galton.InexactResume")  # Pendulum's states can't be told
@pytest.mark.parametrize("env", ["lqr", "Pendulum-v1"])
def test_a_run_counts_beyond_32_bits(env, tmp_path):
    there = 5 * 10**9
    model = A2C(env, **SMALL, learning_rate=galton.schedules.Linear(1e-3, 0.0, 1e10))
    snapshot = model.population.snapshot()
    step = np.full_like(snapshot["run"].step, there)
    model.population.restore(snapshot | {"run": snapshot["run"]._replace(step=step)})
    model.learn(10, **QUIET)
    assert model.num_timesteps == there + 10
    assert float(model._now.optimizer.learning_rate) == pytest.approx(5e-4)
    loaded = A2C.load(model.save(tmp_path / "model"), env=env)
    assert loaded.num_timesteps == there + 10
    for each in (model, loaded):
        each.learn(5, **QUIET)
    assert env != "lqr" or bits(loaded.learner) == bits(model.learner)
    with pytest.raises(UsageError, match="a run counts up to 2³¹ − 1 updates"):
        model.learn(10**11, **QUIET)


def test_the_same_seed_gives_the_same_bits_and_another_others():
    first, second, other = (A2C("lqr", **SMALL, seed=seed).learn(200, **QUIET) for seed in (1, 1, 2))
    assert bits(first.learner) == bits(second.learner)
    assert bits(first.learner) != bits(other.learner)


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
    with pytest.raises(UsageError, match=r"env has (actions|observations)"):
        model.evaluate(2, "mountain-car")
    assert model.evaluate(2, "Pendulum-v1").shape == (2,)


def test_it_is_the_algorithm_that_trains_populations():
    model = A2C("lqr", **SMALL, learning_rate=1e-2, seed=3).learn(400, **QUIET)
    agent = galton.make_agent(n_bins=10, net_arch=(8,), n_steps=5, learning_rate=1e-2)
    result = galton.train("lqr", agent, [3], 400, n_logs=4, n_eval_episodes=0)
    for ours, theirs in zip(jax.tree.leaves(model.learner), jax.tree.leaves(result.learner), strict=True):
        np.testing.assert_allclose(ours, theirs[0], rtol=1e-5, atol=1e-6)


@pytest.mark.few
@pytest.mark.parametrize("env", ["lqr", "InvertedPendulum-v5"])
def test_divergence_is_raised_with_its_step_and_the_parameters_stay_finite(env, tmp_path):
    model = A2C(env, **SMALL, learning_rate=1e38)
    with pytest.raises(DivergenceError, match=r"at step (\d+); .*learning_rate") as caught:
        model.learn(400, **QUIET)
    step = int(str(caught.value).split("step ")[1].split(";")[0].replace(",", ""))
    assert 0 < step <= model.num_timesteps
    assert step % 5 == 0
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(model.learner.params))
    assert model.action_space.contains(model.predict(model.observation_space.sample())[0])
    before = bits(model.learner.params)
    with pytest.raises(DivergenceError, match=str(step)):
        model.learn(20, **QUIET)
    assert bits(model.learner.params) == before
    assert A2C.load(model.save(tmp_path / "model")).predict(model.observation_space.sample())[0].shape


def test_bad_arguments_of_learn_are_named_and_change_nothing(model):
    step = model.num_timesteps
    for settings, message in (({"log_interval": 0}, "log_interval is 0"), ({"callback": [print, 7]}, "callback is 7")):
        with pytest.raises(UsageError, match=message):
            model.learn(20, **QUIET, **settings)
    assert model.num_timesteps == step
    with pytest.raises(UsageError, match="n_episodes is 0"):
        model.evaluate(0)


@pytest.fixture(scope="module")
def tall():
    return A2C(Tall, **SMALL)


@pytest.fixture(scope="module")
def gaussian():
    return A2C(Tall, "gaussian", net_arch=(8,))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tall", "gaussian"])
@pytest.mark.parametrize("deterministic", [True, False])
def test_actions_have_the_shape_and_type_of_the_space_and_lie_in_it(name, deterministic, request):
    model = request.getfixturevalue(name)
    space = model.action_space
    single, state = model.predict(np.zeros((2, 3), np.float32), state=("kept",), deterministic=deterministic)
    assert (single.shape, single.dtype) == (space.shape, space.dtype)
    assert state == ("kept",)
    for n in (0, 1, 64):
        batch, _ = model.predict(np.zeros((n, 2, 3), np.float32), deterministic=deterministic)
        assert (batch.shape, batch.dtype) == ((n, 2, 2), space.dtype)
        assert all(space.contains(action) for action in batch)


def test_a_batch_gives_what_its_rows_give(tall):
    observations = np.random.default_rng(0).uniform(-1, 1, (5, 2, 3)).astype(np.float32)
    batch, _ = tall.predict(observations, deterministic=True)
    for row, action in zip(observations, batch, strict=True):
        np.testing.assert_allclose(tall.predict(row, deterministic=True)[0], action, rtol=1e-6)


def test_stochastic_predictions_differ_from_call_to_call_and_deterministic_ones_do_not(tall):
    observations = np.zeros((16, 2, 3), np.float32)
    draws = [tall.predict(observations)[0] for _ in range(2)]
    assert (draws[0] != draws[1]).any()
    assert (draws[0][0] != draws[0]).any()
    best = [tall.predict(observations, deterministic=True)[0] for _ in range(2)]
    np.testing.assert_array_equal(*best)


def test_a_histogram_takes_bin_centers_and_a_gaussian_is_clipped_into_the_box(tall, gaussian):
    observations = np.zeros((500, 2, 3), np.float32)
    low, high = tall.action_space.low, tall.action_space.high
    bins = (tall.predict(observations)[0] - low) / (high - low) * 10 - 0.5
    np.testing.assert_allclose(bins, bins.round(), atol=1e-4)
    assert set(bins.round().astype(int).ravel()) == set(range(10))
    actions, _ = gaussian.predict(observations)
    assert (actions == low).any()
    assert (actions == high).any()
    assert ((actions > low) & (actions < high)).any()


def test_every_seed_can_predict_and_an_observation_that_does_not_fit_is_refused():
    for seed in (0, 2**31, 2**32 - 1):
        model = A2C("lqr", **SMALL, seed=seed)
        assert model.predict(np.zeros(2))[0].shape == (2,)
    for wrong in (*map(np.zeros, (3, (1, 1, 2), (), (2, 3))), "ab", None, [[0], [0, 1]], [np.nan, 0]):
        with pytest.raises(UsageError, match="observation is"):
            model.predict(wrong)


class Once(Walk):
    """A simulator that blows up once, in its 103rd step, to a number that float32 still holds but not its square."""

    n = 0

    def observe(self):
        self.n += 1
        return np.full(2, 1e25 if self.n == 103 else self.position, np.float32)


class Deaf(Once):
    def step(self, action):
        return super().step(np.zeros(1))


@pytest.mark.parametrize(("env", "told"), [(Once, "could not take the policy's action"), (Deaf, "the gradient was")])
def test_an_observation_that_overflows_the_statistics_leaves_those_before_it(env, told, tmp_path):
    model = A2C(env, "gaussian", n_steps=5, net_arch=(8,), normalize_observation=True)
    model.learn(50, **QUIET)
    with pytest.raises(DivergenceError, match=told):
        model.learn(100, **QUIET)
    moments = model.learner.normalizer.observation
    assert all(np.isfinite(leaf).all() for leaf in moments)
    loaded = A2C.load(model.save(tmp_path / "model"))
    seen = np.zeros((1, 2), np.float32)
    np.testing.assert_array_equal(*(m.predict(seen, deterministic=True)[0] for m in (loaded, model)))
