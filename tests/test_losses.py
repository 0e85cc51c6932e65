import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import softmax
from scipy.stats import multivariate_normal

from galton import LOSSES, Bins, UsageError, losses, targets
from galton.policies import Gaussian, Histogram
from galton.policies.histogram import Choices

from .agents import agent

pytestmark = pytest.mark.usefixtures("double")

HISTOGRAM = [name for name, loss in LOSSES.items() if loss.family == "histogram"]
LOW, HIGH, K, D = [-1.0, 0.0], [1.0, 5.0], 30, 2


def bins():
    return Bins(LOW, HIGH, K)


def batch(seed=0, n=8):
    rng = np.random.default_rng(seed)
    action = bins().centers[np.arange(D), rng.integers(0, K, (n, D))]
    return 2 * rng.normal(size=(n, D, K)), action, rng.normal(size=n)


@jax.jit
def gradient(loss, logits, action, advantage):
    """Of Σ_j A_j loss_j in the logits."""

    def total(logits):
        return losses.surrogate(advantage, loss(Histogram(bins(), logits), action)) * len(advantage)

    return jax.grad(total)(logits)


def loss_of(name, eta):
    return agent({"loss": name, "eta": eta}).loss


@pytest.mark.parametrize("name", HISTOGRAM)
def test_the_gradient_in_the_logits_is_the_papers(name):
    @jax.jit
    def papers(logits, action, advantage, eta):
        pi, q = jax.nn.softmax(logits), targets.hl_gauss(bins(), action, eta)
        away = {
            "hl-one-hot": targets.one_hot(bins(), action) - pi,
            "hl-gauss": q - pi,
            "hl-gauss-centred": q - pi @ targets.hl_gauss_of_center(K, jnp.arange(K), eta),
        }[name]
        return advantage[:, None, None] * away

    for eta in (0.1, 0.75, 3.0):
        # The paper ascends, we minimise.
        found = gradient(loss_of(name, eta), *batch())
        np.testing.assert_allclose(-found, papers(*batch(), eta), atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "indifferent"), [("hl-one-hot", True), ("hl-gauss", False), ("hl-gauss-centred", True)]
)
def test_mean_gradient_over_actions_under_a_shifted_advantage(name, indifferent):
    bins = Bins(-1.0, 1.0, K)
    logits = jax.random.normal(jax.random.key(1), (K,))
    pi = jax.nn.softmax(logits)
    actions = jnp.asarray(bins.centers.T)

    def mean_gradient(shift):
        def expected_loss(logits):
            distribution = Histogram(bins, jnp.tile(logits, (K, 1, 1)))
            return jnp.sum(pi * (jnp.sin(jnp.arange(K)) + shift) * loss_of(name, 0.75)(distribution, actions))

        return jax.grad(expected_loss)(logits)

    moved = float(jnp.abs(mean_gradient(7.0) - mean_gradient(0.0)).max())
    assert moved < 1e-12 if indifferent else moved > 1e-3


@pytest.mark.parametrize("name", HISTOGRAM)
def test_near_a_uniform_policy_the_advantages_sign_is_the_direction_of_the_actions_probability(name):
    logits, action, _ = batch()
    logits = 0.1 * logits
    index = np.argmin(abs(bins().centers - action[..., None]), -1)[..., None]
    for sign in (1.0, -1.0):
        step = logits - 0.1 * np.asarray(gradient(loss_of(name, 0.5), logits, action, np.full(8, sign)))
        before, after = (np.take_along_axis(softmax(x, -1), index, -1) for x in (logits, step))
        assert (sign * (after - before) > 0).all()


def test_the_gaussian_loss_is_the_negative_log_likelihood():
    mean, log_std, action = np.array([[0.3, -2.0]]), np.array([0.5, -1.0]), np.array([[1.0, -1.5]])
    loss = jax.jit(
        lambda *given: losses.NegativeLogLikelihood()(Gaussian(*given[:2], bins().low, bins().high), given[2])
    )
    expected = -multivariate_normal(mean[0], np.diag(np.exp(2 * log_std))).logpdf(action[0])
    np.testing.assert_allclose(loss(mean, log_std, action), [expected], rtol=1e-12)


@pytest.mark.parametrize("choice", [{"exploration": "gaussian"}, {"bin_sample": "uniform"}])
def test_off_center_actions_get_the_target_around_themselves(choice):
    @jax.jit
    def both(logits, action):
        loss = losses.HLGauss(eta=0.75)(Histogram(bins(), logits, Choices(**choice)), action)
        return loss, -(targets.hl_gauss(bins(), action, 0.75) * jax.nn.log_softmax(logits)).sum((-1, -2))

    logits, action, _ = batch()
    np.testing.assert_allclose(*both(logits, action + 0.3 * bins().width), rtol=1e-5)


def test_no_gradient_flows_through_the_advantage():
    assert float(jax.grad(lambda a: losses.surrogate(a, jnp.full(3, 2.0)))(jnp.ones(3)).sum()) == 0


@pytest.mark.parametrize("name", HISTOGRAM)
def test_as_a_log_probability_it_has_the_policys_value_and_its_own_gradient(name):
    logits, action, advantage = batch()
    loss = loss_of(name, 0.75)

    def told(logits):
        return losses.as_log_prob(loss, Histogram(bins(), logits), action)

    np.testing.assert_allclose(told(logits), Histogram(bins(), logits).log_prob(action), rtol=1e-12)
    found = jax.grad(lambda logits: -(advantage * told(logits)).sum())(jnp.asarray(logits))
    np.testing.assert_allclose(found, gradient(loss, logits, action, advantage), rtol=1e-9, atol=1e-12)
    old = jax.lax.stop_gradient(told(logits))
    of_ratio = jax.grad(lambda logits: -(advantage * jnp.exp(told(logits) - old)).sum())(jnp.asarray(logits))
    np.testing.assert_allclose(of_ratio, found, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("setting", [{"negative_target": "one-hot"}, {"diffusion": 0.1}])
def test_what_a_log_probability_can_not_have_is_refused(setting):
    logits, action, _ = batch()
    loss = losses.HLGaussCentred(eta=0.75, **setting)
    with pytest.raises(UsageError, match=r"can't have its negative_target or diffusion.*loss\.regularizer"):
        losses.as_log_prob(loss, Histogram(bins(), logits), action)
