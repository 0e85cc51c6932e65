import functools

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, Tuple
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit
from stable_baselines3.common.vec_env import DummyVecEnv

import galton
from galton import BrokenEnvironmentError, UsageError
from galton.envs.find import find
from galton.envs.host.gymnasium import GymnasiumTask
from galton.envs.host.vector import VectorTask

N = 3


class Walk(gymnasium.Env):
    """Sums its actions and noise; terminates beyond ±2, so that the copies' episodes end at different steps."""

    observation_space = Box(-np.inf, np.inf, (2,))
    action_space = Box(-1, 1, (2,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.position, self.t = self.np_random.normal(), 0
        return self.observe(), {}

    def observe(self):
        return np.array([self.position, self.t], np.float32)

    def step(self, action):
        self.position += float(action.sum()) + self.np_random.normal()
        self.t += 1
        return self.observe(), self.position, abs(self.position) > 2, False, {}


class Named(Walk):
    observation_space = Dict(z=Box(-np.inf, np.inf, ()), a=Discrete(100))

    def observe(self):
        return {"z": np.array(self.position, np.float32), "a": self.t}


class Paired(Walk):
    observation_space = Tuple([Box(-np.inf, np.inf, (1,)), Discrete(100)])

    def observe(self):
        return np.array([self.position], np.float32), self.t


class Scalar(Walk):
    action_space = Box(-0.1, 0.3, (), np.float64)


def limited(env):
    return lambda: TimeLimit(env(), 4)


def sync(env, mode=AutoresetMode.SAME_STEP):
    return SyncVectorEnv([limited(env)] * N, autoreset_mode=mode)


def dummy(env):
    return DummyVecEnv([limited(env)] * N)


def run(envs, n_actions, n_steps=40):
    rng = np.random.default_rng(0)
    first = envs.reset(np.arange(7, 7 + N))  # SB3 numbers on from the first
    steps = [envs.step(rng.uniform(-1.5, 1.5, (N, n_actions)).astype(np.float32)) for _ in range(n_steps)]
    return first, *(np.stack(column) for column in zip(*steps, strict=True))


@pytest.mark.parametrize(
    ("make", "env", "n_actions"),
    [
        (sync, Walk, 2),
        (sync, Named, 2),
        (sync, Paired, 2),
        (sync, Scalar, 1),
        (dummy, Walk, 2),
        (dummy, Named, 2),
        (dummy, Paired, 2),
        (dummy, Scalar, 1),
    ],
)
def test_a_vector_environment_gives_what_its_copies_give(make, env, n_actions):
    ours = run(GymnasiumTask(limited(env)).make(N), n_actions)
    theirs = run(find(make(env)).make(N), n_actions)
    *_, terminated, truncated = ours
    for ends in (terminated, truncated):
        assert 0 < ends.sum() < ends.size / 2
        assert ends.any(0).all()
    for one, other in zip(ours, theirs, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("copy", [True, False])
def test_what_was_returned_is_not_overwritten_by_the_next_step(copy):
    envs = VectorTask(SyncVectorEnv([limited(Walk)] * N, copy=copy, autoreset_mode=AutoresetMode.SAME_STEP)).make(N)
    first = envs.reset(np.arange(N))
    kept = first.copy()
    step = envs.step(np.zeros((N, 2), np.float32))
    copies = [value.copy() for value in step]
    envs.step(np.ones((N, 2), np.float32))
    np.testing.assert_array_equal(first, kept)
    for value, before in zip(step, copies, strict=True):
        np.testing.assert_array_equal(value, before)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_other_autoreset_modes_are_refused_with_the_remedy(mode):
    remedy = "make it with autoreset_mode=gymnasium.vector.AutoresetMode.SAME_STEP"
    with pytest.raises(UsageError, match=f"SyncVectorEnv's autoreset mode is {mode}; .*{remedy}"):
        find(sync(Walk, mode))


def test_a_vector_environment_that_does_not_tell_its_mode_is_refused():
    envs = sync(Walk)
    envs.metadata = {}
    with pytest.raises(UsageError, match=r"SyncVectorEnv's autoreset mode is None; .*SAME_STEP"):
        find(envs)


class Choosing(Walk):
    action_space = Discrete(2)


@pytest.mark.parametrize(
    ("make", "name"), [(sync, "SyncVectorEnv"), (lambda env: DummyVecEnv([env]), "DummyVecEnv")], ids=["gym", "sb3"]
)
def test_actions_that_are_no_box_are_refused(make, name):
    with pytest.raises(UsageError, match=rf"{name} has actions Discrete\(2\); .*needs a Box"):
        find(make(Choosing))


def test_spaces_that_are_missing_are_refused():
    envs = sync(Walk)
    del envs.single_action_space
    with pytest.raises(UsageError, match=r"SyncVectorEnv has actions None; .*needs a Box"):
        find(envs)


@pytest.mark.parametrize("make", [sync, dummy])
def test_only_the_copies_that_there_are_can_be_had(make):
    task = find(make(Walk))
    assert task.given == N
    with pytest.raises(UsageError, match=f"2 copies are wanted of .*Vec.*, which has {N}; set n_envs to that"):
        task.make(2)


class Broken:
    """A vector environment whose answers are changed at step 5."""

    def change(self, *answer):
        return answer

    t = 0

    def step(self, actions):
        self.t += 1
        answer = super().step(actions)
        return type(self).change(*answer) if self.t == 5 else answer


class BrokenSync(Broken, SyncVectorEnv):
    pass


class BrokenDummy(Broken, DummyVecEnv):
    pass


def broken(base, change, env=Walk):
    kind = type("Cluster", (base,), {"change": staticmethod(change)})
    keywords = {"autoreset_mode": AutoresetMode.SAME_STEP} if base is BrokenSync else {}
    return kind([limited(env)] * N, **keywords)


def put(part, index, value):
    """Change an entry of one part of the answer."""

    def change(*answer):
        answer[part][index] = value
        return answer

    return change


def replace(part, value):
    return lambda *answer: (*answer[:part], value, *answer[part + 1 :])


def fail(*_):
    raise ZeroDivisionError("the cable")


SHAPE = r"they must be \(3, 2\)"
BOTH = {
    "NaN": (put(0, (1, 0), np.nan), r", copy 1, step 5: entry \[0\] of the observation is nan, which is not finite"),
    "Inf": (put(0, (2, 1), np.inf), r", copy 2, step 5: entry \[1\] of the observation is inf"),
    "rows": (replace(0, np.zeros((2, 2))), rf", step 5: the observations are .*of shape \(2, 2\); {SHAPE}"),
    "columns": (replace(0, np.zeros((3, 4))), rf", step 5: the observations are .*of shape \(3, 4\); {SHAPE}"),
    "ragged": (replace(0, [[1], [2, 3], []]), rf", step 5: the observations are \[\[1\].*; {SHAPE}"),
    "no observation": (replace(0, None), f", step 5: the observations are None; {SHAPE}"),
    "NaN reward": (put(1, 2, np.nan), r", copy 2, step 5: the reward is nan, which is not finite"),
    "two rewards": (replace(1, np.zeros(2)), r", step 5: the reward is .*of shape \(2,\); it must be 3 of float"),
    "no reward": (replace(1, None), ", step 5: the reward is None; it must be 3 of float"),
    "flags of numbers": (replace(2, np.zeros(3)), r", step 5: (terminated|dones) is .*; it must be 3 of bool"),
    "one flag": (replace(2, False), ", step 5: (terminated|dones) is False; it must be 3 of bool"),
    "two": (
        lambda *answer: answer[:2],
        r", step 5: step returned .*; it must return \(observations, rewards, .*infos\)",
    ),
    "None": (lambda *_: None, ", step 5: step returned None; it must return"),
    "an error": (fail, ", step 5: step raised ZeroDivisionError: the cable"),
}


def assert_named(base, change, message, env=Walk):
    envs = find(broken(base, change, env)).make(N)
    envs.reset(np.arange(N))
    for _ in range(4):
        envs.step(np.zeros((N, 2), np.float32))
    with pytest.raises(BrokenEnvironmentError, match=f"^Cluster{message}"):
        envs.step(np.zeros((N, 2), np.float32))


@pytest.mark.parametrize("base", [BrokenSync, BrokenDummy])
@pytest.mark.parametrize("name", BOTH)
def test_a_broken_vector_environment_is_named_by_copy_step_and_value(base, name):
    assert_named(base, *BOTH[name])


FINAL = "is missing in info, where an episode ended"
ENDED = np.array([False, True, False])


def end_with(infos):
    """Copy 1 ends, with those infos."""
    return lambda observed, rewards, *_: (
        (observed, rewards, ENDED, infos)
        if isinstance(infos, list)
        else (observed, rewards, ENDED, ~ENDED & ENDED, infos)
    )


def last(value):
    row = np.full(N, None, object)
    row[1] = value
    return {"final_obs": row}


@pytest.mark.parametrize(
    ("base", "infos", "message"),
    [
        (BrokenSync, {}, f"final_obs {FINAL}"),
        (BrokenSync, None, f"final_obs {FINAL}"),
        (BrokenSync, last(None), f"final_obs {FINAL}"),
        (BrokenSync, last(np.zeros(3)), r"the observation is .* of shape \(3,\); the space is"),
        (BrokenSync, last(np.array([0, np.nan])), r"entry \[1\] of the observation is nan"),
        (BrokenDummy, [{}, {}, {}], f"terminal_observation {FINAL}"),
        (BrokenDummy, [{}], f"terminal_observation {FINAL}"),
        (BrokenDummy, [{}, {"terminal_observation": np.zeros(3)}, {}], r"the observation is .* of shape \(3,\)"),
        (BrokenDummy, [{}, {"terminal_observation": [np.inf, 0]}, {}], r"entry \[0\] of the observation is inf"),
    ],
)
def test_a_broken_final_observation_is_named(base, infos, message):
    assert_named(base, end_with(infos), f", copy 1, step 5: {message}")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (
            {"z": np.array([0, np.nan, 0]), "a": np.zeros(N, int)},
            r", copy 1, step 5: the observation\['z'\] is nan, which is not finite",
        ),
        (
            {"z": np.zeros(N), "a": np.array([0, 0, 100])},
            r", copy 2, step 5: .*\['a'\] is np.int64\(100\), which is not in",
        ),
        ({"z": np.zeros(N)}, r", step 5: the observations are \{'z'"),
        ({"z": np.zeros(2), "a": np.zeros(2, int)}, ", step 5: there are 2 observations for 3 copies"),
    ],
)
def test_a_broken_part_of_a_vector_environments_observation_is_named(value, message):
    assert_named(BrokenSync, replace(0, value), message, Named)


class Resetting(SyncVectorEnv):
    def reset(self, **_):
        return np.zeros((N, 2))


def test_a_reset_of_the_old_kind_is_named():
    envs = find(Resetting([Walk] * N, autoreset_mode=AutoresetMode.SAME_STEP)).make(N)
    with pytest.raises(BrokenEnvironmentError, match=r"step 0: reset returned array.*it must return \(obs.*, infos\)"):
        envs.reset(np.arange(N))


make_model = functools.partial(galton.A2C, loss="gaussian", n_steps=5, net_arch=(4,))


def test_a_model_takes_as_many_copies_as_a_vector_environment_has_and_leaves_it_open():
    with pytest.raises(UsageError, match="n_envs is 2, but 3 were given; leave n_envs out"):
        make_model(sync(Walk), n_envs=2)
    envs = sync(Walk)
    model = make_model(envs)
    assert model.config.n_envs == N
    model.learn(10 * N, progress_bar=False)
    assert model.num_timesteps == 10 * N
    model.close()
    assert not envs.closed


def test_a_model_learns_the_same_from_every_kind_of_environment():
    models = [make_model(env, n_envs=n) for env, n in ((limited(Walk), N), (sync(Walk), None))]
    for model in models:
        model.learn(20 * N, progress_bar=False)
    models.append(make_model(limited(Walk), n_envs=N))
    one, other, fresh = (np.asarray(model.learner.params["critic"][0]["kernel"]) for model in models)
    np.testing.assert_array_equal(one, other)
    assert (one != fresh).any()
