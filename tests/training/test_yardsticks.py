"""What doing nothing and random actions return, and that a run is told when its policy is below them."""

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box

import galton
from galton.callbacks import Evaluate
from galton.envs.find import find
from galton.envs.host.actions import Actions
from galton.training.yardsticks import N_EPISODES, SEED, Yardsticks, logged, nothing, yardsticks_on

SETTINGS = {"n_steps": 8, "net_arch": (4,)}


class Summing(gymnasium.Env):
    """Rewards the first entry of the action, and where the episode began; four steps long."""

    observation_space = Box(-9, 9, (1,))
    action_space = Box(np.float32([-1, 2]), np.float32([1, 4]))
    n_episodes = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.begin, self.t = self.np_random.uniform(), 0
        self.n_episodes += 1
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.t += 1
        done = self.t == 4
        return np.zeros(1, np.float32), float(action[0]) + (self.begin if done else 0), False, done, {}


def on(env):
    task = find(env)
    return yardsticks_on(task, task.actions.box)


def begins():
    """Where the three episodes begin."""
    seeds = np.random.SeedSequence(SEED).generate_state(N_EPISODES)
    return [gymnasium.utils.seeding.np_random(int(seed))[0].uniform() for seed in seeds]


def test_both_are_played_from_the_same_first_states():
    act = nothing(Actions("Summing", Summing.action_space).box)  # 0, or the middle where the box leaves 0 out
    np.testing.assert_array_equal(act(np.zeros((2, 1), np.float32)), [[0, 3], [0, 3]])
    found = on(Summing)
    rng = np.random.default_rng(SEED)
    random = sum(rng.uniform([-1, 2], [1, 4], (N_EPISODES, 2)).astype(np.float32)[:, 0] for _ in range(4))
    assert found.doing_nothing == pytest.approx(np.mean(begins()), rel=1e-6)
    assert found.random_actions == pytest.approx(np.mean(begins()) + random.mean(), rel=1e-5)
    there = Summing()  # on one that is there episodes follow one another
    assert on(there).doing_nothing > 0
    assert there.n_episodes == 2 * (N_EPISODES + 1)
    for seed in (0, 4):
        model = galton.A2C(Summing, "gaussian", seed=seed, **SETTINGS)
        assert model.yardsticks() == model.yardsticks(Summing) == found, "the same in every run"


@pytest.mark.few
@pytest.mark.parametrize(("env", "rest", "random"), [("bandit", 0.0, -47.0), ("mountain-car", 0.0, -33.3)])
def test_the_returns_of_records_are_those_that_are_known(env, rest, random):
    found = on(env)
    assert found.doing_nothing == pytest.approx(rest, abs=1.5)
    assert found.random_actions == pytest.approx(random, rel=0.5)


def test_training_has_the_same_bits_with_them_and_without_and_the_first_evaluation_of_a_run_alone_logs_them():
    logs, evaluate = [], Evaluate(8, 2)
    models = [galton.A2C(Summing, "gaussian", **SETTINGS) for _ in range(2)]
    for model, callback in zip(models, ([evaluate, lambda model, log: logs.append(log)], None), strict=True):
        for _ in range(2):
            model.learn(16, callback, 1, progress_bar=False)
    first, *others = [logged(log) for log in logs]
    assert first == models[0].yardsticks()
    assert others == [None] * 3
    np.testing.assert_array_equal(*(model.learner.params["actor"][0]["kernel"] for model in models))


def test_a_policy_below_them_is_told_so():
    both = ["doing nothing", "random actions"]
    for mean, names in ((-3.0, both), (-2.0, both[:1]), (-1.0, []), (np.nan, [])):
        told = Yardsticks(-1.0, -2.5).not_reached_by(mean)
        assert [name for name in both if name in told] == names
        assert bool(told) == bool(names)
    told = Yardsticks(-1e-3, -2.5e-3).not_reached_by(-2e-3)
    assert told == "the policy's return of -0.0020 is below that of doing nothing (-0.0010)"


def test_learn_warns_at_its_end_of_a_policy_below_doing_nothing():
    class Still(Summing):
        def step(self, action):
            observation, _, *ends = super().step(action)
            return observation, -float(np.abs(action[0])), *ends

    model, evaluate = galton.A2C(Still, "gaussian", **SETTINGS), Evaluate(8, 2)
    with pytest.warns(UserWarning, match=r"the policy's return of -\S+ is below that of doing nothing \(0\.00\)"):
        model.learn(8, evaluate, progress_bar=False)
    assert evaluate.latest < 0
