import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats

from galton.parts import Box
from galton.policies import GaussianPolicy


def policy_and_distribution():
    policy = GaussianPolicy(box=Box.of(np.array([-1.0, -1.0]), np.array([1.0, 2.0])))
    return policy, policy.distribution(jnp.array([[0.5, 5.0]]), {"log_std": jnp.array([0.2, -0.7])})


def test_samples_entropy_and_log_prob_are_scipys():
    policy, distribution = policy_and_distribution()
    noise = policy.noise(jax.random.key(0), (50_000,))
    action = np.asarray(distribution.mean + (distribution.sample(noise[:1]) - distribution.mean) / noise[:1] * noise)
    for i, (mean, log_std) in enumerate(zip((0.5, 5.0), (0.2, -0.7), strict=True)):
        assert stats.kstest(action[:, i], stats.norm(mean, np.exp(log_std)).cdf).pvalue > 1e-3
    scipys = [stats.norm(mean, np.exp(s)) for mean, s in ((0.5, 0.2), (5.0, -0.7))]
    np.testing.assert_allclose(distribution.entropy(), [sum(s.entropy() for s in scipys)], rtol=1e-6)
    at = jnp.array([[0.1, 4.0]])
    np.testing.assert_allclose(distribution.log_prob(at), [scipys[0].logpdf(0.1) + scipys[1].logpdf(4.0)], rtol=1e-5)


def test_the_deterministic_action_is_the_mean_clipped_into_the_box():
    _, distribution = policy_and_distribution()
    np.testing.assert_allclose(distribution.deterministic_action(), [[0.5, 2.0]])
