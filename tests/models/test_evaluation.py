"""Evaluation plays by what training has learnt, or been given: statistics of wrappers, stages, parameters."""

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import (
    ClipReward,
    NormalizeObservation,
    NormalizeReward,
    RecordEpisodeStatistics,
    TransformObservation,
    TransformReward,
)
from gymnasium.wrappers import vector as vector_wrappers
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import galton
from galton.callbacks import Evaluate, StopOnReward
from galton.envs.host.carried import remember
from galton.models.acting import returns_on
from galton.models.file import InexactResume

SETTINGS = {"n_steps": 64, "batch_size": 64, "n_epochs": 1, "gamma": 0.9, "learning_rate": 1e-2, "box_units": 1}


def pendulum():
    return gymnasium.make("Pendulum-v1", max_episode_steps=30)


def normalised():
    """An environment as CleanRL's scripts wrap it."""
    return ClipReward(NormalizeReward(NormalizeObservation(pendulum()), gamma=0.9), -10, 10)


def of_gymnasium():
    """A vector environment whose copies normalise observations, and which normalises rewards itself."""
    make = lambda: NormalizeObservation(pendulum())  # noqa: E731
    return vector_wrappers.NormalizeReward(SyncVectorEnv([make] * 2, autoreset_mode=AutoresetMode.SAME_STEP), gamma=0.9)


def trained(env, **settings):
    model = galton.PPO(env, "gaussian", n_envs=None, **SETTINGS | settings)
    return model.learn(256, progress_bar=False)


def by_hand(model, seeds, statistics):
    """Returns of the bare environment's rewards, its observations normalised by these statistics."""
    env, returns = pendulum(), []
    for seed in seeds:
        observation, _ = env.reset(seed=int(seed))
        collected, ended = 0.0, False
        while not ended:
            seen = (observation - statistics.mean) / np.sqrt(statistics.var + 1e-8)
            action, _ = model.predict(seen.astype(np.float32), deterministic=True)
            observation, reward, _, ended, _ = env.step(action)
            collected += float(reward)
        returns.append(collected)
    return returns


def seeds_of(model, n):
    return np.random.SeedSequence((model.seed, 1, model.num_timesteps)).generate_state(n)


def statistics(wrapper):
    while not hasattr(wrapper, "obs_rms"):
        wrapper = wrapper.env
    return wrapper.obs_rms


def test_plays_by_the_statistics_of_training_after_loading(tmp_path):
    model = trained(normalised)
    path = model.save(tmp_path / "model")
    with pytest.warns(InexactResume):
        loaded = galton.PPO.load(path, env=normalised)
    mine, theirs = (statistics(one.population.environments.layers[0][0]) for one in (model, loaded))
    np.testing.assert_allclose(theirs.mean, mine.mean, atol=0.02)  # the first observation of a new episode has joined
    assert mine.count < theirs.count < mine.count + 2
    before, returns = (theirs.count, theirs.mean.copy()), loaded.evaluate(3)
    np.testing.assert_allclose(returns, by_hand(loaded, seeds_of(loaded, 3), theirs), rtol=1e-4)
    np.testing.assert_array_equal(loaded.evaluate(3), returns)
    assert theirs.count == before[0]
    np.testing.assert_array_equal(theirs.mean, before[1])


@pytest.mark.slow
def test_another_vector_environment_gets_the_statistics_of_training():
    envs, other = of_gymnasium(), of_gymnasium()
    model = trained(envs)
    returns = model.evaluate(4, env=other)
    for i, (copy, seed) in enumerate(zip(envs.unwrapped.envs, seeds_of(model, 2), strict=True)):
        np.testing.assert_allclose(returns[2 * i], by_hand(model, [seed], statistics(copy))[0], rtol=1e-4)
    assert statistics(other.unwrapped.envs[1]).count == statistics(envs.unwrapped.envs[1]).count


def test_without_the_statistics_of_training_evaluation_is_refused(tmp_path):
    model = trained(normalised)
    unbounded = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
    bare = trained(lambda: TransformObservation(pendulum(), lambda observation: observation, unbounded))
    with pytest.raises(galton.UsageError, match="NormalizeObservation, and what the model is trained on by nothing"):
        bare.evaluate(2, env=normalised)
    alone = galton.PPO.load(model.save(tmp_path / "model"))
    np.testing.assert_array_equal(alone.evaluate(2, env=normalised), model.evaluate(2, env=normalised))
    with pytest.raises(galton.UsageError, match="wrap both alike"):
        alone.evaluate(2, env=lambda: NormalizeObservation(NormalizeObservation(pendulum())))
    for name in [name for name in alone._run.arrays if name.startswith("statistics/")]:
        del alone._run.arrays[name]  # as in files of earlier versions
    with pytest.raises(galton.UsageError, match=r"has counted no observations.*load\(path, env=\.\.\.\)"):
        alone.evaluate(2, env=normalised)
    ready = normalised()
    statistics(ready).mean, statistics(ready).var, statistics(ready).count = np.zeros(3), np.full(3, 2.0), 100
    returns = alone.evaluate(2, env=ready)
    first = by_hand(alone, seeds_of(alone, 1), statistics(ready))
    np.testing.assert_allclose(returns[0], first[0], rtol=1e-4)
    assert statistics(ready).count == 100
    ready.reset()
    assert statistics(ready).count == 101  # it counts again afterwards


def test_a_policy_that_cannot_change_is_told_one_return_whatever_scales_its_rewards():
    told = []
    model = galton.PPO(lambda: NormalizeReward(Falling(), gamma=0.9), "gaussian", **SETTINGS | {"learning_rate": 0.0})
    watch = lambda model, log: told.append(log["eval/mean_reward"])  # noqa: E731
    with pytest.warns(UserWarning, match="so nothing is learnt"):
        model.learn(256, [Evaluate(every=64, n_episodes=1), StopOnReward(-20.0), watch], progress_bar=False)
    assert told == [-30.0] * 4


class Falling(gymnasium.Env):
    """Ten steps, each of which earns `reward`, which somebody may change; `stage` counts episodes.

    Its spaces are Pendulum's, so its programs are too.
    """

    observation_space = gymnasium.spaces.Box(-1, 1, (3,))
    action_space = gymnasium.spaces.Box(-2, 2, (1,))

    def __init__(self):
        self.reward, self.stage = -3.0, 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t, self.stage = 0, self.stage + 1
        return np.zeros(3, np.float32), {}

    def step(self, action):
        self.t += 1
        return np.zeros(3, np.float32), self.reward, False, self.t == 10, {}


def test_training_returns_are_told_as_the_environment_gives_them_whatever_scales_its_rewards():
    """As SB3 tells them by a Monitor below its VecNormalize."""
    made = {
        "Gymnasium's": lambda: NormalizeReward(NormalizeObservation(RecordEpisodeStatistics(Falling())), gamma=0.9),
        "SB3's": VecNormalize(DummyVecEnv([Falling])),
        "none": Falling,
    }
    for each in made.values():
        told = []
        watch = lambda model, log: told.append(log["rollout/ep_rew_mean"])  # noqa: E731, B023
        galton.PPO(each, "gaussian", **SETTINGS).learn(256, watch, log_interval=1, progress_bar=False)
        assert told == [-30.0] * len(told)


class Staged(gymnasium.Wrapper):
    """A curriculum: rewards are multiplied by the stage, which somebody sets."""

    stage_weight = 1.0

    def step(self, action):
        observation, reward, *ends = self.env.step(action)
        return observation, reward * self.stage_weight, *ends


def test_copies_have_what_training_was_given_meanwhile_and_a_users_wrapper_of_rewards_is_part_of_the_task():
    made = []
    model = galton.PPO(lambda: made.append(Staged(Falling())) or made[-1], "gaussian", **SETTINGS)
    np.testing.assert_array_equal(model.evaluate(2), [-30, -30])
    made[0].unwrapped.reward, made[0].stage_weight = -5.0, 2.0
    np.testing.assert_array_equal(model.evaluate(2), [-100, -100])
    tenth = galton.PPO(lambda: TransformReward(Falling(), lambda reward: reward / 10), "gaussian", **SETTINGS)
    np.testing.assert_allclose(tenth.evaluate(1), [-3], rtol=1e-6)


def test_an_environment_that_differs_from_its_spec_is_not_made_anew_and_one_that_was_played_on_is():
    given = pendulum()
    given.unwrapped.g = 0.0
    model = galton.PPO(given, "gaussian", **SETTINGS)
    with pytest.raises(galton.UsageError, match=r"g is 0\.0, but 10\.0 in one that its spec makes.*evaluate\(env="):
        model.evaluate(2)
    played = normalised()
    played.reset(seed=3)
    played.step(np.zeros(1, np.float32))
    model = galton.PPO(played, "gaussian", **SETTINGS)
    np.testing.assert_allclose(model.evaluate(2), by_hand(model, seeds_of(model, 2), statistics(played)), rtol=1e-4)


def test_episodes_on_a_given_environment_follow_one_another():
    model = galton.PPO(Falling, "gaussian", **SETTINGS)
    given = Falling()
    given.reward = -1.0
    np.testing.assert_array_equal(model.evaluate(4, env=given), [-10] * 4)
    assert given.stage == 5
    evaluate = Evaluate(every=64, n_episodes=3, env=given)
    model.learn(64, evaluate, progress_bar=False)
    assert evaluate.best == -10
    assert given.stage == 17  # with three episodes of doing nothing, and three of random actions


class Views(gymnasium.Env):
    """Its position is a view of its state, in which a reset writes; it holds data that all copies share."""

    action_space, observation_space = Box(-1, 1, (1,)), Box(-10, 10, (2,))
    data = np.arange(10.0)

    def __init__(self):
        self.state, self.level, self.shared = np.zeros(2), np.ones(1), self.data
        self.position = self.state[:1]

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state[:], self.n = 0.5, 0
        return self.state.astype(np.float32), {}

    def step(self, action):
        self.n += 1
        self.state *= 0.9
        reward = float(self.position[0] * self.level[0])
        return self.state.astype(np.float32), reward, False, self.n >= 13, {}


def test_views_stay_views_and_an_array_that_was_set_since_is_carried():
    model = galton.A2C(Views, "gaussian", n_envs=2, n_steps=5)
    before = model.evaluate(2)
    np.testing.assert_allclose(before, sum(0.5 * 0.9**t for t in range(1, 14)), rtol=1e-5)
    model.advance(1)
    np.testing.assert_array_equal(model.evaluate(2), before)
    trained = [layers[-1] for layers in model.population.environments.layers]
    levels = np.array([[7.0], [2.0]])
    for env in trained:
        env.level = levels[1]
    np.testing.assert_allclose(model.evaluate(2), 2 * before, rtol=1e-6)
    for env in trained:
        env.level[:] = 3.0
    np.testing.assert_allclose(model.evaluate(2), 3 * before, rtol=1e-6)
    first = remember([[env] for env in trained])
    assert first[0].values[0]["shared"] is first[1].values[0]["shared"] is not Views.data, "copied once"


def test_yardsticks_are_played_where_evaluation_is():
    model = galton.A2C(Views, "gaussian", n_envs=1, n_steps=5)
    before = model.yardsticks().doing_nothing
    model.population.environments.layers[0][-1].level = np.array([2.0])
    np.testing.assert_allclose(model.yardsticks().doing_nothing, 2 * before, rtol=1e-6)


class Shared(Views):
    """What it sees is an array that a simulator holds too; `bonus` is paid at each step, which somebody may change."""

    def __init__(self):
        super().__init__()
        self.simulated, self.bonus = [np.zeros(2)], 0.0
        self.state = self.simulated[0]

    def reset(self, *, seed=None, options=None):
        self.simulated[0][:] = 0.0
        self.n = 0
        return self.state.astype(np.float32), {}

    def step(self, action):
        self.simulated[0][:] += 1
        self.n += 1
        return self.state.astype(np.float32), float(self.state[0]) + self.bonus, False, self.n >= 4, {}


def test_an_array_that_a_simulator_holds_too_stays_one():
    model = galton.A2C(Shared, "gaussian", n_envs=1, n_steps=5)
    np.testing.assert_array_equal(model.evaluate(2), [10, 10])
    model.advance(1)
    np.testing.assert_array_equal(model.evaluate(2), [10, 10])


def test_what_was_given_and_taken_back_is_not_kept_by_the_copies():
    model = galton.A2C(Shared, "gaussian", n_envs=1, n_steps=5)
    for bonus in (0.0, 1.0, 0.0):
        model.population.environments.layers[0][-1].bonus = bonus
        np.testing.assert_array_equal(model.evaluate(2), [10 + 4 * bonus] * 2)


class Rising(Falling):
    """The stage rises wherever an episode ends, and is what a step earns."""

    def __init__(self):
        self.stage = self.reward = 0

    def step(self, action):
        answer = super().step(action)
        self.stage += self.t == 10
        return answer[0], float(self.stage), *answer[2:]

    def reset(self, **options):
        answer, self.stage = super().reset(**options), self.stage
        self.stage -= 1  # which Falling counts up at each reset
        return answer


def test_the_stage_of_a_curriculum_is_trainings_in_each_evaluation():
    model = galton.A2C(Rising, "gaussian", n_envs=1, n_steps=10)
    for stage in range(3):
        for _ in range(3):  # episodes of evaluation raise it for themselves alone
            np.testing.assert_array_equal(model.evaluate(2), [10 * stage + 1] * 2)
        model.advance(1)


class Early(Falling):
    """Only its first ten steps earn something, and it never ends."""

    def step(self, action):
        return *super().step(action)[:1], float(self.t <= 10), False, False, {}


@pytest.mark.filterwarnings("ignore:.*no time limit")
def test_each_episode_without_an_end_begins_with_a_reset(monkeypatch):
    monkeypatch.setattr("galton.training.evaluate.LONG", 30)
    model = galton.PPO(Falling, "gaussian", **SETTINGS)
    np.testing.assert_array_equal(model.evaluate(5, env=Early()), [10] * 5)
    two = SyncVectorEnv([Early] * 2, autoreset_mode=AutoresetMode.SAME_STEP)
    np.testing.assert_array_equal(model.evaluate(5, env=two), [10] * 5)


class Table:
    """As pandas and polars have them: a mean, a count and an update, which are methods."""

    mean = var = count = update = lambda self: np.zeros(3)


def test_a_table_is_no_running_statistics(tmp_path):
    def made():
        env = Falling()
        env.prices = Table()
        return env

    model = galton.PPO(made, "gaussian", **SETTINGS)
    model.learn(64, progress_bar=False)
    np.testing.assert_array_equal(model.evaluate(2), [-30, -30])
    assert galton.check_env(made).ok
    model.save(tmp_path / "model")


def test_evaluation_in_jax_after_more_steps_than_32_bits_count():
    model = galton.A2C("bandit", "gaussian")
    given = model.env, model.agent, model.learner, 2, 0
    np.testing.assert_array_equal(returns_on(*given, 2**32 + 5, []), returns_on(*given, 5, []))
