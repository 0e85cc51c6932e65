import functools

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, Tuple
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import DictInfoToList
from stable_baselines3.common.vec_env import DummyVecEnv

import galton
from galton import AliasedObservation, UsageError
from galton.envs.find import find
from galton.envs.host.gymnasium import GymnasiumTask
from galton.envs.host.vector import VectorTask

from .vectors import Named, Walk, limited, sync
from .walks import N, assert_same, kind

PAIR = {"observation_space": Tuple([Box(-np.inf, np.inf, (1,)), Discrete(100)])}
Paired = kind("Paired", Walk, **PAIR, observe=lambda self: (np.array([self.position], np.float32), self.t))
Scalar = kind("Scalar", Walk, action_space=Box(-0.1, 0.3, (), np.float64))
Counting = kind("Counting", Walk, ends=lambda self: np.int64(Walk.ends(self)))
"""It says 0 and 1 for False and True."""
Constant = kind("Constant", Walk, observe=lambda self: np.ones(2, np.float32))
Choosing = kind("Choosing", Walk, action_space=Discrete(2))


def dummy(env):
    return DummyVecEnv([limited(env)] * N)


def run(envs, n_actions, n_steps=40):
    rng = np.random.default_rng(0)
    first = envs.reset(np.arange(7, 7 + N))  # SB3 numbers on from the first
    steps = [envs.step(rng.uniform(-1.5, 1.5, (N, n_actions)).astype(np.float32)) for _ in range(n_steps)]
    return first, *(np.stack(column) for column in zip(*steps, strict=True))


@pytest.mark.parametrize("make", [sync, dummy])
@pytest.mark.parametrize(("env", "n_actions"), [(Walk, 2), (Named, 2), (Paired, 2), (Scalar, 1)])
def test_a_vector_environment_gives_what_its_copies_give(make, env, n_actions):
    ours = run(GymnasiumTask(limited(env)).make(N), n_actions)
    theirs = run(find(make(env)).make(N), n_actions)
    *_, terminated, truncated = ours
    for ends in (terminated, truncated):
        assert 0 < ends.sum() < ends.size / 2
        assert ends.any(0).all()
    assert_same(ours, theirs)
    assert [one.dtype for one in ours] == [other.dtype for other in theirs]


def integers(make):
    """A vector environment whose own flags are integers."""
    envs = make(Counting)
    step = envs.step

    def counted(actions):
        observed, rewards, *flags, infos = step(actions)
        return observed, rewards, *(flag.astype(int) for flag in flags), infos

    envs.step = counted
    return envs


@pytest.mark.parametrize(
    "make",
    [
        lambda: DictInfoToList(sync(Walk)),
        lambda: DictInfoToList(sync(Named)),
        lambda: integers(sync),
        lambda: integers(dummy),
        lambda: sync(Counting),
    ],
    ids=["infos in a list", "Dict infos in a list", "integers", "sb3's integers", "copies' integers"],
)
def test_other_ways_to_say_the_same_are_read(make):
    envs = make()
    kind = Named if "z" in str(getattr(envs, "single_observation_space", "")) else Walk
    ours, theirs = run(GymnasiumTask(limited(kind)).make(N), 2), run(find(envs).make(N), 2)
    assert_same(ours, theirs)


class OneArray(Walk):
    """It returns one and the same array, again and again."""

    def observe(self):
        self.__dict__.setdefault("array", np.zeros(2, np.float32))[:] = super().observe()
        return self.array


class Home(Walk):
    """Its first and some of its last observations are the same."""

    def observe(self):
        return np.array([0 if self.ends() or not self.t else self.position, 0], np.float32)


@pytest.mark.parametrize("make", [sync, dummy])
def test_an_array_that_is_the_last_observation_and_the_next_first_is_noticed_once(make):
    envs = find(make(OneArray)).make(N)
    with pytest.warns(AliasedObservation, match=r"Vec.*Env: each of .*: return a copy \(observation.copy") as told:
        run(envs, 2, 200)
    assert len(told) == 1


@pytest.mark.parametrize("env", [Constant, Home, Walk, Named])
def test_what_only_looks_like_it_is_not_warned_of(env):
    for make in (sync, dummy):
        run(find(make(env)).make(N), 2)


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


def test_modes_and_spaces_that_can_not_be_used_are_refused_with_the_remedy():
    remedy = "make it with autoreset_mode=gymnasium.vector.AutoresetMode.SAME_STEP"
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED):
        with pytest.raises(UsageError, match=f"SyncVectorEnv's autoreset mode is {mode}; .*{remedy}"):
            find(sync(Walk, mode))
    silent, spaceless = sync(Walk), sync(Walk)
    silent.metadata = {}
    del spaceless.single_action_space
    with pytest.raises(UsageError, match=r"SyncVectorEnv's autoreset mode is None; .*SAME_STEP"):
        find(silent)
    with pytest.raises(UsageError, match=r"SyncVectorEnv has actions None of NoneType; Galton acts in Box"):
        find(spaceless)
    for envs in (sync(Choosing), DummyVecEnv([Choosing])):
        assert find(envs).actions.box.n_values == (2,)


@pytest.mark.parametrize("make", [sync, dummy])
def test_only_the_copies_that_there_are_can_be_had(make):
    task = find(make(Walk))
    assert task.given == N
    told = f"2 copies are wanted of .*Vec.*, which has {N}, and it can't be copied; set n_envs to that"
    with pytest.raises(UsageError, match=told):
        task.make(2)


make_model = functools.partial(galton.A2C, loss="gaussian", n_steps=5, net_arch=(4,))


def test_a_model_learns_the_same_from_every_kind_of_environment():
    models = [make_model(env, n_envs=n) for env, n in ((limited(Walk), N), (sync(Walk), None))]
    for model in models:
        model.learn(20 * N, progress_bar=False)
    models.append(make_model(limited(Walk), n_envs=N))
    one, other, fresh = (np.asarray(model.learner.params["critic"][0]["kernel"]) for model in models)
    np.testing.assert_array_equal(one, other)
    assert (one != fresh).any()
