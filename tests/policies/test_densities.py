"""Clipped, truncated and squashed Gaussians and Beta, in float32, against torch.distributions and scipy in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch
from scipy import integrate, stats

from galton import Hypers

from .densities import BOXES, N_OUTPUTS, NAMES, Reference, make, reference

USUAL = [(0.0, 0.0), (0.4, -0.7), (-0.8, -2.0), (0.1, 1.0)]
BEYOND = [(1.5, -1.0), (-2.0, 0.5), (3.0, -2.0)]
"""Outputs and log σ: the mean inside the box, and beyond it."""
EXTREME = [(o, s) for o in (-50.0, -1.0, 0.0, 1.0, 50.0) for s in (-12.0, -4.0, 0.0, 3.0)]


def outputs_of(name, mean):
    """Outputs of a policy, of which Beta has two."""
    return np.array([mean] if name != "beta" else [2 * mean, 1 - mean])


def samples(name, box, mean, log_std, n, seed=0):
    policy, distribution = make(name, *box, np.tile(outputs_of(name, mean), (n, 1)), log_std)
    return distribution, distribution.sample(policy.noise(jax.random.key(seed), (n,)))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("box", BOXES)
def test_the_log_prob_and_its_gradient_are_torchs(name, box):
    for mean, log_std in USUAL + BEYOND:
        _, action = samples(name, box, mean, log_std, 64)
        known = np.asarray(action, np.float64)
        if name in ("squashed-gaussian", "beta"):  # where float32 can say how near to a bound an action is
            room = np.minimum(known - box[0], box[1] - known)
            kept = (room > max(1e-3 * (box[1] - box[0]), 1e-3 * max(map(abs, box))))[:, 0]
            action, known = action[kept], known[kept]
        if not len(known):
            continue

        def total(outputs, log_std, action=action):
            rows = jnp.tile(outputs, (len(action), 1))
            return make(name, *box, rows, log_std)[1].log_prob(action)

        arguments = outputs_of(name, mean), np.array(log_std)
        found = total(*arguments)
        slopes = jax.jacrev(total, (0, 1))(*(jnp.asarray(x, jnp.float32) for x in arguments))
        tensors = [torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in arguments]
        expected = Reference(name, *box, *tensors).log_prob(known[:, 0])
        np.testing.assert_allclose(found, expected.detach(), rtol=2e-4, atol=2e-4)
        for i, value in enumerate(expected):
            theirs = torch.autograd.grad(value, tensors, retain_graph=True, allow_unused=True)
            for ours, slope in zip(slopes, theirs, strict=True):
                slope = np.zeros(()) if slope is None else slope.numpy()
                np.testing.assert_allclose(ours[i], slope, rtol=2e-3, atol=2e-3)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("mean", "log_std"), USUAL + BEYOND + [(4.0, -3.0), (-1.0, -5.0), (0.0, 4.0)])
def test_samples_follow_the_distribution(name, mean, log_std):
    box = (-3.0, 1.0)
    _, action = samples(name, box, mean, log_std, 20_000)
    action = np.asarray(action, np.float64)[:, 0]
    assert ((action >= box[0]) & (action <= box[1])).all()
    known = reference(name, *box, outputs_of(name, mean), log_std)
    if name == "squashed-gaussian":
        x = (action + 1) / 2
        seen = abs(x) < 1 - 1e-6
        u = np.where(seen, np.arctanh(np.where(seen, x, 0)), np.sign(x) * 7.5)
        assert stats.kstest(np.clip(u, -7.2, 7.2), lambda t: clipped_cdf(known.scipys(), -7.2, 7.2, t)).pvalue > 1e-3
        return
    if name == "truncated-gaussian" and mean > 3:
        action, known = -action, reference(name, -1.0, 3.0, outputs_of(name, -mean), log_std)  # scipy's other tail
    cdf = known.scipys().cdf
    if name == "clipped-gaussian":
        tails = known.scipys().cdf(box[0]), known.scipys().sf(box[1])
        at = np.mean(action == box[0]), np.mean(action == box[1])
        np.testing.assert_allclose(at, tails, atol=4 * np.sqrt(0.25 / len(action)))
        inside = action[(action > box[0]) & (action < box[1])]
        if len(inside) < 50:
            return
        action, whole = inside, 1 - sum(tails)
        cdf = lambda t: (known.scipys().cdf(t) - tails[0]) / whole  # noqa: E731
    assert stats.kstest(action, cdf).pvalue > 1e-3


def clipped_cdf(distribution, low, high, t):
    return np.where(t >= high, 1.0, np.where(t < low, 0.0, distribution.cdf(t)))


def expectation(known, f):
    """The mean of f(log π, action) by quadrature in float64."""
    box, scipys = (known.low, known.high), known.scipys()
    if known.name == "squashed-gaussian":
        mean, std = scipys.mean(), scipys.std()
        integrand = lambda z: stats.norm.pdf(z) * f(*squashed(known, mean + std * z))  # noqa: E731
        return integrate.quad(integrand, -9, 9, points=[-mean / std], limit=500)[0]
    log_prob = lambda a: known.log_prob(a).item()  # noqa: E731
    integrand = lambda a: np.exp(log_prob(a)) * f(log_prob(a), a)  # noqa: E731
    inside = np.nextafter(box[0], box[1]), np.nextafter(box[1], box[0])
    points = np.clip(scipys.mean() + scipys.std() * np.array([-4, -1, 0, 1, 4]), *inside)
    total = integrate.quad(integrand, *inside, points=points, limit=500)[0]
    if known.name == "clipped-gaussian":
        total += sum(known.half * np.exp(log_prob(bound)) * f(log_prob(bound), bound) for bound in box)
    return total


def squashed(known, u):
    slope = 2 * (np.log(2) - abs(u) - np.log1p(np.exp(-2 * abs(u))))
    action = known.center + known.half * np.tanh(u)
    return known.scipys().logpdf(u) - slope - np.log(known.half), action


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("box", BOXES[:4])
def test_entropy_and_std_are_those_of_the_distribution(name, box):
    for mean, log_std in [*USUAL, (1.5, -1.0), (-2.0, 0.5), (4.0, -2.0)]:
        distribution = make(name, *box, outputs_of(name, mean), log_std)[1]
        known = reference(name, *box, outputs_of(name, mean), log_std)
        if name == "truncated-gaussian" and mean == 4.0:
            entropy, std = known.scipys().entropy(), known.scipys().std()
        else:
            entropy = -expectation(known, lambda log_prob, _: log_prob)
            first = expectation(known, lambda _, action: action)
            std = np.sqrt(expectation(known, lambda _, action, first=first: (action - first) ** 2))
        assert float(distribution.entropy()) == pytest.approx(entropy, rel=1e-4, abs=1e-4)
        assert float(distribution.std()[0]) == pytest.approx(std, rel=1e-3, abs=1e-5 * (box[1] - box[0]))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("box", BOXES)
def test_everything_is_finite_at_the_bounds_beyond_them_and_for_extreme_parameters(name, box):
    size = box[1] - box[0]
    action = np.array([*box, np.nextafter(*np.float32(box)), box[0] - 50 * size, box[1] + 50 * size, box[0] + size / 3])
    action = jnp.asarray(action, jnp.float32)[:, None]
    mean, log_std = (np.array(x, np.float32) for x in zip(*EXTREME, strict=True))
    outputs = np.stack([mean] * N_OUTPUTS.get(name, 1), -1)

    def tell(outputs, log_std, action):
        distribution = make(name, *box, outputs, log_std)[1]
        return distribution.log_prob(action), distribution.entropy(), distribution.std().sum()

    def everything(outputs, log_std, action):
        return tell(outputs, log_std, action), jax.jacrev(tell, (0, 1))(outputs, log_std, action)

    each = jax.vmap(jax.vmap(everything, (0, 0, None)), (None, None, 0))
    for leaf in jax.tree.leaves(each(outputs, log_std, action)[0]):
        assert np.isfinite(leaf).all()
    slopes = each(outputs, log_std, action)[1]
    for leaf in jax.tree.leaves(slopes[:2]):  # what training differentiates
        assert np.isfinite(leaf).all()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("d", [1, 2, 5, 17])
def test_dimensions_are_independent_and_of_any_box(name, d):
    rng = np.random.default_rng(d)
    low = rng.uniform(-5, 5, d).astype(np.float32)
    high = low + np.exp(rng.uniform(-3, 3, d)).astype(np.float32)
    outputs, log_std = rng.normal(size=(6, d, N_OUTPUTS.get(name, 1))), rng.normal(size=d) - 1
    policy, whole = make(name, low, high, outputs.reshape(6, -1), log_std)
    noise = policy.noise(jax.random.key(d), (6,))
    action = whole.sample(noise)
    assert policy.n_outputs == outputs[0].size
    assert action.shape == whole.std().shape == whole.at_edge(action).shape == (6, d)
    assert ((action >= low) & (action <= high)).all()
    parts = [make(name, low[i], high[i], outputs[:, i], log_std[i])[1] for i in range(d)]
    for ask in (lambda one, a: one.log_prob(a), lambda one, a: one.entropy()):
        apart = sum(np.asarray(ask(part, action[:, i : i + 1]), np.float64) for i, part in enumerate(parts))
        np.testing.assert_allclose(ask(whole, action), apart, rtol=1e-4, atol=1e-4)
    best = np.concatenate([part.deterministic_action() for part in parts], -1)
    np.testing.assert_allclose(whole.deterministic_action(), best, rtol=1e-6)
    assert ((best >= low) & (best <= high)).all()


@pytest.mark.parametrize("name", NAMES)
def test_other_units_of_the_action_add_a_constant_to_log_prob_and_entropy(name):
    outputs = np.random.default_rng(0).normal(size=(50, N_OUTPUTS.get(name, 1)))
    policy, small = make(name, -1.0, 1.0, outputs, -0.5)
    large = make(name, -1024.0, 1024.0, outputs, -0.5)[1]
    action = small.sample(policy.noise(jax.random.key(3), (50,)))
    np.testing.assert_allclose(large.log_prob(1024 * action), small.log_prob(action) - np.log(1024), atol=1e-4)
    np.testing.assert_allclose(large.entropy(), small.entropy() + np.log(1024), atol=1e-5)
    np.testing.assert_allclose(large.std(), 1024 * small.std(), rtol=1e-5)
    np.testing.assert_array_equal(large.at_edge(1024 * action), small.at_edge(action))


DETERMINISTIC = {
    "clipped-gaussian": ([0.3, -4.0], [0.3, -1.0]),
    "truncated-gaussian": ([0.3, 4.0], [0.3, 1.0]),
    "squashed-gaussian": ([0.3, 40.0], [np.tanh(0.3), 1.0]),
    "beta": ([0.0, 0.0, 1.0, -1.0], [0.0, 2 * 2.313262 / (2.313262 + 1.313262) - 1]),
}


@pytest.mark.parametrize("name", NAMES)
def test_the_deterministic_action_is_the_one_that_its_docstring_names(name):
    outputs, expected = DETERMINISTIC[name]
    found = make(name, -np.ones(2), np.ones(2), np.array([outputs]))[1].deterministic_action()
    np.testing.assert_allclose(found, [expected], rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("name", NAMES)
def test_at_the_edge_is_what_lies_on_a_bound_or_in_the_last_hundredth(name):
    distribution = make(name, -1.0, 1.0, outputs_of(name, 0.1))[1]
    on, close, inside = (bool(distribution.at_edge(jnp.array([a]))[0]) for a in (1.0, -0.985, 0.97))
    assert (on, inside) == (True, False)
    assert close == (name != "clipped-gaussian")


def test_the_gaussians_numbers_are_those_of_the_policies_made_of_it():
    for name in NAMES[:3]:
        policy, _ = make(name, -3.0, 1.0, [0.0])
        bias, params = policy.init(Hypers(log_std_init=-1.5))
        assert (np.asarray(bias) == 0).all()
        np.testing.assert_allclose(params["log_std"], -1.5)
        floored = make(name, -3.0, 1.0, [0.2], -9.0, log_std_min=-2.0)[1]
        np.testing.assert_allclose(floored.entropy(), make(name, -3.0, 1.0, [0.2], -2.0)[1].entropy(), rtol=1e-6)


def test_beta_starts_with_one_peak_in_the_middle():
    policy, _ = make("beta", -1.0, 1.0, [0.0, 0.0])
    outputs, params = policy.init(Hypers())
    start = policy.distribution(jnp.asarray(outputs), params, Hypers())
    np.testing.assert_allclose([start.alpha, start.beta], 1 + np.log(2), rtol=1e-6)
    assert float(start.std()[0]) == pytest.approx(0.478, abs=1e-3)


@pytest.mark.parametrize("shape", [1.0, 1.3, 3.0, 50.0, 1e4])
def test_beta_is_right_for_small_and_large_shapes(shape):
    for other in (1.0, 2.0, 700.0):
        from galton.policies import Beta

        one, box = np.ones(1, np.float32), (np.zeros(1, np.float32), np.ones(1, np.float32))
        distribution = Beta(jnp.asarray(shape * one), jnp.asarray(other * one), *box)
        known = stats.beta(shape, other)
        action = np.clip(known.ppf([0.01, 0.3, 0.6, 0.99]), 1e-5, 1 - 1e-5).astype(np.float32)
        found = jax.vmap(lambda a, distribution=distribution: distribution.log_prob(a[None]))(jnp.asarray(action))
        np.testing.assert_allclose(found, known.logpdf(action.astype(np.float64)), rtol=1e-4, atol=2e-3)
        assert float(distribution.entropy()) == pytest.approx(known.entropy(), rel=1e-4, abs=1e-4)
        assert float(distribution.std()[0]) == pytest.approx(known.std(), rel=1e-5)
