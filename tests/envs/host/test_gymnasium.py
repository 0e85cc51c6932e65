import functools
import itertools
import warnings

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete, Tuple
from gymnasium.wrappers import TimeLimit

import galton
from galton import BrokenEnvironmentError, UsageError
from galton.envs.find import find
from galton.envs.host.gymnasium import GymnasiumTask

LENGTH, N = 3, 3
"""Steps of an episode, and copies in most tests."""


class Walk(gymnasium.Env):
    """Well-behaved: sums its actions and its generator's noise, terminates after LENGTH steps."""

    observation_space = Box(-np.inf, np.inf, (2,))
    action_space = Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.position, self.t = self.np_random.normal(), 0
        return self.observe(), {}

    def observe(self):
        return np.array([self.position, self.t], np.float32)

    def step(self, action):
        self.position += float(action.sum()) + self.np_random.normal()
        self.t += 1
        return self.observe(), self.position, self.t == LENGTH, False, {}


class Walks:
    """Makes Walks whose answers are changed at one step of one copy, counted from the copy's first reset."""

    def __init__(self, change, copy=2, at=37, base=Walk):
        self.change, self.copy, self.at, self.base = change, copy, at, base
        self.numbers, self.__name__ = itertools.count(), "Odd"

    def __call__(self):
        number, walks = next(self.numbers), self

        class Odd(walks.base):
            n_steps = 0

            def step(self, action):
                self.n_steps += 1
                answer = super().step(action)
                return walks.change(*answer) if (number, self.n_steps) == (walks.copy, walks.at) else answer

        return Odd()


def observation(value):
    return lambda _, *others: (value, *others)


def reward(value):
    return lambda observed, _, *others: (observed, value, *others)


def terminated(value):
    return lambda observed, reward, _, *others: (observed, reward, value, *others)


def truncated(value):
    return lambda observed, reward, ended, _, info: (observed, reward, ended, value, info)


def fail(*_):
    raise ZeroDivisionError("the robot fell over")


class Unconvertible:
    def __array__(self, *_, **__):
        raise RuntimeError("no array")

    def __repr__(self):
        return "<unconvertible>"


SHAPE = r"the space is Box\(-inf, inf, \(2,\), float32\)"
FIVE = r"it must return \(observation, reward, terminated, truncated, info\)"
BROKEN_STEPS = {
    "observation NaN": (observation([0.0, np.nan]), r"entry \[1\] of the observation is nan, which is not finite"),
    "observation Inf": (observation([-np.inf, 0.0]), r"entry \[0\] of the observation is -inf, which is not finite"),
    "observation beyond float32": (observation([0.0, 1e39]), r"entry \[1\] .* 1e\+39, which is too large for float32"),
    "observation's shape": (observation(np.zeros(3)), rf"the observation is array.*of shape \(3,\); {SHAPE}"),
    "observation with an axis": (
        observation(np.zeros((1, 2))),
        rf"the observation is array.*of shape \(1, 2\); {SHAPE}",
    ),
    "observation None": (observation(None), f"the observation is None; {SHAPE}"),
    "observation text": (observation("ab"), f"the observation is 'ab'; {SHAPE}"),
    "observation of text": (observation(["1", "2"]), rf"the observation is \['1', '2'\]; {SHAPE}"),
    "observation ragged": (observation([[1], [2, 3]]), rf"the observation is \[\[1\], \[2, 3\]\]; {SHAPE}"),
    "observation of objects": (
        observation(np.array([1, {}], object)),
        f"the observation is array.*dtype=object.*; {SHAPE}",
    ),
    "observation complex": (observation([1j, 0]), rf"the observation is \[1j, 0\]; {SHAPE}"),
    "observation a dict": (observation({"a": 1}), rf"the observation is {{'a': 1}}; {SHAPE}"),
    "observation not convertible": (observation(Unconvertible()), f"the observation is <unconvertible>; {SHAPE}"),
    "reward NaN": (reward(np.nan), "the reward is nan, which is not finite"),
    "reward Inf": (reward(np.float64(np.inf)), "the reward is inf, which is not finite"),
    "reward beyond float32": (reward(-1e300), r"the reward is -1e\+300, which is too large for float32"),
    "reward beyond float64": (reward(10**400), r"the reward is 10+\.\.\.; it must be one number"),
    "reward None": (reward(None), "the reward is None; it must be one number"),
    "reward text": (reward("1.0"), "the reward is '1.0'; it must be one number"),
    "reward of two": (reward(np.ones(2)), r"the reward is array\(\[1., 1.\]\) of shape \(2,\); it must be one number"),
    "reward of none": (reward([]), r"the reward is \[\]; it must be one number"),
    "reward ragged": (reward([[1], [2, 3]]), r"the reward is \[\[1\], \[2, 3\]\]; it must be one number"),
    "reward complex": (reward(1 + 2j), r"the reward is \(1\+2j\); it must be one number"),
    "reward not convertible": (reward(Unconvertible()), "the reward is <unconvertible>; it must be one number"),
    "terminated None": (terminated(None), "terminated is None; it must be True or False"),
    "terminated NaN": (terminated(np.nan), "terminated is nan; it must be True or False"),
    "terminated 2": (terminated(2), "terminated is 2; it must be True or False"),
    "terminated text": (terminated("False"), "terminated is 'False'; it must be True or False"),
    "terminated of two": (terminated(np.array([True, False])), "terminated is array.*; it must be True or False"),
    "truncated a float": (truncated(0.0), "truncated is 0.0; it must be True or False"),
    "four of the old gym": (lambda o, r, done, _, info: (o, r, done, info), rf"step returned \(array.*{FIVE}"),
    "six": (lambda *answer: (*answer, None), f"step returned .*{FIVE}"),
    "a list": (lambda *answer: list(answer), f"step returned .*{FIVE}"),
    "None": (lambda *_: None, f"step returned None; {FIVE}"),
    "an error": (fail, "step raised ZeroDivisionError: the robot fell over"),
}


def random_actions(n_copies, seed=0):
    rng = np.random.default_rng(seed)
    while True:
        yield rng.uniform(-1, 1, (n_copies, 1)).astype(np.float32)


def play(envs, n_steps, n_copies=N, seed=0):
    """The stacked answers of that many steps."""
    steps = [envs.step(action) for _, action in zip(range(n_steps), random_actions(n_copies, seed), strict=False)]
    return [np.stack(column) for column in zip(*steps, strict=True)]


def assert_same(first, second):
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", BROKEN_STEPS)
def test_a_broken_step_is_named_by_copy_step_and_value(name):
    change, message = BROKEN_STEPS[name]
    envs = GymnasiumTask(Walks(change)).make(N)
    envs.reset(np.arange(N))
    play(envs, 36)
    with pytest.raises(BrokenEnvironmentError, match=f"^Odd, copy 2, step 37: {message}"):
        play(envs, 1)


PARTS = Dict(a=Box(-1, 1, (2,)), b=Tuple([Discrete(3), MultiDiscrete([2, 2])]))


class Parts(Walk):
    observation_space = PARTS

    def observe(self):
        return {"a": np.zeros(2, np.float32), "b": (2, np.array([0, 1]))}


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"a": np.zeros(2)}, r"the keys of the observation are \['a'\]"),
        ({"a": np.zeros(2), "b": (2, [0, 1]), "c": 0}, "the keys of the observation are"),
        ({"a": np.zeros(3), "b": (2, [0, 1])}, r"the observation\['a'\] is .*must have shape \(2,\)"),
        ({"a": [0, np.nan], "b": (2, [0, 1])}, r"entry \[1\] of the observation\['a'\] is nan"),
        ({"a": np.zeros(2), "b": (3, [0, 1])}, r"the observation\['b'\]\[0\] is 3, which is not in Discrete\(3\)"),
        ({"a": np.zeros(2), "b": (2, [2, 0])}, r"the observation\['b'\]\[1\] is \[2, 0\], which is not in Multi"),
    ],
)
def test_a_broken_part_of_an_observation_is_named(value, message):
    envs = GymnasiumTask(Walks(observation(value), copy=1, at=5, base=Parts)).make(2)
    assert envs.reset(np.arange(2)).shape == (2, 2 + 3 + 4)
    play(envs, 4, 2)
    with pytest.raises(BrokenEnvironmentError, match=f"^Odd, copy 1, step 5: .*{message}"):
        play(envs, 1, 2)


def resets(answer):
    """An environment that is reset like this from its second episode on, in copy 1."""
    numbers = itertools.count()

    def make():
        number = next(numbers)

        class Resets(Walk):
            n_resets = 0

            def reset(self, *, seed=None, options=None):
                good = super().reset(seed=seed)
                self.n_resets += 1
                return answer(*good) if (number, self.n_resets) == (1, 2) else good

        return Resets()

    return make


RESET_TWO = r"reset returned .*; it must return \(observation, info\)"
BROKEN_RESETS = {
    "raises": (fail, "reset raised ZeroDivisionError: the robot fell over"),
    "only an observation": (lambda observed, _: observed, RESET_TWO),
    "None": (lambda *_: None, RESET_TWO),
    "three": (lambda *good: (*good, 1), RESET_TWO),
    "shape": (lambda *_: (np.zeros(5), {}), r"reset: the observation is .* of shape \(5,\); the space is"),
    "NaN": (lambda *_: ([np.nan, 0], {}), r"reset: entry \[0\] of the observation is nan"),
}


@pytest.mark.parametrize("name", BROKEN_RESETS)
def test_a_broken_reset_is_named_by_copy_and_step(name):
    answer, message = BROKEN_RESETS[name]
    envs = GymnasiumTask(resets(answer)).make(2)
    envs.reset(np.arange(2))
    play(envs, LENGTH - 1, 2)
    with pytest.raises(BrokenEnvironmentError, match=f"copy 1, step {LENGTH}: ?{message}"):
        play(envs, 1, 2)


def test_a_reset_without_a_seed_is_named():
    class Old(Walk):
        def reset(self):
            return super().reset()

    with pytest.raises(BrokenEnvironmentError, match=r"Old, copy 0, step 0: reset raised TypeError: .*'seed'"):
        GymnasiumTask(Old).make(1).reset(np.arange(1))


class Fails(Walk):
    def __init__(self):
        raise ZeroDivisionError("no robot")


class Failing(Walk):
    @property
    def action_space(self):
        raise NotImplementedError("which actions?")


class Spaceless(gymnasium.Env):
    observation_space = Walk.observation_space


class Sightless(Walk):
    observation_space = "two numbers"


class Discretes(Walk):
    action_space = Discrete(2)


ODD_SOURCES = {
    "a constructor that raises": (Fails, "environment is 'Fails', which can't be made: ZeroDivisionError: no robot"),
    "a function that returns none": (lambda: None, "is None, not a gymnasium.Env"),
    "a function that returns its name": (lambda: "Walk", "is 'Walk', not a gymnasium.Env"),
    "a function that needs arguments": (lambda size: Walk(), "can't be made: TypeError: .*'size'"),
    "no action space": (Spaceless, "Spaceless's action_space is None; it must be a Gymnasium space"),
    "no observation space": (Sightless, "Sightless's observation_space is 'two numbers'; it must be a Gymnasium space"),
    "discrete actions": (Discretes(), r"Discretes has actions Discrete\(2\); .*needs a Box"),
    "an action space that raises": (Failing, "Failing's action_space raised NotImplementedError: which actions"),
    "an unknown id": ("Wolk-v0", "environment is 'Wolk-v0'; Gymnasium knows no environment of that name"),
    "an id in small letters": ("pendulum-v1", "environment is 'pendulum-v1'; .*Did you mean: `Pendulum`"),
    "an unknown namespace": ("nowhere/Walk-v0", "environment is 'nowhere/Walk-v0'; Gymnasium knows no"),
    "an unknown module": ("nomodule:Walk-v0", "environment is 'nomodule:Walk-v0', .*: ModuleNotFoundError"),
    "an unknown version": ("Pendulum-v99", "environment is 'Pendulum-v99'; .* provides versioned environments: .*v1"),
    "a number": (3, "env is 3; give a Gymnasium id, an environment, a function that makes one, or a name"),
    "nothing": (None, "env is None; give a Gymnasium id"),
}


@pytest.mark.parametrize("name", ODD_SOURCES)
def test_what_is_no_environment_is_refused_with_the_reason(name):
    source, message = ODD_SOURCES[name]
    with pytest.raises(UsageError, match=message):
        find(source)


@pytest.mark.parametrize(
    ("source", "kwargs", "message"),
    [
        ("Pendulum-v1", {"gravity": 9.81}, r"environment is 'Pendulum-v1', .* unexpected keyword argument 'gravity'"),
        (Walk, {"g": 1}, r"env_kwargs is {'g': 1}; it goes with a name or an id"),
        (Walk(), {"g": 1}, r"env_kwargs is {'g': 1}; it goes with a name or an id"),
    ],
)
def test_keyword_arguments_that_do_not_fit_are_refused(source, kwargs, message):
    with pytest.raises(UsageError, match=message):
        find(source, **kwargs)


def test_a_function_that_makes_no_new_environment_is_refused():
    one = Walk()
    for make in (lambda: one, lambda: TimeLimit(one, 5)):
        task = GymnasiumTask(make)
        with pytest.raises(UsageError, match="returned the same environment twice; it must make a new one"):
            task.make(2)


@pytest.mark.parametrize(
    ("field", "space", "message"),
    [("action_space", Box(-2, 2, (1,)), "actions"), ("observation_space", Box(-1, 1, (2,)), "observations")],
)
def test_copies_with_other_spaces_are_refused(field, space, message):
    numbers = itertools.count()

    def make():
        env = Walk()
        if next(numbers):
            setattr(env, field, space)
        return env

    with pytest.raises(UsageError, match=rf"make's copies differ: one has {message} Box\(.*, another Box\("):
        GymnasiumTask(make).make(2)


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


@pytest.mark.parametrize(
    "sloppy",
    [
        Leaky,
        Writing,
        answering(np.float64, np.bool),
        answering(np.float32, bool),
        answering(np.array, np.array),
        answering(lambda value: [value], bool),
        answering(lambda value: np.array([[value]]), lambda flag: np.asarray(flag)[()]),
    ],
)
def test_sloppy_environments_give_what_a_tidy_one_gives(sloppy):
    answers = []
    for made in (Walk, sloppy):
        envs = GymnasiumTask(made).make(N)
        first = envs.reset(np.arange(N))
        answers.append([first, *play(envs, 10)])
    assert_same(*answers)


def test_the_actions_are_not_changed_by_an_environment_that_writes_into_them():
    envs = GymnasiumTask(Writing).make(1)
    envs.reset(np.arange(1))
    action = np.array([[0.5]], np.float32)
    envs.step(action)
    assert action == 0.5


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(), (1,), (2, 3)])
def test_an_environment_gets_arrays_of_its_action_space(shape, dtype):
    class Checking(Walk):
        action_space = Box(np.full(shape, 0.1, dtype), np.full(shape, 0.3, dtype), dtype=dtype)

        def step(self, action):
            assert type(action) is np.ndarray
            assert action.dtype == dtype
            assert action in self.action_space
            return super().step(action)

    envs = GymnasiumTask(Checking).make(2)
    envs.reset(np.arange(2))
    size = int(np.prod(shape))
    for value in (-9, 0.1, 0.2, 0.3, 9):
        envs.step(np.full((2, size), value, np.float32))


def test_the_final_observation_is_told_apart_from_the_next_episodes_first():
    envs = GymnasiumTask(Walk).make(N)
    envs.reset(np.arange(N))
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
    envs = GymnasiumTask(lambda: TimeLimit(Walk(), limit)).make(1)
    envs.reset(np.arange(1))
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


class Stateful(Walk):
    def get_state(self):
        return {"position": self.position, "t": np.array([self.t])}

    def set_state(self, state):
        self.position, self.t = float(state["position"]), int(state["t"][0])


def test_environments_go_on_exactly_from_their_states():
    task = GymnasiumTask(lambda: TimeLimit(Stateful(), LENGTH - 1))
    envs, others = task.make(N), task.make(N)
    envs.reset(np.arange(N))
    others.reset(np.arange(N) + 50)
    play(envs, 4 * (LENGTH - 1) + 1)
    state = {key: value.copy() for key, value in envs.get_state().items()}
    assert {value.shape[0] for value in state.values()} == {N}
    expected = play(envs, 10, seed=1)
    assert expected[-1].any()
    others.set_state(state)
    assert_same(play(others, 10, seed=1), expected)


def test_environments_that_can_not_tell_their_states_say_none():
    envs = GymnasiumTask(Walk).make(N)
    envs.reset(np.arange(N))
    assert envs.get_state() is None


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (lambda _: [1], r"get_state returned \[1\], not a dict of arrays"),
        (lambda _: {"a": "text"}, "get_state's 'a' is 'text', not numbers"),
        (lambda _: {"a": Unconvertible()}, "get_state's 'a' is <unconvertible>, not numbers"),
        (lambda self: {"a": np.zeros(int(1e3 * abs(self.position)))}, r"get_state returned .*, but copy 0"),
        (lambda self: 1 / 0, "get_state raised ZeroDivisionError"),
    ],
)
def test_a_broken_state_is_named(state, message):
    class Strange(Stateful):
        get_state = state

    envs = GymnasiumTask(Strange).make(2)
    envs.reset(np.arange(2))
    with pytest.raises(BrokenEnvironmentError, match=rf"^Strange, copy \d, step 0: {message}"):
        envs.get_state()


class Closing(Walk):
    closed = 0

    def close(self):
        self.closed += 1


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


def test_a_second_copy_of_an_environment_without_a_spec_is_refused():
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


# Through A2C: one compiled program for all.

CONFIG = {"loss": "gaussian", "n_steps": 5, "net_arch": (4,)}
make_model = functools.partial(galton.A2C, n_envs=N, **CONFIG)


def bits(tree):
    return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(tree)]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (BROKEN_STEPS["observation NaN"][0], r"entry \[1\] of the observation is nan"),
        (BROKEN_STEPS["reward Inf"][0], "the reward is inf"),
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
    class Blind(Walk):
        def observe(self):
            return np.full(2, np.nan)

    with pytest.raises(BrokenEnvironmentError, match=r"^Blind, copy 0, step 0: reset: entry \[0\] of the obs"):
        make_model(Blind)


def test_an_evaluation_that_never_ends_is_stopped(monkeypatch):
    class Endless(Walk):
        def step(self, action):
            observed, reward, _, late, info = super().step(action)
            return observed, reward, False, late, info

    monkeypatch.setattr("galton.training.evaluate.MAX_STEPS", 20)
    model = make_model(Endless)
    with pytest.raises(BrokenEnvironmentError, match="Endless: an episode of evaluation did not end in 20 steps; give"):
        model.evaluate(2)
    assert len(make_model(lambda: TimeLimit(Endless(), 20)).evaluate(2)) == 2


def test_a_given_environment_trains_alone_and_is_evaluated_only_if_it_can_be_made_again():
    given = Closing()
    model = galton.A2C(given, **CONFIG).learn(10, progress_bar=False)
    with pytest.raises(UsageError, match="only one copy of it was given; give its id, or a function"):
        model.evaluate(1)
    assert len(model.evaluate(2, env=Closing)) == 2
    model.close()
    assert not given.closed
    with pytest.raises(UsageError, match="n_envs is 2, but one environment was given; leave n_envs out, or give an id"):
        galton.A2C(given, n_envs=2, **CONFIG)


def test_a_model_goes_on_exactly_with_environments_that_tell_their_states(tmp_path):
    def make():
        return TimeLimit(Stateful(), 7)

    whole = make_model(make).learn(20 * N, progress_bar=False)
    half = make_model(make).learn(10 * N, progress_bar=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error", galton.InexactResume)
        again = galton.A2C.load(half.save(tmp_path / "half"), env=make)
    again.learn(10 * N, progress_bar=False)
    assert bits(again.learner) == bits(whole.learner)
