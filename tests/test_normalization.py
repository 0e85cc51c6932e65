"""Running normalisation against Stable-Baselines3's VecNormalize, step by step."""

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import galton
from galton import normalization
from galton.algorithms import Rollout
from galton.envs import find
from galton.parts import trimmed
from galton.training.population import populate

N = 3
receive = jax.jit(normalization.receive)


@jax.jit
def standardise(normalizer, raw):
    return normalization.observation(normalizer, normalization.from_origin(normalizer, raw))


class Drift(gymnasium.Env):
    """Observations of very different scales; episodes of five steps, cut off or ended in turn."""

    observation_space = Box(-np.inf, np.inf, (2,))
    action_space = Box(-1.0, 1.0, (1,))
    episode = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t, self.episode = 0, self.episode + 1
        return self._observe(), {}

    def step(self, action):
        self.t += 1
        end, kind = self.t == 5, self.episode % 2
        return self._observe(), float(self.np_random.normal(3, 50)), end and kind == 0, end and kind == 1, {}

    def _observe(self):
        return (self.np_random.normal(size=2) * [1e-2, 1e3] + [5, -200]).astype(np.float32)


def test_statistics_and_numbers_are_vec_normalizes():
    theirs = VecNormalize(DummyVecEnv([Drift] * N), gamma=0.9)
    theirs.seed(0)
    seen = theirs.reset()
    normalizer = normalization.observe(normalization.init(2, N, True, True), jnp.asarray(theirs.get_original_obs()))
    np.testing.assert_allclose(standardise(normalizer, theirs.get_original_obs()), seen, rtol=1e-3, atol=2e-5)
    for _ in range(300):
        seen, scaled, done, infos = theirs.step(np.zeros((N, 1), np.float32))
        raw, raw_reward = theirs.get_original_obs(), theirs.get_original_reward()
        final = raw.copy()
        for i in np.flatnonzero(done):
            final[i] = theirs.unnormalize_obs(infos[i]["terminal_observation"])
        normalizer, reward, end = receive(normalizer, raw_reward, done, final, raw, 0.9)
        np.testing.assert_allclose(standardise(normalizer, raw), seen, rtol=1e-3, atol=2e-3)
        np.testing.assert_allclose(reward, scaled, rtol=1e-3, atol=1e-3)
        for i in np.flatnonzero(done):
            np.testing.assert_allclose(end[i], infos[i]["terminal_observation"], rtol=2e-3, atol=5e-3)
    np.testing.assert_allclose(normalizer.observation.mean, theirs.obs_rms.mean, rtol=1e-4)
    np.testing.assert_allclose(normalizer.observation.variance, theirs.obs_rms.var, rtol=1e-3)
    np.testing.assert_allclose(normalizer.discounted_return.variance, theirs.ret_rms.var, rtol=1e-3)


@jax.jit
def seen_by_a_run(samples):
    """The normaliser after samples `[T, N, o]`, the first of which the run begins with."""

    def count_one(normalizer, x):
        return normalization.observe(normalizer, normalization.from_origin(normalizer, x)), None

    normalizer = normalization.begin(normalization.init(samples.shape[-1], 1, True, False), samples[0])
    return jax.lax.scan(count_one, normalizer, samples[1:])[0]


def test_statistics_follow_a_mean_that_moves_far_from_zero():
    normal = np.random.default_rng(0).normal(size=(80_000, 1, 1))
    samples = (3_000 + normal + 3 * (np.arange(80_000) >= 40_000)[:, None, None]).astype(np.float32)
    normalizer = seen_by_a_run(samples)
    exact = samples.astype(np.float64)
    np.testing.assert_allclose(normalizer.origin + normalizer.observation.mean, exact.mean((0, 1)), atol=0.01)
    np.testing.assert_allclose(np.sqrt(normalizer.observation.variance), exact.std((0, 1)), rtol=0.01)


@pytest.mark.parametrize("offset", [0.0, 1e4, 1e5, 1e6])
def test_an_offset_leaves_the_deviation_what_it_is(offset):
    samples = (offset + np.random.default_rng(0).normal(size=(1_000, 2, 1))).astype(np.float32)
    normalizer = seen_by_a_run(samples)
    np.testing.assert_allclose(np.sqrt(normalizer.observation.variance), samples.astype(np.float64).std(), rtol=1e-3)
    numbers = np.asarray(standardise(normalizer, samples), np.float64)
    np.testing.assert_allclose([numbers.mean(), numbers.std()], [0, 1], atol=2e-3)


def test_float64_observations_on_the_host_lose_their_digits_after_the_origin_is_taken_away():
    origin, moved = np.float64([[1.7e9]]), np.linspace(-2, 2, 9)[None, :, None]
    normalizer = normalization.init(1, 1, True, False)._replace(origin=origin)
    found = normalization.from_origin_on_host(normalizer, origin + moved)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, moved, atol=1e-6)


class Late(gymnasium.Env):
    """A point that actions move about, seen in float64 from far away, such as a time since 1970."""

    action_space = Box(-1.0, 1.0, (1,))

    def __init__(self, offset, space):
        self.offset, self.observation_space = offset, space

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t, self.place = 0, self.np_random.normal()
        return self._observe(), {}

    def step(self, action):
        self.t += 1
        self.place += float(action[0]) / 10
        return self._observe(), -abs(self.place), False, self.t == 20, {}

    def _observe(self):
        seen = np.array([self.offset + self.place])
        return {"clock": seen} if isinstance(self.observation_space, Dict) else seen


@pytest.mark.slow
@pytest.mark.parametrize("many", [1, 3])
@pytest.mark.parametrize("nested", [False, True])
def test_float64_observations_lose_their_digits_after_the_origin(nested, many):
    space = Box(-np.inf, np.inf, (1,), np.float64)
    space = Dict({"clock": space}) if nested else space

    def trained(offset):
        env = (
            Late(offset, space)
            if many == 1
            else SyncVectorEnv([lambda: Late(offset, space)] * many, autoreset_mode=AutoresetMode.SAME_STEP)
        )
        model = galton.PPO(env, n_steps=240 // many, batch_size=60, normalize_observation=True, seed=0)
        model.learn(720)
        seen = offset + np.linspace(-2, 2, 9)[:, None]
        return model, model.predict({"clock": seen} if nested else seen, deterministic=True)[0]

    (near, near_actions), (far, far_actions) = trained(0.0), trained(1.7e9)
    assert np.ptp(near_actions) > 0.01
    np.testing.assert_allclose(far_actions, near_actions, atol=0.1 * np.ptp(near_actions))
    deviations = [np.sqrt(model.learner.normalizer.observation.variance) for model in (near, far)]
    np.testing.assert_allclose(*deviations, rtol=0.01)


def test_an_entry_that_never_moved_is_divided_by_its_size():
    never, moves = np.float32([0, -0.3, 2e4]), np.random.default_rng(0).normal(size=(5_000, 2, 1)) * 1e-6
    samples = np.concatenate([np.broadcast_to(never, (5_000, 2, 3)), moves], -1).astype(np.float32)
    normalizer = seen_by_a_run(samples)
    expected = [1, 1, 2e4, np.sqrt(normalizer.observation.variance[3] + 1e-8)]
    np.testing.assert_allclose(normalization.deviation(normalizer), expected, rtol=1e-6)
    moved = np.float32([0.01, -0.29, 2.02e4, 0])
    np.testing.assert_allclose(standardise(normalizer, moved)[:3], 0.01, rtol=1e-4)


WINDOW, GAMMA = 24.0, 0.9


def with_a_window(samples, rewards, window):
    """The moments after T steps of N samples, the first of which the statistics begin with."""
    begun = normalization.begin(normalization.init(2, N, True, True), samples[0])
    done = np.zeros(N, bool)

    def step(normalizer, seen):
        moved = normalization.from_origin(normalizer, seen[0])
        return normalization.receive(normalizer, seen[1], done, moved, moved, GAMMA, window)[0], None

    return jax.lax.scan(step, begun, (samples[1:], rewards))[0]


def test_a_window_forgets_as_weights_in_numpy_do():
    """Equal weights until it is full, of 24 samples or 8 steps, and one more is seen; then a step leaves 24 / 27."""
    rng, steps = np.random.default_rng(0), 60
    samples = (rng.normal(size=(steps, N, 2)) * [1, 50] + np.linspace(0, 30, steps)[:, None, None]).astype(np.float32)
    rewards = rng.normal(2, 3, (steps - 1, N)).astype(np.float32)
    found = with_a_window(samples, rewards, WINDOW)
    returns = np.zeros((steps - 1, N))
    for t, reward in enumerate(rewards):
        returns[t] = reward + (GAMMA * returns[t - 1] if t else 0)
    for moments, origin, seen in (
        (found.observation, found.origin, samples.astype(np.float64)),
        (found.discounted_return, 0.0, returns),
    ):
        n = len(seen)
        weight = (WINDOW / (WINDOW + N)) ** (n - np.maximum(np.arange(n), WINDOW / N) - 1)
        mean = np.average(seen.mean(1), axis=0, weights=weight)
        variance = np.average(((seen - mean) ** 2).mean(1), axis=0, weights=weight)
        np.testing.assert_allclose(origin + moments.mean, mean, rtol=1e-4)
        np.testing.assert_allclose(moments.variance, variance, rtol=1e-4)
        assert moments.n == WINDOW


def test_an_endless_window_is_none_to_the_bit():
    samples = np.random.default_rng(0).normal(size=(40, N, 2)).astype(np.float32)
    rewards = samples[1:, :, 0]
    endless, none = (with_a_window(samples, rewards, window) for window in (jnp.inf, None))
    for one, other in zip(jax.tree.leaves(endless), jax.tree.leaves(none), strict=True):
        np.testing.assert_array_equal(one, other)
    assert trimmed(Rollout(normalize_reward=True)).normalize_window is None  # so programs are those without it


@pytest.mark.parametrize("env", ["lqr", "Reacher-v5"])
def test_a_window_goes_through_training_and_a_file(env, tmp_path):
    words = {"net_arch": (4,), "normalize_observation": True, "normalize_reward": True, "normalize_window": 30}
    whole = galton.A2C(env, "gaussian", n_steps=5, n_envs=2, seed=1, **words).learn(60, progress_bar=False)
    path = whole.save(tmp_path / "model")
    again = galton.A2C.load(path, env=env)
    assert again.agent.rollout.normalize_window == 30
    for model in (whole, again):
        model.learn(40, progress_bar=False)
        assert [float(m.n) for m in model.learner.normalizer[:2]] == [30, 30]
    for one, other in zip(*(jax.tree.leaves(model.learner) for model in (whole, again)), strict=True):
        np.testing.assert_array_equal(one, other)


def test_each_run_has_a_window_of_its_own():
    words = {"loss": "gaussian", "n_steps": 10, "normalize_observation": True}
    windows = np.array([4.0, 16.0, np.inf])
    found = populate(find("lqr"), galton.make_agent(normalize_window=windows, **words), [0, 0, 0])
    found.advance(3)
    np.testing.assert_allclose(found.learner.normalizer.observation.n, [4, 16, 31], rtol=1e-4)


def test_a_window_that_nothing_uses_is_refused():
    with pytest.raises(galton.UsageError, match=r"normalize_window is 9\.0; it has no use without"):
        galton.make_agent(loss="gaussian", normalize_window=9)


@pytest.mark.parametrize("flags", [(False, False), (True, False), (False, True)])
def test_what_is_off_costs_and_changes_nothing(flags):
    normalizer = normalization.init(2, N, *flags)
    raw, reward = np.full((N, 2), 7.0, np.float32), np.full(N, 3.0, np.float32)
    after, scaled, final = receive(normalizer, reward, np.zeros(N, bool), raw, raw, 0.99)
    assert bool(after.observation) == flags[0]
    assert bool(after.discounted_return) == flags[1]
    assert flags[0] or (np.asarray(final) == raw).all()
    assert flags[1] or (np.asarray(scaled) == reward).all()
