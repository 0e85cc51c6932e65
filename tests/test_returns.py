import jax
import numpy as np

from galton.returns import gae


def arrays(seed=0, t=12):
    rng = np.random.default_rng(seed)
    reward, value, next_value = (rng.normal(size=t) for _ in range(3))
    terminated, truncated = np.zeros(t, bool), np.zeros(t, bool)
    terminated[3] = truncated[8] = True
    return reward, value, next_value, terminated, truncated


def by_definition(reward, value, next_value, terminated, truncated, gamma, lam):
    """Σ_i (γλ)^i δ_{t+i}, up to the end of the episode."""
    delta = reward + gamma * np.where(terminated, 0, next_value) - value
    advantage = np.zeros_like(delta)
    for t in range(len(delta)):
        weight = 1.0
        for i in range(t, len(delta)):
            advantage[t] += weight * delta[i]
            weight *= gamma * lam
            if terminated[i] or truncated[i]:
                break
    return advantage


def test_gae_is_the_sum_of_its_definition(trust):
    worst = 0.0
    with jax.enable_x64(True):
        for lam in (0.0, 0.7, 1.0):
            got, expected = gae(*map(jax.numpy.asarray, arrays()), 0.9, lam), by_definition(*arrays(), 0.9, lam)
            np.testing.assert_allclose(got, expected, rtol=1e-12)
            worst = max(worst, abs(got / expected - 1).max())
    promise = "Advantages are the sum of their definition, with time limits and terminations told apart."
    trust("advantages", promise, topic="numbers", figure=worst, unit="apart, relative, in float64", at_most=1e-12)


def test_with_lambda_one_an_advantage_is_the_n_step_return_less_the_value():
    """By hand: two steps to a termination, two to a time limit worth 10, one to the end of the rollout worth 20."""
    reward = np.array([1.0, 2.0, 3.0, 4.0, 5.0], np.float32)
    value = np.array([7.0, 6.0, -5.0, 4.0, 0.5], np.float32)
    next_value = np.array([6.0, 99.0, 4.0, 10.0, 20.0], np.float32)
    terminated, truncated = np.array([0, 1, 0, 0, 0], bool), np.array([0, 0, 0, 1, 0], bool)
    advantage = gae(*map(jax.numpy.asarray, (reward, value, next_value, terminated, truncated)), 0.5, 1.0)
    returns = [1 + 0.5 * 2, 2, 3 + 0.5 * (4 + 0.5 * 10), 4 + 0.5 * 10, 5 + 0.5 * 20]
    np.testing.assert_allclose(advantage, returns - value, rtol=1e-6)
