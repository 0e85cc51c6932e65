import subprocess
import sys

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import DummyVecEnv

import galton
from galton import A2C, Config, DivergenceError, Hypers, UsageError
from galton.envs import LQR

SMALL = {"n_bins": 10, "net_arch": (8,)}


class Tall(gymnasium.Env):
    """Actions of shape (2, 2) in float64, unsymmetric; observations of shape (2, 3); five steps an episode."""

    action_space = Box(np.array([[-1.0, 0.0], [0.0, -3.0]]), np.array([[2.0, 0.5], [4.0, 5.0]]), dtype=np.float64)
    observation_space = Box(-1.0, 1.0, (2, 3))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        return self.np_random.uniform(-1, 1, (2, 3)).astype(np.float32), {}

    def step(self, action):
        assert self.action_space.contains(action)
        self.t += 1
        return (
            self.np_random.uniform(-1, 1, (2, 3)).astype(np.float32),
            -float(np.square(action).sum()),
            False,
            (self.t == 5),
            {},
        )


def bits(tree):
    return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(tree)]


@pytest.fixture(scope="module")
def model():
    return A2C("lqr", **SMALL).learn(200, progress_bar=False)


@pytest.fixture(scope="module")
def tall():
    return A2C(Tall, **SMALL).learn(20, progress_bar=False)


@pytest.fixture(scope="module")
def gaussian():
    return A2C(Tall, "gaussian", net_arch=(8,)).learn(20, progress_bar=False)


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
    model = A2C(make(), **SMALL).learn(21, progress_bar=False)
    assert model.config.n_envs == n_envs
    assert model.num_timesteps == -(-21 // (20 * n_envs)) * 20 * n_envs
    action, _ = model.predict(model.observation_space.sample())
    assert model.action_space.contains(action)


def test_keyword_arguments_reach_the_environment():
    assert A2C("lqr", **SMALL, env_kwargs={"max_episode_steps": 7}).env == LQR(max_episode_steps=7)


@pytest.mark.parametrize("name", ["tall", "gaussian"])
@pytest.mark.parametrize("deterministic", [True, False])
def test_actions_have_the_shape_and_type_of_the_space_and_lie_in_it(name, deterministic, request):
    model = request.getfixturevalue(name)
    space = model.action_space
    single, state = model.predict(np.zeros((2, 3), np.float32), state=("kept",), deterministic=deterministic)
    assert (single.shape, single.dtype) == (space.shape, space.dtype)
    assert state == ("kept",)
    for n in (1, 64):
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


@pytest.mark.parametrize("seed", [0, 2**31, 2**32 - 1])
def test_every_seed_can_predict(seed):
    assert A2C("lqr", **SMALL, seed=seed).predict(np.zeros(2))[0].shape == (2,)


@pytest.mark.parametrize(
    "observation",
    [np.zeros(3), np.zeros((1, 1, 2)), np.zeros(()), np.zeros((2, 3)), "ab", None, [[0.0], [0.0, 1.0]], [np.nan, 0.0]],
    ids=repr,
)
def test_an_observation_that_does_not_fit_is_refused(model, observation):
    with pytest.raises(UsageError, match="observation is"):
        model.predict(observation)


def test_a_loaded_model_predicts_the_same_bits_without_an_environment(model, tmp_path):
    loaded = A2C.load(model.save(tmp_path / "model"))
    observations = np.random.default_rng(0).normal(size=(7, 2))
    for deterministic in (True, False, False):
        ours, theirs = (m.predict(observations, deterministic=deterministic)[0] for m in (model, loaded))
        np.testing.assert_array_equal(ours, theirs)
    assert loaded.env is None
    assert loaded.num_timesteps == 200
    assert loaded.action_space == model.action_space
    assert loaded.observation_space == model.observation_space
    assert (loaded.config, loaded.hypers, loaded.seed) == (model.config, model.hypers, model.seed)


def test_a_loaded_model_without_an_environment_says_what_it_needs(model, tmp_path):
    path = model.save(tmp_path / "model")
    assert path.name == "model.safetensors"
    loaded = A2C.load(tmp_path / "model")
    for action in (lambda: loaded.learn(1), loaded.evaluate, lambda: loaded.save(path)):
        with pytest.raises(UsageError, match=r"A2C.load\(path, env=\.\.\.\)"):
            action()
    assert loaded.evaluate(2, LQR()).shape == (2,)
    with pytest.raises(UsageError, match="env_kwargs"):
        A2C.load(path, env_kwargs={"noise_std": 0.0})
    loaded.close()


def test_learn_rounds_up_to_whole_updates_and_adds_up():
    model = A2C("lqr", **SMALL, n_steps=5, n_envs=3)
    for wanted, steps in ((1, 15), (15, 30), (16, 60)):
        assert model.learn(wanted, progress_bar=False) is model
        assert model.num_timesteps == steps


def test_the_same_seed_gives_the_same_bits_and_another_others():
    first, second, other = (A2C("lqr", **SMALL, seed=seed).learn(200, progress_bar=False) for seed in (1, 1, 2))
    assert bits(first.learner) == bits(second.learner)
    assert bits(first.learner) != bits(other.learner)


@pytest.mark.parametrize("env", ["lqr", "Pendulum-v1"])
def test_evaluations_predictions_and_cuts_do_not_touch_training(env):
    plain = A2C(env, **SMALL, normalize_observation=True).learn(120, progress_bar=False)
    busy = A2C(env, **SMALL, normalize_observation=True)
    for steps in (40, 20, 60):
        busy.learn(steps, progress_bar=False, log_interval=1)
        busy.evaluate(2)
        busy.evaluate(1, env)
        busy.predict(busy.observation_space.sample())
    assert bits(plain.learner) == bits(busy.learner)


def test_evaluation_plays_on_another_environment(model):
    assert model.evaluate(3).shape == (3,)
    short = model.evaluate(4, LQR(max_episode_steps=1, noise_std=0.0))
    assert short.shape == (4,)
    assert (short > model.evaluate(4, LQR(noise_std=0.0))).all()
    np.testing.assert_array_equal(model.evaluate(2, LQR()), model.evaluate(2, LQR()))
    assert model.evaluate(2, "galton/LQR-v0").shape == (2,)
    with pytest.raises(UsageError, match="env has actions"):
        model.evaluate(2, "mountain-car")


def test_a_given_environment_is_not_evaluated_on_without_another():
    env = DummyVecEnv([lambda: gymnasium.make("Pendulum-v1")])
    model = A2C(env, **SMALL)
    with pytest.raises(UsageError, match="evaluate on an environment of its own"):
        model.evaluate(2)
    assert model.evaluate(2, "Pendulum-v1").shape == (2,)


def test_it_is_the_algorithm_that_trains_populations():
    model = A2C("lqr", **SMALL, learning_rate=1e-2, seed=3).learn(400, progress_bar=False)
    result = galton.train("lqr", Config(**SMALL), Hypers(1e-2), [3], 400, n_logs=4, n_eval_episodes=0)
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
        ({"loss": "mse"}, "loss is 'mse'"),
        ({"learning_rate": -1.0}, "learning_rate is -1.0"),
        ({"learning_rate": float("inf")}, "learning_rate is inf"),
        ({"gamma": 1.5}, "gamma is 1.5"),
        ({"eta": 0.0}, "eta is 0.0"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": 2**32}, "seed is 4294967296"),
        ({"n_bins": 1}, "n_bins is 1"),
        ({"net_arch": (8, 0)}, "net_arch is 0"),
        ({"n_envs": 0}, "n_envs is 0"),
        ({"env": 7}, "env is 7"),
        ({"env": "NoSuch-v0"}, "NoSuch-v0"),
        ({"env": "CartPole-v1"}, "continuous actions"),
        ({"env": LQR(), "env_kwargs": {"noise_std": 1.0}}, "env_kwargs"),
        ({"env_kwargs": {"mass": 1.0}}, "no constant 'mass'"),
        ({"env": DummyVecEnv([Tall] * 2), "n_envs": 3}, "n_envs is 3, but 2 were given"),
        ({"env": Tall(), "n_envs": 3}, "n_envs is 3, but one environment was given"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_bad_arguments_of_the_constructor_are_named(settings, message):
    with pytest.raises(UsageError, match=message):
        A2C(**{"env": "lqr"} | SMALL | settings)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"total_timesteps": 0}, "total_timesteps is 0"),
        ({"total_timesteps": 2**31}, "total_timesteps is 2147483648"),
        ({"log_interval": 0}, "log_interval is 0"),
        ({"callback": [len, 7]}, "callback is 7"),
    ],
)
def test_bad_arguments_of_learn_are_named_and_change_nothing(model, settings, message):
    step = model.num_timesteps
    with pytest.raises(UsageError, match=message):
        model.learn(**{"total_timesteps": 20, "progress_bar": False} | settings)
    assert model.num_timesteps == step
    with pytest.raises(UsageError, match="n_episodes is 0"):
        model.evaluate(0)


WRONG_TYPES = """
import sys, numpy as np, galton
model = galton.A2C("lqr", n_bins=np.int64(10), net_arch=[np.int32(8)], normalize_reward=1, seed=np.uint32(5), eta=1)
loaded = galton.A2C.load(model.save(sys.argv[1]))
assert loaded.config == model.config, loaded.config
make = lambda **settings: galton.A2C("lqr", **settings)
for attempt, message in (
    (lambda: make(learning_rate=np.ones(2)), "learning_rate is [1. 1.]; A2C is one run"),
    (lambda: make(gamma=np.ones((1, 1))), "gamma is [[1.]]; A2C is one run"),
    (lambda: make(learning_rate="fast"), "learning_rate is 'fast'"),
    (lambda: make(eta=None), "eta is None; it must be a number"),
    (lambda: make(seed=1.5), "seed is 1.5"),
    (lambda: make(seed=None), "seed is None"),
    (lambda: make(n_bins=10.0), "n_bins is 10.0"),
    (lambda: make(n_steps="20"), "n_steps is 20"),
    (lambda: make(net_arch=8), "net_arch is 8"),
    (lambda: make(net_arch="88"), "an entry of net_arch is 8"),
    (lambda: make(loss=["mse"]), "loss is ['mse']"),
    (lambda: make(loss=None), "loss is None"),
    (lambda: model.learn(1e4), "total_timesteps is 10000.0"),
    (lambda: model.learn(True), "total_timesteps is True"),
    (lambda: model.learn(20, callback=7), "callback is 7"),
    (lambda: model.learn(20, log_interval=None), "log_interval is None"),
):
    try:
        attempt()
    except galton.UsageError as error:
        print("" if message in str(error) else f"{message!r} became {error!r}\\n", end="")
    except Exception as error:
        print(f"{message!r} became {error!r}")
    else:
        print(f"{message!r} passed")
"""


def test_numbers_of_numpy_are_saved_and_wrong_types_are_named_where_annotations_are_not_checked(tmp_path):
    command = [sys.executable, "-W", "error", "-c", WRONG_TYPES, str(tmp_path / "model")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("", "")
