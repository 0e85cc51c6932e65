"""Our batched MuJoCo tasks against Gymnasium's, number by number."""

import contextlib
import re
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

from galton import BrokenEnvironmentError, UsageError
from galton.envs import find
from galton.envs.host import simulation
from galton.envs.host.mujoco import MujocoEnvs
from galton.envs.host.mujoco_functions import MUJOCO_FUNCTIONS
from galton.envs.host.simulation import unprofiled

COPIES = 4


def actions(task, rng):
    """A little beyond the box, so that clipping is seen."""
    low, high = task.actions.space.low, task.actions.space.high
    return rng.uniform(1.2 * low, 1.2 * high, (COPIES, *task.actions.space.shape)).astype(np.float32)


OTHER_CONSTANTS = [
    ("Ant-v5", {"include_cfrc_ext_in_observation": False, "max_episode_steps": 30}),
    ("Hopper-v5", {"terminate_when_unhealthy": False, "healthy_reward": 0.5, "max_episode_steps": 50}),
    ("HalfCheetah-v5", {"exclude_current_positions_from_observation": False, "ctrl_cost_weight": 0.3}),
    ("Reacher-v5", {"reward_dist_weight": 2, "reward_control_weight": 0.5}),
    ("Swimmer-v5", {"exclude_current_positions_from_observation": False, "max_episode_steps": 40, "frame_skip": 2}),
    (
        "Humanoid-v5",
        {f"include_{part}_in_observation": False for part in ("cinert", "cfrc_ext", "cvel", "qfrc_actuator")}
        | {"terminate_when_unhealthy": False, "healthy_z_range": (1.3, 1.4), "max_episode_steps": 60}
        | {"contact_cost_weight": 1e-3, "contact_cost_range": (0.1, 2.0)}
        | {"exclude_current_positions_from_observation": False},
    ),
    ("InvertedDoublePendulum-v5", {"healthy_reward": 2, "reset_noise_scale": 0.3}),
    ("Pusher-v5", {"reward_near_weight": 2, "reward_dist_weight": 0.25, "reward_control_weight": 1}),
]


def check_every_number_is_gymnasiums(name, kwargs, n_steps):
    """Step both side by side; return how many episodes terminated and how many were truncated."""
    task = find(name, **kwargs)
    envs, theirs = task.make(COPIES, 2), [gymnasium.make(name, **kwargs) for _ in range(COPIES)]
    assert isinstance(envs, MujocoEnvs)
    seeds = np.arange(COPIES) + 11
    first = envs.reset(seeds)
    exact = envs._observe()
    references = np.stack([env.reset(seed=int(seed))[0] for env, seed in zip(theirs, seeds, strict=True)])
    np.testing.assert_array_equal(exact, references)
    np.testing.assert_array_equal(first, references)

    rng, ended = np.random.default_rng(0), np.zeros(2, int)
    for _ in range(n_steps // COPIES):
        action = actions(task, rng)
        observation, reward, terminated, truncated = envs.simulate(action)
        for i, env in enumerate(theirs):
            one = np.clip(action[i], env.action_space.low, env.action_space.high)
            expected = env.step(one)
            np.testing.assert_array_equal(observation[i], expected[0])
            assert reward[i] == expected[1]
            assert terminated[i] == expected[2]
            assert truncated[i] == (expected[3] and not expected[2])
            if expected[2] or expected[3]:
                ended += (terminated[i], truncated[i])
                envs._begin(np.array([i]))
                np.testing.assert_array_equal(envs._observe()[i], env.reset()[0])
    envs.close()
    return ended


@pytest.mark.filterwarnings("ignore")  # Gymnasium's and MuJoCo's own
@pytest.mark.parametrize("name", MUJOCO_FUNCTIONS)
def test_a_hundred_steps_are_gymnasiums_to_the_last_bit(name):
    check_every_number_is_gymnasiums(name, {}, 100)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", MUJOCO_FUNCTIONS)
def test_ten_thousand_steps_are_gymnasiums_to_the_last_bit(name, trust):
    terminated, truncated = check_every_number_is_gymnasiums(name, {}, 10_000)
    assert terminated + truncated >= COPIES
    if MUJOCO_FUNCTIONS[name].ended is None:
        assert not terminated
    promise = "The nine MuJoCo tasks in batches are Gymnasium's to the last bit."
    trust("mujoco", promise, topic="numbers", figure=10_000, unit="equal steps", at_least=90_000, over="sum")


@pytest.mark.few
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("name", "kwargs"), OTHER_CONSTANTS)
def test_a_thousand_steps_are_too_with_other_constants(name, kwargs):
    check_every_number_is_gymnasiums(name, kwargs, 1_000)


@pytest.mark.few
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", MUJOCO_FUNCTIONS)
def test_a_state_that_is_put_back_goes_on_to_the_same_bits(name):
    task, rng = find(name, max_episode_steps=25), np.random.default_rng(1)
    envs, other = task.make(COPIES, 2), task.make(COPIES, 1)
    envs.reset(np.arange(COPIES))
    other.reset(np.arange(COPIES) + 100)
    for _ in range(40):
        envs.step(actions(task, rng))
    other.set_state(envs.get_state())
    for _ in range(60):  # through several resets
        action = actions(task, rng)
        for ours, theirs in zip(envs.step(action), other.step(action), strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["HalfCheetah-v5", "Ant-v5"])
def test_the_end_of_an_episode_is_reported_before_its_reset(name):
    task, rng = find(name, max_episode_steps=5), np.random.default_rng(2)
    envs = task.make(COPIES)
    envs.reset(np.arange(COPIES))
    for t in range(1, 11):
        steps = envs.step(actions(task, rng))
        assert steps.truncated.all() == (t % 5 == 0)
        moved = (steps.observation != steps.final_observation).any(1)
        assert (moved == steps.truncated).all()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["HalfCheetah-v5", "Ant-v5"])
@pytest.mark.parametrize("poison", [np.nan, 1e12])
def test_a_simulation_that_mujoco_reset_is_reported(name, poison):
    envs = find(name).make(3)
    envs.reset(np.arange(3))
    state = envs.get_state()
    state["physics"][1, 4] = poison
    envs.set_state(state)
    with pytest.raises(BrokenEnvironmentError, match=rf"{name}, step 1: MuJoCo found copy 1 unstable"):
        envs.step(np.zeros((3, envs._actions.low.size), np.float32))


def test_the_documents_name_each_task():
    text = (Path(__file__).parents[3] / "docs" / "own_environment.md").read_text()
    told = text.partition("## MuJoCo's, in batches")[2].partition("run in batches")[0]
    assert set(re.findall(r"`(\S+-v5)`", told)) == MUJOCO_FUNCTIONS.keys()


def test_a_wrong_argument_is_told_in_gymnasiums_words():
    with pytest.raises(UsageError, match=r"environment is 'Ant-v5', which can't be made: .*no_such"):
        find("Ant-v5", no_such=1)


STEP = mujoco.mjtTimer.mjTIMER_STEP


def seconds_of_a_step():
    """What MuJoCo's own profiler says of a step of its own."""
    simulated = gymnasium.make("Reacher-v5").unwrapped
    mujoco.mj_step(simulated.model, simulated.data)
    return simulated.data.timer[STEP].duration


@pytest.mark.parametrize("name", ["Reacher-v5", "Ant-v5"])  # in mujoco.batch, and in a loop
def test_a_profile_is_filled_again_once_we_have_simulated(name):
    assert seconds_of_a_step() > 0
    envs = find(name).make(4, 2)
    envs.reset(np.arange(4))
    envs.step(np.zeros((4, envs._actions.low.size), np.float32))
    envs.close()
    assert seconds_of_a_step() > 0


def test_no_profile_is_filled_within_and_a_clock_comes_back_after_an_error():
    with contextlib.suppress(ValueError), unprofiled():
        assert seconds_of_a_step() == 0
        with unprofiled():
            assert seconds_of_a_step() == 0
        assert seconds_of_a_step() == 0  # the outer one puts it back
        raise ValueError("of the test")
    assert seconds_of_a_step() > 0


def test_a_clock_of_the_users_own_is_put_back():
    mujoco.set_mjcb_time(lambda: 1.0)
    try:
        with unprofiled():
            seconds_of_a_step()
        assert mujoco.get_mjcb_time()() == 1.0
    finally:
        mujoco.set_mjcb_time(None)
    assert seconds_of_a_step() > 0


def test_without_the_library_in_its_package_nothing_is_changed(tmp_path, monkeypatch):
    monkeypatch.setattr(mujoco, "__file__", str(tmp_path / "__init__.py"))
    monkeypatch.setattr(simulation, "_CLOCK", simulation._clock())
    with unprofiled():
        assert seconds_of_a_step() > 0
