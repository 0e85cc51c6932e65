import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import UsageError
from galton.envs import Bandit


def rewards(env, action, n=50_000):
    def reward(key):
        return env.step(env.reset(key), action, env.noise(key))[1]

    return np.asarray(jax.vmap(reward)(jax.random.split(jax.random.key(0), n)), np.float64)


@pytest.mark.parametrize("d", [1, 2, 10])
@pytest.mark.parametrize("noise_std", [0.0, 1.0, 4.0])
def test_the_optimum_is_25_at_5_with_the_noise_asked_for(d, noise_std):
    sample = rewards(Bandit(d, noise_std), jnp.full(d, 5.0))
    assert sample.mean() == pytest.approx(25, abs=1e-5 + 5 * noise_std / len(sample) ** 0.5)
    assert sample.std() == pytest.approx(noise_std, rel=0.02, abs=1e-5)


def test_the_reward_is_the_papers_quadratic():
    assert rewards(Bandit(noise_std=0.0), jnp.array([3.0, 10.0]), 1)[0] == 25 - (4 + 25) / 2


def test_random_actions_earn_the_closed_form():
    env = Bandit()
    actions = jax.random.uniform(jax.random.key(0), (200_000, 2), minval=-10.0, maxval=10.0)
    returns = jax.vmap(lambda a: env.step(jnp.ones(1), a, jnp.zeros(()))[1])(actions)
    assert float(returns.mean()) == pytest.approx(env.random_return, abs=0.3)


def test_every_episode_is_one_step():
    env = Bandit()
    assert bool(env.step(env.reset(jax.random.key(0)), jnp.zeros(2), jnp.zeros(()))[2])


def test_bad_constants_are_refused_by_name():
    with pytest.raises(UsageError, match="d is 0"):
        Bandit(d=0)
    with pytest.raises(UsageError, match="noise_std is -1"):
        Bandit(noise_std=-1.0)
