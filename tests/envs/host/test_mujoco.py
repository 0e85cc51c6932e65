"""Our batched MuJoCo tasks against Gymnasium's, number by number."""

import gymnasium
import numpy as np
import pytest

from galton import BrokenEnvironmentError, UsageError
from galton.envs import find
from galton.envs.host.mujoco_functions import MUJOCO_FUNCTIONS

COPIES = 4


def actions(task, rng):
    """A little beyond the box, so that clipping is seen."""
    return rng.uniform(-1.2, 1.2, (COPIES, *task.action_space.shape)).astype(np.float32)


@pytest.mark.filterwarnings("ignore")  # Gymnasium's and MuJoCo's own
@pytest.mark.parametrize(
    ("name", "kwargs"),
    [(name, {}) for name in MUJOCO_FUNCTIONS]
    + [
        ("Ant-v5", {"include_cfrc_ext_in_observation": False, "max_episode_steps": 30}),
        ("Hopper-v5", {"terminate_when_unhealthy": False, "healthy_reward": 0.5, "max_episode_steps": 50}),
        ("HalfCheetah-v5", {"exclude_current_positions_from_observation": False, "ctrl_cost_weight": 0.3}),
        ("Reacher-v5", {"reward_dist_weight": 2, "reward_control_weight": 0.5}),
    ],
)
def test_ten_thousand_steps_are_gymnasiums_to_the_last_bit(name, kwargs, trust):
    task = find(name, **kwargs)
    envs, theirs = task.make(COPIES, 2), [gymnasium.make(name, **kwargs) for _ in range(COPIES)]
    seeds = np.arange(COPIES) + 11
    first = envs.reset(seeds)
    exact = envs._observe()
    references = np.stack([env.reset(seed=int(seed))[0] for env, seed in zip(theirs, seeds, strict=True)])
    np.testing.assert_array_equal(exact, references)
    np.testing.assert_array_equal(first, references.astype(np.float32))

    rng, ended = np.random.default_rng(0), 0
    n = 10_000 // COPIES if not kwargs else 250
    for _ in range(n):
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
                ended += 1
                envs._begin(np.array([i]))
                np.testing.assert_array_equal(envs._observe()[i], env.reset()[0])
    assert ended >= (4 if name == "HalfCheetah-v5" and not kwargs else 0)
    envs.close()
    promise = "Reacher, HalfCheetah, Ant, Hopper and Walker2d in batches are Gymnasium's to the last bit."
    trust("mujoco", promise, topic="numbers", figure=n * COPIES, unit="equal steps", at_least=50_000, over="sum")


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


def test_a_wrong_argument_is_told_in_gymnasiums_words():
    with pytest.raises(UsageError, match=r"environment is 'Ant-v5', which can't be made: .*no_such"):
        find("Ant-v5", no_such=1)
