"""Robots that change, beside Gymnasium's whose models are changed by hand, and a clock that goes on through all."""

import os

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import galton
from galton import UsageError
from galton.envs import find
from galton.envs.host.carried import remember
from galton.envs.host.gears import Gears
from galton.training.host_evaluation import Evaluator
from galton.training.population import populate

ROBOTS = {"HalfCheetah": ("bthigh", "bshin", "bfoot"), "Ant": ("hip_1", "ankle_1")}
CHANGES = ("reversal", "leg", "friction", "cosine")
PERIOD = 7


def changed_by_hand(usual, model, robot, change, t):
    """Give a model what it is to have in the step after t others, from another that stays as it is."""
    gears, friction = usual.actuator_gear.copy(), usual.geom_friction.copy()
    if change == "cosine":
        gears[:, 0] *= np.cos(2 * np.pi * (t % PERIOD) / PERIOD)
    elif t // PERIOD in (1, 3, 5):
        for joint in ROBOTS[robot] if change == "leg" else ():
            gears[[mujoco.mj_id2name(usual, 3, i) == joint for i in usual.actuator_trnid[:, 0]]] = 0
        gears *= -1 if change == "reversal" else 1
        friction *= 0.3 if change == "friction" else 1
    model.actuator_gear[:], model.geom_friction[:] = gears, friction


def plain(robot):
    return gymnasium.make(f"{robot}-v5").unwrapped


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("change", CHANGES)
def test_steps_are_gymnasiums_whose_model_is_changed_by_hand(robot, change):
    ours = gymnasium.make(f"galton/{robot}Gears-v0", change=change, period=PERIOD)
    theirs, usual, rng = plain(robot), plain(robot).model, np.random.default_rng(0)
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    for t in range(5 * PERIOD):
        changed_by_hand(usual, theirs.model, robot, change, t)
        for name in ("actuator_gear", "geom_friction"):
            np.testing.assert_array_equal(getattr(ours.unwrapped.robot.model, name), getattr(theirs.model, name))
        action = rng.uniform(-1, 1, ours.action_space.shape).astype(np.float32)
        for one, other in zip(ours.step(action)[:4], theirs.step(action)[:4], strict=True):
            np.testing.assert_array_equal(one, other)
        if t % 10 == 9:
            changed_by_hand(usual, theirs.model, robot, change, t + 1)
            np.testing.assert_array_equal(ours.reset()[0], theirs.reset()[0])


def test_with_a_seed_alone_the_clock_begins_anew():
    env = gymnasium.make("galton/HalfCheetahGears-v0", period=2)
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
        env.reset()
    assert env.unwrapped.t == 3
    env.reset(seed=0)
    assert env.unwrapped.t == 0


@pytest.mark.filterwarnings("ignore:.*infinity:UserWarning")  # which Gymnasium's own observations are bounded by
@pytest.mark.parametrize("robot", ROBOTS)
def test_gymnasiums_own_check(robot):
    check_env(gymnasium.make(f"galton/{robot}Gears-v0", change="cosine").unwrapped, skip_render_check=True)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("change", ["reversal", "friction"])
def test_evaluation_is_in_the_phase_of_training_to_the_bit(robot, change):
    """Training's two copies are 9 steps old; each episode of evaluation, of 15 steps, sees a change."""
    task = find(f"galton/{robot}Gears-v0", change=change, period=PERIOD, max_episode_steps=15)
    envs, d = task.make(2), len(task.actions.box.low)
    envs.reset(np.array([0, 1]))
    at_first = remember(envs.layers)
    for _ in range(9):
        envs.step(np.full((2, d), 0.5, np.float32))

    def act(observation):
        return np.sin(observation[:, :d]).astype(np.float32)

    evaluator = Evaluator(task, 1, 1)
    for _ in range(2):  # copies are used again
        found = evaluator.evaluate(envs.layers, at_first, np.array([5, 6, 7]), act)
    usual = plain(robot).model
    for seed, total in zip((5, 6, 7), found, strict=True):
        theirs, expected = plain(robot), 0.0
        changed_by_hand(usual, theirs.model, robot, change, 9)
        observation = theirs.reset(seed=seed)[0]
        for t in range(9, 24):
            changed_by_hand(usual, theirs.model, robot, change, t)
            observation, reward, terminated, *_ = theirs.step(act(observation[None])[0])
            expected += float(np.float32(reward))
            if terminated:
                break
        assert total == expected


def trained(robot, n_updates):
    task = find(f"galton/{robot}Gears-v0", change="leg", period=PERIOD, max_episode_steps=6)
    agent = galton.make_agent(loss="gaussian", n_steps=5, n_envs=2, net_arch=(4,), normalize_observation=True)
    population = populate(task, agent, [0, 1])
    population.advance(n_updates)
    return population


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_run_that_goes_on_is_the_same_to_the_bit(robot):
    whole, first, second = trained(robot, 5), trained(robot, 2), trained(robot, 1)
    assert (whole.snapshot()["environments"]["state/t"] == 25).all()
    second.restore(first.snapshot())
    second.advance(3)
    one, other = (each.snapshot() for each in (whole, second))
    for name, value in one["environments"].items():
        np.testing.assert_array_equal(value, other["environments"][name], err_msg=name)
    np.testing.assert_array_equal(whole.evaluate(3), second.evaluate(3))


def test_an_interrupted_run_goes_on_in_its_phase(monkeypatch):
    population, calls = trained("HalfCheetah", 2), []
    step = Gears.step

    def interrupted(env, action):
        calls.append(env)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return step(env, action)

    with monkeypatch.context() as patched:
        patched.setattr(Gears, "step", interrupted)
        with pytest.raises(KeyboardInterrupt):
            population.advance(1)
    population.advance(1)
    assert set(np.ravel(population.snapshot()["environments"]["state/t"])) <= {15, 16}


@pytest.mark.parametrize(
    ("constants", "told"),
    [
        ({"change": "gone"}, "change is 'gone'; choose from reversal, leg, friction, cosine"),
        ({"period": 0}, "period is 0; it must be an integer of at least 1"),
        ({"robot": "Hopper-v5"}, "robot is 'Hopper-v5'; choose from HalfCheetah-v5, Ant-v5"),
    ],
)
@pytest.mark.skipif("CHECKED" in os.environ, reason="the checker refuses words first")
def test_constants_out_of_range(constants, told):
    with pytest.raises(UsageError, match=told):
        Gears(**{"robot": "Ant-v5"} | constants)
