"""Models on Gymnasium environments, good and broken; one compiled program serves all."""

import functools
import warnings

import jax
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.wrappers import NormalizeObservation, TimeLimit

import galton
from galton import BrokenEnvironmentError
from galton.saving import checkpoint

from .walks import N, Stateful, Walk, Walks, fail, kind, observation, reward

CONFIG = {"loss": "gaussian", "n_steps": 5, "net_arch": (4,)}
make_model = functools.partial(galton.A2C, n_envs=N, **CONFIG)


Endless = kind("Endless", ends=lambda self: False)


class Memoryless(Walk):
    """All that it remembers is an array without entries."""

    def step(self, action):
        self.position, self.t = self.np_random.normal(), 0
        return self.observe(), float(action[0]), bool(self.np_random.uniform() < 0.2), False, {}

    def get_state(self):
        return {"nothing": np.zeros((0, 2))}

    def set_state(self, state):
        assert state["nothing"].shape == (0, 2)


def bits(tree):
    return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(tree)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (observation([0.0, np.nan]), r"entry \[1\] of the observation is nan"),
        (reward(np.float64(np.inf)), "the reward is inf"),
        (fail, "step raised ZeroDivisionError"),
    ],
)
def test_training_stops_with_the_last_good_learner_saves_it_and_goes_on(change, message, tmp_path):
    good = make_model(Walk, normalize_observation=True).learn(35 * N, progress_bar=False)
    model = make_model(Walks(change), normalize_observation=True)
    with pytest.raises(BrokenEnvironmentError, match=f"^Odd, copy 2, step 37: {message}"):
        model.learn(100 * N, progress_bar=False)
    assert model.num_timesteps == 35 * N  # 7 whole updates
    kept = bits(model.learner)
    assert kept == bits(good.learner)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(model.learner))
    loaded = galton.A2C.load(model.save(tmp_path / "broken"))
    assert bits(loaded.learner) == kept
    model.learn(10 * N, progress_bar=False)
    assert model.num_timesteps == 45 * N
    assert bits(model.learner) != kept
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(model.learner))


def test_an_environment_that_breaks_in_its_first_reset_is_named_when_the_model_is_made():
    with pytest.raises(BrokenEnvironmentError, match=r"^Blind, copy 0, step 0: reset: entry \[0\] of the obs"):
        make_model(kind("Blind", observe=lambda self: np.full(2, np.nan)))


@pytest.mark.slow
def test_an_episode_of_training_that_does_not_end_is_told_once_with_the_remedy(monkeypatch):
    monkeypatch.setattr("galton.training.host_group.LONG", 30)
    model = make_model(Endless, n_steps=5)
    model.learn(25 * N, progress_bar=False)
    with pytest.warns(UserWarning, match=r"an episode of Endless has lasted 30 steps .*max_episode_steps=") as told:
        model.learn(25 * N, progress_bar=False)
    model.learn(50 * N, progress_bar=False)
    assert len(told) == 1
    make_model(lambda: TimeLimit(Endless(), 29)).learn(100 * N, progress_bar=False)


def test_an_evaluation_without_a_time_limit_is_cut_and_one_that_breaks_its_limit_stopped(monkeypatch):
    monkeypatch.setattr("galton.training.evaluate.LONG", 20)
    with pytest.warns(UserWarning, match="Endless has no time limit, .* cut after 20 steps; .*max_episode_steps="):
        returns = make_model(Endless).evaluate(2)
    np.testing.assert_allclose(make_model(lambda: TimeLimit(Endless(), 20)).evaluate(2), returns)
    assert len(make_model(lambda: TimeLimit(Endless(), 40)).evaluate(2)) == 2
    monkeypatch.setattr("galton.training.evaluate.MAX_STEPS", 20)
    with pytest.raises(BrokenEnvironmentError, match="an episode of evaluation did not end in 20 steps; give"):
        make_model(lambda: TimeLimit(Endless(), 40)).evaluate(2)


class Twisted(Stateful):
    """Its generator's state is no short one."""

    def reset(self, *, seed=None, options=None):
        if seed is not None:
            self.np_random = np.random.Generator(np.random.MT19937(seed))
        return super().reset(options=options)


class Growing(Stateful):
    """After a reset its position is an integer, and its goal isn't there before the first step."""

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.position, self.goal = 0, None
        return self.observe(), {}

    def step(self, action):
        if self.goal is None:
            self.goal = self.np_random.normal()
        observation, reward, *ends = super().step(action)
        return observation, reward + self.goal, *ends

    def get_state(self):
        return super().get_state() | ({} if self.goal is None else {"goal": self.goal})

    def set_state(self, state):
        super().set_state(state)
        self.goal = float(state["goal"]) if "goal" in state else None


EXACT = {
    "a state that grows": Growing,
    "a time limit": lambda: TimeLimit(Stateful(), 7),
    "no time limit": Stateful,
    "no numbers": Memoryless,
    "another generator": Twisted,
    "statistics": lambda: wrappers.NormalizeReward(
        NormalizeObservation(wrappers.TimeAwareObservation(TimeLimit(Stateful(), 7)))
    ),
}


def half_and_whole(make, path):
    whole = make_model(make).learn(20 * N, progress_bar=False)
    half = make_model(make).learn(10 * N, progress_bar=False)
    return half.save(path), whole


@pytest.mark.few
@pytest.mark.parametrize("name", EXACT)
def test_a_model_goes_on_exactly_with_environments_that_tell_their_states(name, tmp_path):
    path, whole = half_and_whole(EXACT[name], tmp_path / "half")
    with warnings.catch_warnings():
        warnings.simplefilter("error", galton.InexactResume)
        again = galton.A2C.load(path, env=EXACT[name])
    again.learn(10 * N, progress_bar=False)
    assert bits(again.learner) == bits(whole.learner)
    assert again.save(tmp_path / "again").read_bytes() == whole.save(tmp_path / "whole").read_bytes()


def test_a_file_from_before_the_wrappers_were_saved_loads_and_says_that_it_does_not_go_on_exactly(tmp_path):
    path = make_model(EXACT["statistics"]).learn(10 * N, progress_bar=False).save(tmp_path / "later")
    settings, arrays = checkpoint.read(path)
    kept = {name: array for name, array in arrays.items() if "wrapper/" not in name}
    assert len(arrays) - len(kept) == 8
    checkpoint.write(tmp_path / "before", settings, kept)
    with pytest.warns(galton.InexactResume, match="the checkpoint has no state for its environments .*wrapper/0/Norm"):
        model = galton.A2C.load(tmp_path / "before", env=EXACT["statistics"])
    assert model.learn(10 * N, progress_bar=False).num_timesteps == 20 * N


def around(*wrap):
    """A function that makes the environment with these wrappers, the innermost first."""
    return lambda: functools.reduce(lambda env, wrapper: wrapper(env), wrap, Walk())


@pytest.mark.parametrize(
    ("again", "told"),
    [
        (around(NormalizeObservation, wrappers.RecordEpisodeStatistics), "set_state for it$"),
        (around(), "the statistics of NormalizeObservation are lost: wrap it as in training$"),
        (Stateful, "it has wrapper/0/NormalizeObservation/.*the statistics of NormalizeObservation are lost"),
        (around(NormalizeObservation, wrappers.NormalizeReward), "there are no statistics for NormalizeReward: wrap"),
    ],
)
def test_statistics_follow_their_wrapper_to_another_place_and_lost_ones_are_told(again, told, tmp_path):
    stateful = again is Stateful
    make = (lambda: NormalizeObservation(Stateful())) if stateful else around(NormalizeObservation)
    model = make_model(make).learn(10 * N, progress_bar=False)
    path = model.save(tmp_path / "model")
    with pytest.warns(galton.InexactResume, match=told):
        loaded = galton.A2C.load(path, env=again)
    before, after = (
        [float(one.count) for own in each.wrapper_statistics for one in own.values()] for each in (model, loaded)
    )
    assert after == ([] if "lost" in told else [count + 1 for count in before]), "a reset counts one more"
