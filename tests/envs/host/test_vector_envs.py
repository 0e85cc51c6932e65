import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space
from stable_baselines3.common.vec_env import DummyVecEnv

from galton import BrokenEnvironmentError
from galton.envs.find import find

from .vectors import Named, Walk, limited
from .walks import N


class Broken:
    """A vector environment whose answers are changed at step 5."""

    def change(self, *answer):
        return answer

    t = 0

    def step(self, actions):
        self.t += 1
        answer = super().step(actions)
        return type(self).change(*answer) if self.t == 5 else answer


def broken(base, change, env=Walk):
    kind = type("Cluster", (Broken, base), {"change": staticmethod(change)})
    keywords = {"autoreset_mode": AutoresetMode.SAME_STEP} if base is SyncVectorEnv else {}
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
    "no observation": (replace(0, None), f", step 5: the observations are None; {SHAPE}"),
    "NaN reward": (put(1, 2, np.nan), r", copy 2, step 5: the reward is nan, which is not finite"),
    "two rewards": (replace(1, np.zeros(2)), r", step 5: the reward is .*of shape \(2,\); it must be 3 of float"),
    "no reward": (replace(1, None), ", step 5: the reward is None; it must be 3 of float"),
    "flags beyond 1": (replace(2, np.array([0, 1, 2])), r", step 5: (terminated|dones) is .*; it must be 3 of bool"),
    "one flag": (replace(2, False), ", step 5: (terminated|dones) is False; it must be 3 of bool"),
    "two": (lambda *answer: answer[:2], r", step 5: step returned .*; it must return \(observations, .*infos\)"),
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


@pytest.mark.parametrize("base", [SyncVectorEnv, DummyVecEnv])
def test_a_broken_vector_environment_is_named_by_copy_step_and_value(base):
    for change, message in BOTH.values():
        assert_named(base, change, message)


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


def test_a_broken_final_observation_is_named():
    shape = r"the observation is .* of shape \(3,\)"
    for base, infos, message in (
        (SyncVectorEnv, {}, f"final_obs {FINAL}"),
        (SyncVectorEnv, None, f"final_obs {FINAL}"),
        (SyncVectorEnv, last(None), f"final_obs {FINAL}"),
        (SyncVectorEnv, last(np.zeros(3)), shape),
        (SyncVectorEnv, last(np.array([0, np.nan])), r"entry \[1\] of the observation is nan"),
        (DummyVecEnv, [{}, {}, {}], f"terminal_observation {FINAL}"),
        (DummyVecEnv, [{}], f"terminal_observation {FINAL}"),
        (DummyVecEnv, [{}, {"terminal_observation": np.zeros(3)}, {}], shape),
        (DummyVecEnv, [{}, {"terminal_observation": [np.inf, 0]}, {}], r"entry \[0\] of the observation is inf"),
    ):
        assert_named(base, end_with(infos), f", copy 1, step 5: {message}")


def test_a_broken_part_of_a_vector_environments_observation_is_named():
    good = {"z": np.zeros(N), "a": np.zeros(N, int)}
    for value, message in (
        (
            good | {"z": np.array([0, np.nan, 0])},
            r", copy 1, step 5: the observation\['z'\] is nan, which is not finite",
        ),
        (good | {"a": np.array([0, 0, 100])}, r", copy 2, step 5: .*\['a'\] is np.int64\(100\), which is not in"),
        ({"z": np.zeros(N)}, r", step 5: the observations are \{'z'"),
        ({"z": np.zeros(2), "a": np.zeros(2, int)}, ", step 5: there are 2 observations for 3 copies"),
    ):
        assert_named(SyncVectorEnv, replace(0, value), message, Named)


class Resetting(SyncVectorEnv):
    def reset(self, **_):
        return np.zeros((N, 2))


def test_a_reset_of_the_old_kind_is_named():
    envs = find(Resetting([Walk] * N, autoreset_mode=AutoresetMode.SAME_STEP)).make(N)
    with pytest.raises(BrokenEnvironmentError, match=r"step 0: reset returned array.*it must return \(obs.*, infos\)"):
        envs.reset(np.arange(N))


class OfOneSeed(VectorEnv):
    """As Gymnasium declares it: a reset takes one seed. It holds something of its own as `envs`."""

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012, as Gymnasium has it
    num_envs, envs = N, np.zeros((N, 4))
    single_observation_space, single_action_space = Walk.observation_space, Walk.action_space
    observation_space, action_space = batch_space(Walk.observation_space, N), batch_space(Walk.action_space, N)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.normal(size=(N, 2)).astype(np.float32), {}

    def step(self, action):
        return np.zeros((N, 2), np.float32), np.ones(N), np.zeros(N, bool), np.zeros(N, bool), {}


def test_a_vector_environment_of_ones_own_takes_one_seed_and_may_hold_anything():
    envs = find(OfOneSeed()).make(N)
    first, other, again = (envs.reset(np.arange(N) + seed) for seed in (3, 4, 3))
    np.testing.assert_array_equal(first, again)
    assert np.all(first != other)
    assert len(envs.layers) == N
