import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.envs import Acrobot


@pytest.mark.slow
def test_100_000_random_steps_equal_gymnasiums(trust):
    """From each state of Gymnasium's own trajectory, its three torques held for a while, in float32 and float64."""
    theirs = gymnasium.make("Acrobot-v1").unwrapped
    rng = np.random.default_rng(0)
    observation, _ = theirs.reset(seed=0)
    rows = []
    choice = 1
    for step in range(100_000):
        if step % 3 == 0:  # mostly with the swing, so that goals and the speed limits are met
            choice = int(np.sign(theirs.state[2])) + 1 if rng.uniform() < 0.7 else int(rng.integers(3))
        state = np.array(theirs.state, np.float64)
        observation, reward, terminated, _, _ = theirs.step(choice)
        rows.append((state, [choice - 1.0], observation, np.array(theirs.state), reward, terminated))
        if terminated:
            theirs.reset()
        elif step % 1000 == 999:
            theirs.state = rng.uniform([-3.1, -3.1, -12.5, -28], [3.1, 3.1, 12.5, 28])
    state, action, observation, following, reward, terminated = (np.array(c) for c in zip(*rows, strict=True))
    assert terminated.sum() > 100
    assert (np.abs(following[:, 3]) == 9 * np.pi).sum() > 20, "the speed limit"
    env = Acrobot()

    def ours(dtype):
        def step(state, action):
            state, reward, terminated = env.step(state, action, ())
            return env.observe(state), state, reward, terminated

        return jax.jit(jax.vmap(step))(jnp.asarray(state, dtype), jnp.asarray(action, dtype))

    with jax.enable_x64(True):
        obs64, state64, reward64, terminated64 = ours(jnp.float64)
        turns = (np.asarray(state64)[:, :2] - following[:, :2]) / (2 * np.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-10)
        np.testing.assert_allclose(state64[:, 2:], following[:, 2:], atol=1e-10)
        np.testing.assert_allclose(obs64, observation, atol=1e-6)
        np.testing.assert_array_equal(reward64, reward)
        np.testing.assert_array_equal(terminated64, terminated)

    obs32, _, _, terminated32 = ours(jnp.float32)
    np.testing.assert_allclose(obs32[:, :4], observation[:, :4], atol=2e-4)
    np.testing.assert_allclose(obs32[:, 4:], observation[:, 4:], atol=2e-3)
    assert (np.asarray(terminated32) != terminated).mean() < 1e-4
    promise = "100,000 steps of Acrobot, computed in float64, are Gymnasium's."
    apart = abs(np.asarray(state64)[:, 2:] - following[:, 2:]).max()
    trust("acrobot", promise, topic="numbers", figure=apart, unit="apart in the velocities", at_most=1e-10)


def test_torques_between_the_three_interpolate_and_beyond_them_clip():
    torques, state = jnp.array([[-1.0], [0.0], [0.5], [1.0], [7.0]]), jnp.array([0.1, -0.2, 0.3, 0.4])
    velocity = np.asarray(jax.jit(jax.vmap(lambda u: Acrobot().step(state, u, ())[0][3]))(torques))
    assert velocity[0] < velocity[1] < velocity[2] < velocity[3] == velocity[4]


def test_episodes_start_hanging():
    states = np.asarray(jax.vmap(Acrobot().reset)(jax.random.split(jax.random.key(0), 10_000)))
    assert np.abs(states).max() < 0.1001
    np.testing.assert_allclose(states.std(0), 0.1 / 3**0.5, rtol=0.03)
