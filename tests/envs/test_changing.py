"""Tasks that change: their optimum and regret beside numpy's, and a clock that nothing but a new run sets back."""

import os

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import galton
from galton import UsageError
from galton.envs import DriftingBandit, JaxTask, SwitchingLQR, make
from galton.envs.changing import reflected
from galton.envs.lqr import riccati
from galton.training.population import populate

CHANGES = ("reversal", "rotation", "radius", "cost")


def path(env, n):
    """The best actions of n steps."""

    def step(moment, _):
        return env.step(moment, jnp.zeros(env.d), 0.0)[0], moment.optimum

    return np.asarray(jax.lax.scan(step, env.reset(jax.random.key(0)), None, n)[1])


def test_jumps_and_waves_are_numpys():
    t = np.arange(95)
    for change, where in (
        ("jump", np.where(t // 20 % 2, -0.5, 0.5)),
        ("sine", 0.5 * np.cos(2 * np.pi * t / 20)),
        ("still", np.full(95, 0.5)),
    ):
        found = path(DriftingBandit(change=change, period=20, d=3), 95)
        np.testing.assert_allclose(found, np.repeat(where[:, None], 3, 1), atol=1e-6)


def test_a_walk_is_reflected_at_walls_and_as_far_away_as_it_says():
    """Its root mean square distance, before any wall: size after a period."""
    walks = np.array([path(DriftingBandit(change="walk", period=100, size=0.1, d=2, seed=s), 101) for s in range(100)])
    distance = np.sqrt(np.mean((walks[:, 100] - walks[:, 0]) ** 2))
    assert distance == pytest.approx(0.1, rel=0.2)
    assert abs(path(DriftingBandit(change="walk", period=10, d=2), 2_000)).max() <= 0.8

    position, direction, free = 0.3, 0.01, 0.3
    for _ in range(900):
        np.testing.assert_allclose(reflected(jnp.float32(free), 0.8), position, atol=1e-4)
        free, position = free + 0.01, position + direction
        if abs(position) > 0.8:
            position, direction = np.sign(position) * 1.6 - position, -direction


def test_a_bandits_reward_is_one_less_its_regret():
    env = DriftingBandit(d=2)
    action = jnp.array([0.2, -0.4])
    moment, reward, ended = env.step(env.reset(jax.random.key(0)), action, 0.25)
    assert float(moment.regret) == pytest.approx(4 * (0.3**2 + 0.9**2) / 2)
    assert float(reward) == pytest.approx(1 - float(moment.regret) + 0.25)
    assert bool(ended)
    sampled = np.random.default_rng(0).uniform(-1, 1, (100_000, 2))
    assert np.mean(1 - 4 * (sampled - 0.5) ** 2) == pytest.approx(env.random_return, abs=0.01)


@pytest.mark.parametrize("change", CHANGES)
def test_steps_of_a_regulator_are_those_of_its_phase(change):
    env = SwitchingLQR(change=change, period=3)
    moment, x = env.reset(jax.random.key(0)), np.array(env.reset(jax.random.key(0)).state, np.float64)
    rng = np.random.default_rng(0)
    for t in range(12):
        A, B, Q, R = (np.array(getattr(env.phases[t // 3 % 2], name)) for name in "ABQR")
        u, w = rng.uniform(-1, 1, 2), rng.normal(size=2)
        moment, reward, _ = env.step(moment, jnp.float32(u), jnp.float32(w))
        assert float(reward) == pytest.approx(-(x @ Q @ x + u @ R @ u), rel=1e-4)
        x = A @ x + B @ u + w
        np.testing.assert_allclose(moment.state, x, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("phase", [0, 1])
def test_regret_is_the_distance_of_a_policys_cost_from_the_optimum(change, phase):
    """Without noise, exactly: Bellman's equation says it step by step, here in float64."""
    lqr = SwitchingLQR(change=change).phases[phase]
    A, B, Q, R = (np.array(getattr(lqr, name)) for name in "ABQR")
    of_steps, weights, _ = zip(*riccati(lqr)[::-1], strict=True)
    rng, x = np.random.default_rng(0), np.array([0.7, -0.3])

    def cost_from(x, controller):
        total = 0.0
        for t in range(lqr.max_episode_steps):
            u = controller(t, x)
            total += x @ Q @ x + u @ R @ u
            x = A @ x + B @ u
        return total

    actions = rng.uniform(-1, 1, (lqr.max_episode_steps, 2))
    regret, state = 0.0, x
    for t, u in enumerate(actions):
        off = u + of_steps[t] @ state
        regret += off @ weights[t] @ off
        state = A @ state + B @ u
    best = cost_from(x, lambda t, x: -of_steps[t] @ x)
    assert cost_from(x, lambda t, _: actions[t]) - best == pytest.approx(regret, rel=1e-10)


def trained(env, n_updates, seeds=(0, 1)):
    agent = galton.make_agent(loss="gaussian", n_steps=5, n_envs=2, learning_rate=1e-12, log_std_init=-20.0)
    population = populate(JaxTask(env), agent, seeds)
    population.advance(n_updates)
    return population


@pytest.mark.parametrize("env", [DriftingBandit(change="walk", period=7), SwitchingLQR(period=13, max_episode_steps=4)])
def test_the_clock_outlasts_episodes_and_a_run_that_goes_on_is_the_same_to_the_bit(env):
    whole, first = trained(env, 9), trained(env, 4)
    assert (np.asarray(whole.snapshot()["environments"].env.t) == 45).all()
    second = trained(env, 1)
    second.restore(first.snapshot())
    second.advance(5)
    for one, other in zip(*(jax.tree.leaves(each.snapshot()) for each in (whole, second)), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(whole.evaluate(3), second.evaluate(3))


def test_evaluation_is_in_the_phase_of_training():
    """The policy stays near 0, where a wave's optimum is after a quarter of its period."""
    env = DriftingBandit(change="sine", period=40, noise_std=0.0)
    population = trained(env, 2)
    np.testing.assert_allclose(population.evaluate(4), 1.0, atol=0.05)
    population.advance(2)
    np.testing.assert_allclose(population.evaluate(4), 0.0, atol=0.05)


def test_the_log_tells_the_regret():
    population = trained(DriftingBandit(noise_std=0.0), 20)
    log = population.log()
    np.testing.assert_allclose(log.scalars["env_regret"], 1 - log.training_return, rtol=1e-5)


def test_with_gymnasium_a_seed_alone_begins_anew():
    env = gymnasium.make("galton/DriftingBandit-v0", period=2)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(2, np.float32))
        env.reset()
    assert int(env.unwrapped._state.t) == 3
    env.reset(seed=0)
    assert int(env.unwrapped._state.t) == 0


@pytest.mark.parametrize(
    ("name", "constants", "told"),
    [
        ("drifting-bandit", {"change": "gone"}, "change is 'gone'; choose from jump, sine, walk, still"),
        ("drifting-bandit", {"period": 0}, "period is 0; it must be an integer of at least 1"),
        ("drifting-bandit", {"size": 0.9}, "size is 0.9; it must be greater than 0, and 0.8 or less"),
        ("drifting-bandit", {"noise_std": -1.0}, "noise_std is -1.0; it must be 0 or more"),
        ("switching-lqr", {"change": "sine"}, "change is 'sine'; choose from reversal, rotation, radius, cost"),
        ("switching-lqr", {"period": 0.5}, "period is 0.5"),
    ],
)
@pytest.mark.skipif("CHECKED" in os.environ, reason="the checker refuses words first")
def test_constants_out_of_range(name, constants, told):
    with pytest.raises(UsageError, match=told):
        make(name, **constants)


def test_doing_nothing_is_judged_in_the_phase_that_evaluation_plays():
    model = galton.A2C("switching-lqr", "gaussian", env_kwargs={"change": "radius", "period": 1000}, net_arch=())
    first = model.yardsticks()
    model.advance(55)
    assert model.num_timesteps == 1_100
    assert model.yardsticks().doing_nothing < 5 * first.doing_nothing  # the second phase's system is unstable
