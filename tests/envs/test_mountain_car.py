import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.envs import MountainCar


@pytest.mark.slow
def test_100_000_random_steps_equal_gymnasiums(trust):
    """From each state of Gymnasium's own trajectory: random pushes, and full throttle into the wall and up the hill."""
    theirs = gymnasium.make("MountainCarContinuous-v0").unwrapped
    rng = np.random.default_rng(0)
    theirs.reset(seed=0)
    rows, length = [], 0
    push = 1.0
    for step in range(100_000):
        if step % 250 == 0:
            push = rng.choice([0.0, -1.0, 1.0])
        random_action = rng.uniform(-1, 1)
        swing = np.sign(theirs.state[1]) or 1.0
        action = np.array([random_action if push == 0 else push if push == -1 else swing], np.float32)
        state = np.array(theirs.state, np.float32)
        theirs.state = state
        following, reward, terminated, _, _ = theirs.step(action)
        rows.append((state, action, following.copy(), reward, terminated))
        length += 1
        if terminated or length == 999:
            theirs.reset()
            length = 0
    state, action, following, reward, terminated = (np.array(column) for column in zip(*rows, strict=True))
    env = MountainCar()
    ours = jax.jit(jax.vmap(lambda s, a: env.step(s, a, ())))(jnp.asarray(state), jnp.asarray(action))

    assert terminated.sum() > 100
    assert ((following[:, 0] == np.float32(-1.2)) & (following[:, 1] == 0)).sum() > 100, "the left wall"
    np.testing.assert_allclose(ours[0], following, atol=2e-7)
    np.testing.assert_allclose(ours[1], reward, atol=1e-6)
    near = np.abs(following[:, 0] - 0.45) < 1e-6
    np.testing.assert_array_equal(np.asarray(ours[2])[~near], terminated[~near])
    promise = "100,000 steps of Mountain Car are Gymnasium's."
    apart = abs(ours[0] - following).max()
    trust("mountain-car", promise, topic="numbers", figure=apart, unit="apart in the state", at_most=2e-7)


def test_the_wall_and_the_speed_limits():
    states = jnp.array([[-1.19, -0.07], [-1.0, 0.07], [0.449, 0.05], [0.6, -0.01]])
    actions = jnp.array([[-1.0], [1.0], [1.0], [0.0]])
    step = jax.jit(jax.vmap(lambda state, action: MountainCar().step(state, action, ())))
    following, reward, terminated = map(np.asarray, step(states, actions))
    np.testing.assert_allclose(following[0], [-1.2, 0.0])
    np.testing.assert_allclose(following[1, 1], 0.07)
    assert reward[2] == np.float32(99.9)
    assert terminated.tolist() == [False, False, True, False]


def test_episodes_start_at_rest_in_the_valley():
    states = np.asarray(jax.vmap(MountainCar().reset)(jax.random.split(jax.random.key(0), 10_000)))
    assert (states[:, 1] == 0).all()
    assert states[:, 0].min() > -0.6001
    assert states[:, 0].max() < -0.3999
    assert abs(states[:, 0].mean() + 0.5) < 0.002
