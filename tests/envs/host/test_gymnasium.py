import functools
import itertools
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.wrappers import TimeLimit
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from galton import BrokenEnvironmentError, UsageError
from galton.envs.find import find
from galton.envs.host.gymnasium import GymnasiumTask

from .walks import LENGTH, Closing, N, Walk, assert_same, begun, play


def test_a_function_that_makes_no_new_environment_is_refused():
    one = Walk()
    for make in (lambda: one, lambda: TimeLimit(one, 5)):
        task = GymnasiumTask(make)
        with pytest.raises(UsageError, match="returned the same environment twice; it must make a new one"):
            task.make(2)


def test_copies_with_other_spaces_are_refused():
    for field, space in (("action_space", Box(-2, 2, (1,))), ("observation_space", Box(-1, 1, (2,)))):
        numbers = itertools.count()

        def make(numbers=numbers, field=field, space=space):
            env = Walk()
            if next(numbers):
                setattr(env, field, space)
            return env

        with pytest.raises(UsageError, match=rf"make's copies differ: one has {field[:3]}.*s Box\(.*, another Box\("):
            GymnasiumTask(make).make(2)


def made_of(*kinds):
    return [GymnasiumTask(kind).make(N) for kind in kinds]


class Leaky(Walk):
    """Hands out one buffer for all observations."""

    def observe(self):
        if not hasattr(self, "buffer"):
            self.buffer = np.zeros(2, np.float32)
        self.buffer[:] = super().observe()
        return self.buffer


class Writing(Walk):
    """Writes into its action."""

    def step(self, action):
        answer = super().step(action)
        action *= 0
        return answer


def answering(number, flag):
    class Answering(Walk):
        def step(self, action):
            observed, reward, ended, late, info = super().step(action)
            return observed, number(reward), flag(ended), flag(late), info

    return Answering


SLOPPY = [
    Leaky,
    Writing,
    answering(np.float32, np.bool),
    answering(float, int),
    answering(np.array, lambda flag: np.array(flag, np.int8)),
    answering(lambda value: [value], np.array),
    answering(lambda value: np.array([[value]]), lambda flag: np.asarray(flag)[()]),
]


def test_sloppy_environments_give_what_a_tidy_one_gives_and_do_not_change_the_actions():
    tidy, *answers = ([envs.reset(np.arange(N)), *play(envs, 10)] for envs in made_of(Walk, *SLOPPY))
    for answer in answers:
        assert_same(answer, tidy)
    envs = begun(Writing, 1)
    action = np.array([[0.5]], np.float32)
    envs.step(action)
    assert action == 0.5


def test_a_last_observation_that_the_reset_writes_over_is_looked_at_before():
    class Ending(Leaky):
        def observe(self):
            observed = super().observe()
            if self.ends():
                observed[0] = np.nan
            return observed

    envs = begun(Ending, 1)
    with pytest.raises(BrokenEnvironmentError, match=r"copy 0, step .*: entry \[0\] of the observation is nan"):
        play(envs, 2 * LENGTH)


@pytest.mark.parametrize(("shape", "dtype"), [((), np.float32), ((), np.float64), ((1,), np.float32), ((2, 3), float)])
def test_an_environment_gets_arrays_of_its_action_space(shape, dtype):
    class Checking(Walk):
        action_space = Box(np.full(shape, 0.1, dtype), np.full(shape, 0.3, dtype), dtype=dtype)

        def step(self, action):
            assert type(action) is np.ndarray
            assert action.dtype == dtype
            assert action in self.action_space
            return super().step(action)

    envs = begun(Checking, 2)
    for value in (-9, 0.1, 0.2, 0.3, 9):
        envs.step(np.full((2, int(np.prod(shape))), value, np.float32))


def test_the_final_observation_is_told_apart_from_the_next_episodes_first():
    envs = begun(Walk)
    following, final, _, terminated, truncated = play(envs, 2 * LENGTH)
    ends = np.arange(1, 2 * LENGTH + 1) % LENGTH == 0
    np.testing.assert_array_equal(terminated, np.tile(ends[:, None], N))
    assert not truncated.any()
    np.testing.assert_array_equal(final[ends, :, 1], LENGTH)
    np.testing.assert_array_equal(following[ends, :, 1], 0)
    np.testing.assert_array_equal(final[~ends], following[~ends])


@pytest.mark.parametrize(
    ("limit", "terminates", "truncates"), [(LENGTH - 1, False, True), (LENGTH, True, False), (LENGTH + 1, True, False)]
)
def test_a_time_limit_truncates_but_a_termination_at_the_limit_wins(limit, terminates, truncates):
    envs = begun(lambda: TimeLimit(Walk(), limit), 1)
    following, final, _, terminated, truncated = play(envs, min(limit, LENGTH), 1)
    assert (terminated[-1, 0], truncated[-1, 0]) == (terminates, truncates)
    assert final[-1, 0, 1] == min(limit, LENGTH)
    assert following[-1, 0, 1] == 0
    assert not (terminated | truncated)[:-1].any()


def test_seeds_decide_the_trajectories_copy_by_copy():
    def run(seeds):
        envs = GymnasiumTask(Walk).make(N)
        return [envs.reset(np.array(seeds)), *play(envs, 10)]

    assert_same(run([5, 6, 7]), run([5, 6, 7]))
    first = run([5, 6, 7])[0]
    assert len(set(first[:, 0])) == N
    assert_same(first[::-1], run([7, 6, 5])[0])


def test_a_given_environment_stays_open_and_the_copies_made_of_it_do_not():
    given = gymnasium.make(gymnasium.envs.registration.EnvSpec("Closing-v0", Closing, max_episode_steps=5))
    task = find(given)
    assert task.given == 1
    training, evaluation = task.make(1), task.make(2)
    copies = [env.unwrapped for env in evaluation._envs]
    assert len({id(env) for env in (given.unwrapped, *copies)}) == 3
    training.close()
    evaluation.close()
    assert given.unwrapped.closed == 0
    assert [env.closed for env in copies] == [1, 1]
    task = find(Walk())
    task.make(1)
    with pytest.raises(UsageError, match=r"'Walk', .*only one copy of it was given; give its id, or a function"):
        task.make(1)


def test_copies_that_were_made_are_closed_even_if_closing_fails():
    class Stuck(Closing):
        def close(self):
            super().close()
            raise RuntimeError("stuck")

    envs = GymnasiumTask(Stuck).make(2)
    envs.close()
    assert [env.closed for env in envs._envs] == [1, 1]


class Shutting(Walk):
    """Ends the process where an exception was meant."""

    def __init__(self, where=None):
        self.where = where
        self.leave("making")

    def leave(self, here):
        if self.where == here:
            sys.exit(3)

    def reset(self, *, seed=None, options=None):
        self.leave("reset")
        return super().reset(seed=seed)

    def step(self, action):
        self.leave("step")
        return super().step(action)

    def close(self):
        self.leave("close")


@pytest.mark.parametrize("vector", [False, True])
@pytest.mark.parametrize("where", ["reset", "step"])
def test_an_environment_that_ends_the_process_is_broken(where, vector):
    make = functools.partial(Shutting, where)
    envs = find(DummyVecEnv([make]) if vector else make).make(1)

    def reset_and_step():
        envs.reset(np.arange(1))
        envs.step(np.zeros((1, 1), np.float32))

    with pytest.raises(BrokenEnvironmentError, match=f"step .: {where} raised SystemExit: 3"):
        reset_and_step()


def test_ctrl_c_in_an_environment_is_no_fault_of_its_own_and_one_that_ends_when_it_is_closed_none_either():
    with pytest.raises(UsageError, match="can't be made: SystemExit: 3"):
        find(lambda: Shutting("making"))
    find(lambda: Shutting("close")).make(2).close()

    class Interrupted(Walk):
        def step(self, action):
            raise KeyboardInterrupt

    envs = begun(Interrupted, 1)
    with pytest.raises(KeyboardInterrupt):
        envs.step(np.zeros((1, 1), np.float32))


def test_a_function_without_a_name_has_that_of_what_it_makes():
    for make in (lambda: TimeLimit(Walk(), 5), functools.partial(Walk), functools.partial(lambda: Monitor(Walk()))):
        assert find(make).name == "Walk"


def test_a_monitored_environment_can_be_copied_without_its_monitor():
    given = Monitor(Monitor(gymnasium.make("MountainCarContinuous-v0")))
    task = find(given)
    training, evaluation = task.make(1), task.make(2)
    assert training._envs == [given]
    inner = {id(env.unwrapped) for env in (given, *evaluation._envs)}
    assert len(inner) == 3
    assert [type(env) for env in evaluation._envs] == [TimeLimit, TimeLimit]
    assert {env._max_episode_steps for env in evaluation._envs} == {999}


class Plain(gymnasium.Wrapper):
    """Gymnasium can't make it again."""


@pytest.mark.parametrize("around", [Plain, lambda env: TimeLimit(Monitor(env), 9), lambda env: Monitor(Plain(env))])
def test_what_can_not_be_copied_is_told_the_remedy_and_the_reason(around):
    task = find(around(gymnasium.make("MountainCarContinuous-v0")))
    task.make(1)
    remedy = r"a function that makes it, or evaluate on another: evaluate\(env=\.\.\.\).*RecordConstructorArgs"
    with pytest.raises(UsageError, match=remedy):
        task.make(1)
