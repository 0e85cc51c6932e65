import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import UsageError
from galton.envs import Bandit


def rewards(env, actions, seed=0):
    """The rewards of actions `[n, d]`, each with noise of its own."""
    play = jax.jit(jax.vmap(lambda key, action: env.step(env.reset(key), action, env.noise(key))[1:]))
    reward, ended = play(jax.random.split(jax.random.key(seed), len(actions)), jnp.asarray(actions, jnp.float32))
    assert ended.all(), "every episode is one step"
    return np.asarray(reward, np.float64)


@pytest.mark.few
@pytest.mark.parametrize("noise_std", [1.0, 0.0, 4.0])
@pytest.mark.parametrize("d", [2, 1, 10])
def test_the_optimum_is_25_at_5_with_the_noise_asked_for(d, noise_std):
    sample = rewards(Bandit(d, noise_std), np.full((50_000, d), 5.0))
    assert sample.mean() == pytest.approx(25, abs=1e-5 + 5 * noise_std / len(sample) ** 0.5)
    assert sample.std() == pytest.approx(noise_std, rel=0.02, abs=1e-5)


def test_the_reward_is_the_papers_quadratic_and_random_actions_earn_the_closed_form():
    env = Bandit(noise_std=0.0)
    actions = np.random.default_rng(0).uniform(-10, 10, (200_000, 2))
    actions[0] = [3.0, 10.0]
    found = rewards(env, actions)
    assert found[0] == 25 - (4 + 25) / 2
    assert found.mean() == pytest.approx(env.random_return, abs=0.3)


def test_bad_constants_are_refused_by_name():
    with pytest.raises(UsageError, match="d is 0"):
        Bandit(d=0)
    with pytest.raises(UsageError, match="noise_std is -1"):
        Bandit(noise_std=-1.0)
