"""Tasks of gymnax, Brax and Playground by name are those libraries' own, step by step: `make test-others`."""

import re
import subprocess
import sys

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import galton
from galton.envs import find, of_brax
from galton.envs.jax_task import JaxTask, RecordEnvironments

from ..running import ROOT

gymnax = pytest.importorskip("gymnax", reason="make test-others installs it")
brax_envs = pytest.importorskip("brax.envs", reason="make test-others installs it")
registry = pytest.importorskip("mujoco_playground", reason="make test-others installs it").registry

pytestmark = pytest.mark.filterwarnings("ignore")  # the libraries' own

N = 200
KEYS = jax.random.split(jax.random.key(1), N)


def drawn(task, n=N):
    """Actions of the task's own kind, as policies give them."""
    low, high = (np.array(bound, np.float32) for bound in (task.actions.box.low, task.actions.box.high))
    uniform = np.random.default_rng(0).uniform(low, high, (n, len(low)))
    return np.rint(uniform) if task.actions.box.n_values else uniform


def of_galton(task, n=N):
    """Observations, rewards and ends of n steps of a task, from the key 0, without a new episode."""
    first = jax.jit(task.record.reset)(jax.random.key(0))

    def step(state, given):
        action, key = given
        state, reward, ended = task.step(state, action, task.record.noise(key))
        return state, (task.observe(state), reward, ended)

    _, told = jax.jit(lambda state, actions: jax.lax.scan(step, state, (actions, KEYS[:n])))(
        first, jnp.asarray(drawn(task, n), float)
    )
    return task.observe(first), *map(np.asarray, told)


@pytest.mark.parametrize("name", ["Pendulum-v1", "CartPole-v1", "Acrobot-v1", "Reacher-misc", "Breakout-MinAtar"])
def test_steps_of_gymnax_are_its_own(name):
    task = find(f"gymnax:{name}")
    env, params = gymnax.make(name)
    assert task.record.max_episode_steps == params.max_steps_in_episode
    first, observations, rewards, ended = of_galton(task)
    observation, state = env.reset_env(jax.random.key(0), params)
    np.testing.assert_array_equal(first, observation.ravel())
    step = jax.jit(env.step_env)
    for t, (action, key) in enumerate(zip(drawn(task), KEYS, strict=True)):
        given = jnp.int32(action[0]) if task.actions.box.n_values else jnp.asarray(action, jnp.float32)
        observation, state, reward, done, _ = step(key, state, given, params)
        np.testing.assert_allclose(observations[t], observation.ravel(), rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(rewards[t], reward, rtol=1e-4, atol=1e-4)
        assert done == (ended[t] or state.time >= params.max_steps_in_episode)


@pytest.mark.parametrize(
    ("name", "make", "n"),
    [
        ("inverted_pendulum", brax_envs.get_environment, N),
        ("halfcheetah", brax_envs.get_environment, 30),
        ("CheetahRun", lambda name: registry.load(name, config_overrides={"impl": "jax"}), N),
        ("CartpoleSwingup", lambda name: registry.load(name, config_overrides={"impl": "jax"}), N),
    ],
)
def test_steps_of_brax_and_playground_are_their_own(name, make, n):
    """In float64: contacts magnify rounding a hundred million times within these steps."""
    with jax.enable_x64(True):
        env = make(name)
        task = JaxTask(of_brax(env, name, 1000))
        first, *told = of_galton(task, n)
        state = jax.jit(env.reset)(jax.random.key_data(jax.random.key(0)))
        np.testing.assert_allclose(first, state.obs, atol=1e-9)

        def step(state, action):
            state = env.step(state, action)
            return state, (state.obs, state.reward, state.done)

        actions = jnp.asarray(drawn(task, n), float)
        _, theirs = jax.jit(lambda state, actions: jax.lax.scan(step, state, actions))(state, actions)
        for ours, own in zip(told, theirs, strict=True):
            np.testing.assert_allclose(np.asarray(ours, float), own, rtol=1e-5, atol=1e-5)


def test_episodes_begin_again_and_end_at_their_own_limit():
    envs = RecordEnvironments(find("brax:inverted_pendulum", max_episode_steps=40))
    envs.reset(np.arange(4))
    for t in range(1, 81):
        steps = envs.step(np.full((4, 1), 0.0, np.float32))
        assert not np.logical_and(steps.terminated, steps.truncated).any()
        if steps.truncated.any():
            assert t >= 40
            ended = steps.truncated
            assert (np.abs(steps.observation[ended]) < 0.02).all(), "a first state"
            assert not np.array_equal(steps.final_observation[ended], steps.observation[ended])


def test_names_and_options_that_the_libraries_do_not_know_are_refused():
    with pytest.raises(galton.UsageError, match=r"gymnax has no task 'Pendulum-v0'; did you mean Pendulum-v1"):
        find("gymnax:Pendulum-v0")
    with pytest.raises(galton.UsageError, match="brax has no task 'cheetah'"):
        find("brax:cheetah")
    with pytest.raises(galton.UsageError, match="playground has no task 'CheetahRuns'"):
        find("playground:CheetahRuns")
    with pytest.raises(galton.UsageError, match="'brax:ant' can't be made"):
        find("brax:ant", backend="none")
    with pytest.raises(galton.UsageError, match="'gymnax:Pendulum-v1' can't be made"):
        find("gymnax:Pendulum-v1", gravity=1)
    with pytest.raises(galton.UsageError, match="max_episode_steps is 0; it must be an integer"):
        find("brax:ant", max_episode_steps=0)
    with pytest.raises(galton.UsageError, match=r"env_kwargs is .* give numbers, texts and tuples"):
        find("brax:ant", backend={})


def test_a_model_of_one_is_trained_saved_and_goes_on_to_the_bit(tmp_path):
    words = {"n_envs": 4, "n_steps": 16, "batch_size": 32, "net_arch": (8,), "decay_steps": 0, "seed": 0}
    whole, halves = (galton.PPO("brax:inverted_pendulum", **words) for _ in range(2))
    whole.learn(512)
    halves.learn(256)
    again = galton.PPO.load(halves.save(tmp_path / "half"), env="brax:inverted_pendulum")
    again.learn(256)
    for ours, theirs in zip(jax.tree.leaves(whole.learner.params), jax.tree.leaves(again.learner.params), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_the_losses_train_in_braxs_ppo():
    command = [sys.executable, ROOT / "examples" / "brax_ppo_histogram.py", "--steps", "80000"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    returns = [float(found) for found in re.findall(r"return (\S+)", done.stdout)]
    assert returns[0] < 50
    assert returns[-1] > 150  # of 200


@pytest.mark.parametrize("name", ["HalfCheetah", "Hopper", "Walker2d"])
def test_a_step_of_mjx_is_gymnasiums(name):
    from galton.envs.mjx import Runner

    with jax.enable_x64(True):
        record = of_brax(Runner(name), name, 1000)
        theirs = gymnasium.make(f"{name}-v5").unwrapped
        theirs.reset(seed=0)
        reset, step = jax.jit(record.reset), jax.jit(record.step)
        state, n_ends = reset(jax.random.key(0)), 0
        for t, action in enumerate(np.random.default_rng(0).uniform(-1, 1, (60, len(record.action_low)))):
            data = record.kept.whole(state).data
            theirs.set_state(np.array(data.qpos), np.array(data.qvel))
            theirs.data.qacc_warmstart[:] = data.qacc_warmstart
            observation, reward, ended, _, _ = theirs.step(action)
            state, found, done = step(state, jnp.asarray(action), ())
            np.testing.assert_allclose(record.observe(state), observation, rtol=0, atol=1e-10)
            np.testing.assert_allclose(found, reward, rtol=0, atol=1e-10)
            assert bool(done) == ended
            n_ends += ended
            state = reset(jax.random.key(t)) if ended else state
        assert (n_ends > 0) == (name != "HalfCheetah")
        first = [np.asarray(record.observe(reset(jax.random.key(seed)))) for seed in range(300)]
    told = np.array([theirs.reset(seed=seed)[0] for seed in range(300)])
    np.testing.assert_allclose(np.std(first, 0), told.std(0), rtol=0.15)
    np.testing.assert_allclose(np.mean(first, 0), told.mean(0), atol=4 * told.std() / 300**0.5)


def test_mjx_is_trained_on():
    model = galton.PPO("mjx:HalfCheetah", n_envs=16, n_steps=32, batch_size=128, n_epochs=2)
    model.learn(1024, progress_bar=False)
    assert model.num_timesteps == 1024
    with pytest.raises(galton.UsageError, match=r"env_kwargs has mass .* takes max_episode_steps alone"):
        find("mjx:HalfCheetah", mass=2)
