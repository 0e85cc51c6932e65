"""What is handed over as an environment and is none, or is a record that lacks something."""

import dataclasses
import importlib.util
import os
import re
import subprocess
import sys
import tomllib

import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit

import galton
from galton import UsageError
from galton.envs import LQR, Bandit, Environment, MountainCar
from galton.envs.find import find
from galton.envs.jax_task import JaxTask

from .host.walks import Walk, kind

BOUNDS = ["action_low", "action_high", "observation_low", "observation_high"]
NUMBERS = ["max_episode_steps", "optimal_return", "random_return"]
MEMBERS = [*BOUNDS, *NUMBERS, "reset", "noise", "step", "observe"]


def without(*names):
    """A Mountain Car that lacks those members."""
    kept = {name: getattr(MountainCar, name) for name in MEMBERS if name not in names}
    return type("Hill", (), kept | {"__repr__": lambda self: "Hill()"})()


def test_a_record_with_all_members_is_taken_as_it_is():
    whole = without()
    assert isinstance(whole, Environment)
    assert find(whole).record is whole


def test_a_record_that_lacks_a_member_is_told_which():
    for name in MEMBERS:
        with pytest.raises(UsageError, match=rf"env is Hill\(\), a record that lacks {name}; .* not known is None"):
            find(without(name))
    with pytest.raises(UsageError, match=r"lacks action_low, random_return, noise; give it all of galton\.envs\.Envir"):
        find(without("random_return", "noise", "action_low"))
    bare = without(*({*MEMBERS} - {"reset", "step"}))  # what only resets and steps may be of any library
    for env in (bare, type("OfGym", (type(bare),), {"action_space": 1})()):
        with pytest.raises(UsageError, match=r"env is Hill\(\); give a Gymnasium id"):
            find(env)


def of_shape(name, shape):
    """LQR, of which one thing that a step gives has another shape."""

    def step(self, state, action, noise):
        state, *told = LQR.step(self, state, action, noise)
        given = dict(zip(("reward", "terminated"), told, strict=True))
        return (state, *(jnp.broadcast_to(value, shape) if name == each else value for each, value in given.items()))

    def observe(self, state):
        return jnp.zeros(shape) if name == "observation" else LQR.observe(self, state)

    return type("Odd", (LQR,), {"step": step, "observe": observe})()


@pytest.mark.skipif("CHECKED" in os.environ, reason="the checker refuses other types first")
def test_a_record_whose_end_is_a_number_is_refused_at_once():
    def step(self, state, action, noise):
        state, reward, terminated = LQR.step(self, state, action, noise)
        return state, reward, terminated.astype(float)

    with pytest.raises(UsageError, match="a record whose terminated is of float32; it must be of bool"):
        find(type("Odd", (LQR,), {"step": step})())


@pytest.mark.skipif("CHECKED" in os.environ, reason="the checker refuses other shapes first")
@pytest.mark.parametrize("name", ["observation", "reward", "terminated"])
def test_a_record_whose_step_gives_another_shape_is_refused_at_once(name):
    size = LQR().observation_low.size
    usual = (size,) if name == "observation" else ()
    assert isinstance(find(of_shape(name, usual)), JaxTask)
    for shape in ((1,), (size, 1), (size + 1,)):
        told = f"a record whose {name} has shape {shape}; it must have shape {usual}"
        with pytest.raises(UsageError, match=re.escape(told)):
            find(of_shape(name, shape))


@dataclasses.dataclass(frozen=True)
class Bounded(LQR):
    """Its bounds are a field of it."""

    limit: object = None

    @property
    def observation_high(self):
        return self.limit


@pytest.mark.skipif("CHECKED" in os.environ, reason="the checker refuses other types first")
@pytest.mark.parametrize(
    ("members", "told"),
    [
        (
            {"reset": lambda self, key: jnp.zeros(2, int)},
            r"state is int32 \(2,\) after reset and float32 .* after step",
        ),
        ({"observe": lambda self, state: [state[0]]}, r"observation has shape \(1,\); it must have shape \(2,\)"),
    ],
)
def test_a_record_that_no_program_can_train_on_is_refused_at_once(members, told):
    with pytest.raises(UsageError, match=told):
        find(type("Odd", (LQR,), members)())


@pytest.mark.parametrize("limit", [None, 1e3, 0])
def test_a_record_needs_a_time_limit_of_whole_steps(limit):
    members = {name: getattr(MountainCar, name) for name in MEMBERS} | {"max_episode_steps": limit}
    with pytest.raises(UsageError, match=f"max_episode_steps is {limit}; it must be an integer of at least 1"):
        find(type("Hill", (), members)())


def test_bounds_that_are_jax_arrays_are_taken_but_for_those_that_a_program_would_not_know():
    high = property(lambda self: jnp.ones(2))
    galton.A2C(type("High", (LQR,), {"observation_high": high})(), n_steps=5, n_envs=2).close()
    with pytest.raises(UsageError, match=r"bounds are made of its arrays, .* make them of NumPy's"):
        find(Bounded(limit=jnp.ones(2)))
    assert isinstance(find(Bounded(limit=(1.0, 1.0))), JaxTask)


def test_a_record_that_can_not_be_hashed_is_told_the_remedy_and_its_class_is_no_record():
    members = {name: getattr(MountainCar, name) for name in MEMBERS}
    melting = dataclasses.make_dataclass("Melting", [], namespace=members)()
    with pytest.raises(UsageError, match=r"Melting\(\), a record that can't be hashed, .*make it a frozen dataclass"):
        find(melting)
    with pytest.raises(UsageError, match=r"env is <class 'galton.envs.lqr.LQR'>, a class; .*by calling it"):
        find(LQR)


class Fails(Walk):
    def __init__(self):
        raise ZeroDivisionError("no robot")


class Failing(Walk):
    @property
    def action_space(self):
        raise NotImplementedError("which actions?")


Sightless = kind("Sightless", observation_space="two numbers")
ODD_SOURCES = {
    "a constructor that raises": (Fails, "environment is 'Fails', which can't be made: ZeroDivisionError: no robot"),
    "a function that returns none": (lambda: None, "is None, not a gymnasium.Env"),
    "a function that needs arguments": (lambda size: Walk(), "can't be made: TypeError: .*'size'"),
    "no observation space": (Sightless, "Sightless's observation_space is 'two numbers'; it must be a Gymnasium space"),
    "an action space that raises": (Failing, "Failing's action_space raised NotImplementedError: which actions"),
    "an id of no version": ("Pendulum", "environment is 'Pendulum', an id without its version; 'Pendulum-v1' is the"),
    "an unknown id": ("Wolk-v0", "environment is 'Wolk-v0'; Gymnasium knows no environment of that name"),
    "an id without its version": ("halfcheeta", r"environment is 'halfcheeta'; .*; did you mean HalfCheetah-v\d\?$"),
    "a name of ours, nearly": ("mountaincar", r"environment is 'mountaincar'; .*; did you mean mountain-car\?$"),
    "an id of one's own": (
        "My-v0",
        r".*; one of a module of yours is module:Class, or module:Id if it is registered\. [^;]*$",
    ),
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


def test_keyword_arguments_that_do_not_fit_are_refused():
    with pytest.raises(UsageError, match=r"environment is 'Pendulum-v1', .* unexpected keyword argument 'gravity'"):
        find("Pendulum-v1", gravity=9.81)
    for source, message in (
        (Walk, r"environment is 'Walk', which can't be made: TypeError: .*"),
        (Walk(), r"env_kwargs is {'g': 1}; it goes with what makes an environment, not with one that is there"),
        (LQR(), r"env_kwargs is {'g': 1}; it goes with what makes"),
    ):
        with pytest.raises(UsageError, match=message):
            find(source, g=1)


def test_a_class_and_a_function_are_called_with_the_keyword_arguments():
    class Limited(TimeLimit):
        def __init__(self, steps):
            super().__init__(Walk(), steps)

    for source in (Limited, lambda steps: TimeLimit(Walk(), steps)):
        envs = find(source, steps=2).make(2)
        envs.reset(np.zeros(2, int))
        ended = [envs.step(np.zeros((2, 1), np.float32)).truncated.tolist() for _ in range(3)]
        assert ended == [[False, False], [True, True], [False, False]]


def test_what_needs_box2d_says_how_to_install_it_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "Box2D", None)
    for module in [name for name in sys.modules if name.startswith("gymnasium.envs.box2d")]:
        monkeypatch.delitem(sys.modules, module)
    for name, kwargs in (("LunarLander-v3", {"continuous": True}), ("LunarLanderContinuous-v3", {})):
        with pytest.raises(UsageError, match=rf"^environment '{name}' needs Box2D: pip install .*\[box2d\]'$"):
            find(name, **kwargs)


@pytest.mark.slow
def test_box2d_is_imported_where_warnings_are_errors():
    """In a process of its own: Box2D's warning of itself, as an error, ends the process."""
    if importlib.util.find_spec("Box2D") is None:
        pytest.skip("Box2D is not installed")
    code = (
        "import galton; galton.PPO('LunarLander-v3', env_kwargs={'continuous': True}, n_envs=1, n_steps=64).learn(64)"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


IN_TOML = """
[[task]]
env = "bandit"
env_kwargs = { d = 16 }

[[task]]
env = "lqr"
env_kwargs = { R = [[0.01, 0.0], [0.0, 0.01]] }

[[task]]
env = "lqr"
env_kwargs = { max_episode_steps = 200, noise_std = 0.0, action_scale = 2.0 }
"""


def test_a_name_with_the_constants_of_a_toml_file_is_the_record_with_them():
    bandit, lqr, longer = (find(task["env"], **task["env_kwargs"]) for task in tomllib.loads(IN_TOML)["task"])
    assert bandit == JaxTask(Bandit(d=16))
    assert (lqr := lqr.record) == LQR(R=0.01 * np.eye(2))
    assert longer == JaxTask(LQR(max_episode_steps=200, noise_std=0.0), 2.0)
    assert hash(lqr) == hash(LQR(R=0.01 * np.eye(2)))
    assert lqr.rest_return - lqr.random_return < 0.4 * (lqr.optimal_return - lqr.random_return)


DOCK = """
import gymnasium, numpy

class Dock(gymnasium.Env):
    observation_space = action_space = gymnasium.spaces.Box(-1, 1, (2,))

    def __init__(self, wind=0.0):
        self.wind = wind

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        return numpy.zeros(2, numpy.float32), {}

    def step(self, action):
        return numpy.zeros(2, numpy.float32), self.wind, False, False, {}
"""


def test_a_class_in_a_module_is_an_environment_by_its_name(tmp_path, monkeypatch):
    (tmp_path / "dock.py").write_text(DOCK)
    monkeypatch.syspath_prepend(tmp_path)
    task = find("dock:Dock", wind=2.0)
    assert task.name == "dock:Dock"
    made = task.make(2)
    assert [envs[-1].wind for envs in made.layers] == [2.0, 2.0]
    with pytest.raises(UsageError, match=r"environment is 'dock:Duck'; module dock has no Duck; did you mean Dock\?"):
        find("dock:Duck")
    with pytest.raises(UsageError, match=r"environment is 'dock\.py:Dock'; give it as dock:Dock"):
        find("dock.py:Dock")
    monkeypatch.delitem(sys.modules, "dock")
