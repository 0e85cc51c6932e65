"""The distribution in torch has the numbers of Galton's own losses in JAX, and torch's tools work on it."""

import os

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.distributions import Categorical, kl_divergence

import galton
from galton import critics, losses
from galton.bins import Bins
from galton.policies import exploration
from galton.policies.histogram import Histogram as Ours
from galton.torch import Histogram, classification_loss, first_logits, initialize_, value_of

KINDS = {
    "hl-one-hot": losses.HLOneHot,
    "hl-gauss": losses.HLGauss,
    "hl-gauss-centred": losses.HLGaussCentred,
}
CASES = st.fixed_dictionaries(
    {
        "loss": st.sampled_from(list(KINDS)),
        "n_bins": st.sampled_from([2, 3, 8, 41, 60]),
        "eta": st.floats(0.05, 6),
        "target_tails": st.sampled_from(["rescaled", "edges", "reflected"]),
        "bin_centers": st.sampled_from(["inside", "bounds"]),
        "seed": st.integers(0, 10**6),
    }
)


def both(case, dtype=np.float64, n=7, d=3):
    """Logits, actions in the centers of bins, and the distributions of both libraries."""
    rng = np.random.default_rng(case["seed"])
    low = rng.uniform(-4, 1, d)
    high = low + rng.uniform(0.5, 5, d)
    logits = rng.normal(size=(n, d, case["n_bins"])) * 3
    bins = Bins(low, high, case["n_bins"], case["bin_centers"])
    action = np.asarray(bins.decode(rng.integers(case["n_bins"], size=(n, d))), dtype)
    words = {name: case[name] for name in ("loss", "eta", "target_tails", "bin_centers")}
    given = torch.tensor(logits.astype(dtype), requires_grad=True)
    theirs = Histogram(given, torch.tensor(low.astype(dtype)), torch.tensor(high.astype(dtype)), **words)
    of_loss = {} if case["loss"] == "hl-one-hot" else {name: case[name] for name in ("eta", "target_tails")}
    return jnp.asarray(logits, dtype), action, bins, KINDS[case["loss"]](**of_loss), given, theirs


def agree(case, dtype, tolerance):
    logits, action, bins, loss, given, theirs = both(case, dtype)
    ours = Ours(bins, logits)
    acted = torch.tensor(action)
    np.testing.assert_allclose(theirs.log_prob(acted).detach(), ours.log_prob(jnp.asarray(action)), **tolerance)
    np.testing.assert_allclose(theirs.loss(acted).detach(), loss(ours, jnp.asarray(action)), **tolerance)
    np.testing.assert_allclose(theirs.entropy().detach(), ours.entropy(), **tolerance)
    np.testing.assert_allclose(theirs.mean.detach(), ours.mean(), **tolerance)
    np.testing.assert_allclose(theirs.stddev.detach(), ours.std(), **tolerance)
    weight = np.random.default_rng(1).normal(size=len(action)).astype(dtype)
    expected = jax.grad(lambda logits: (weight * loss(Ours(bins, logits), jnp.asarray(action))).sum())(logits)
    for gradient in (
        torch.autograd.grad((torch.tensor(weight) * theirs.loss(acted)).sum(), given)[0],
        torch.autograd.grad(-(torch.tensor(weight) * theirs.log_prob(acted)).sum(), given)[0],
    ):
        np.testing.assert_allclose(gradient, expected, **tolerance)


@settings(max_examples=40)
@given(CASES)
def test_values_and_gradients_are_those_of_the_losses_in_jax(case):
    with jax.enable_x64(True):
        agree(case, np.float64, {"rtol": 1e-10, "atol": 1e-11})


@pytest.mark.parametrize("loss", KINDS)
def test_they_are_in_float32_too(loss):
    case = {"loss": loss, "n_bins": 41, "eta": 2.0, "target_tails": "edges", "bin_centers": "inside", "seed": 0}
    agree(case, np.float32, {"rtol": 2e-5, "atol": 2e-5})


def test_it_is_a_product_of_categoricals():
    logits = torch.randn(4, 2, 9)
    found, per_entry = Histogram(logits, loss="hl-one-hot"), Categorical(logits=logits)
    other = Histogram(torch.randn(4, 2, 9))
    torch.testing.assert_close(found.entropy(), per_entry.entropy().sum(-1))
    expected = kl_divergence(per_entry, Categorical(logits=other.logits)).sum(-1)
    torch.testing.assert_close(kl_divergence(found, other), expected)
    torch.manual_seed(0)
    drawn = found.sample((20_000,))
    share = (drawn[..., None] == found.centers).float().mean(0)
    np.testing.assert_allclose(share, found.probs, atol=0.015)
    assert found.batch_shape == (4,)
    assert found.event_shape == (2,)
    assert found.expand((3, 4)).log_prob(found.sample()).shape == (3, 4)
    assert bool(found.support.check(drawn).all())
    likeliest = found.centers.expand(4, 2, 9).gather(2, logits.argmax(-1)[..., None])[..., 0]
    torch.testing.assert_close(found.mode, likeliest)
    torch.testing.assert_close(Histogram(logits, deterministic="mode").deterministic_sample, likeliest)
    torch.testing.assert_close(found.deterministic_sample, found.mean)


@pytest.mark.parametrize("low", [-0.9, 100.3, -0.7])
def test_half_precision_and_rounding_leave_the_box_whole(low):
    """Bounds and centers are in float32 whatever the logits are, and no center lies outside of the box."""
    high = low + 1.0
    found = Histogram(torch.zeros(2000, 1, 41, dtype=torch.bfloat16), low, high, validate_args=True)
    drawn = found.sample()
    assert drawn.dtype == found.centers.dtype == torch.float32
    assert len(found.centers.unique()) == 41
    assert bool(found.support.check(drawn).all())
    assert np.float32(low) <= drawn.min() < drawn.max() <= np.float32(high)
    index = found._encode(drawn)
    torch.testing.assert_close(found.centers[0][index], drawn, rtol=0, atol=0)
    at_the_end = Histogram(torch.zeros(1000, 1, 41).index_fill(2, torch.tensor([40]), 17.0), low, high)
    assert bool((at_the_end.deterministic_sample <= at_the_end.high).all())
    logits = torch.randn(5, 2, 41, requires_grad=True)
    action = Histogram(logits).sample()

    def gradient():
        return torch.autograd.grad(Histogram(logits).log_prob(action).sum(), logits)[0]

    plain = gradient()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        torch.testing.assert_close(gradient(), plain)
        critic = classification_loss(logits[:, 0].bfloat16(), torch.linspace(-900, 900, 5), -1000, 1000)
    assert critic.dtype == torch.float32


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs CUDA")
def test_it_is_the_same_on_a_gpu():
    logits, action = torch.randn(5, 2, 11), Histogram(torch.zeros(5, 2, 11)).sample()
    there = Histogram(logits.cuda(), low=np.float32([-1, -1])).log_prob(action.cuda())
    torch.testing.assert_close(there.cpu(), Histogram(logits).log_prob(action))


@pytest.mark.skipif("CHECKED" in os.environ, reason="torch compiles no checker")
def test_it_is_compiled_mapped_and_cast():
    logits, action = torch.randn(5, 2, 11), torch.zeros(5, 2)

    def log_prob(logits, action):
        return Histogram(logits).log_prob(action)

    expected = log_prob(logits, action)
    torch.testing.assert_close(torch.func.vmap(log_prob)(logits, action), expected)
    torch.testing.assert_close(torch.compile(log_prob, backend="aot_eager", fullgraph=True)(logits, action), expected)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        half = Histogram(logits.bfloat16()).log_prob(action)
    assert half.dtype == torch.float32
    torch.testing.assert_close(half, log_prob(logits.bfloat16().float(), action))


def test_the_deterministic_action_is_exported():
    class Acting(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.body = torch.nn.Linear(3, 22)

        def forward(self, observation):
            return Histogram(self.body(observation).unflatten(-1, (2, 11)), validate_args=False).deterministic_sample

    acting, observation = Acting(), torch.randn(4, 3)
    exported = torch.export.export(acting, (observation,)).module()
    torch.testing.assert_close(exported(observation), acting(observation))


@pytest.mark.parametrize(
    "words", [{"target": "hl-gauss", "eta": 0.75}, {"target": "hl-gauss", "eta": 2.0}, {"target": "two-hot"}]
)
def test_critics_are_galtons(words):
    own = {"n_value_bins": 21, "value_min": -3.0, "value_max": 5.0}
    kind = (
        critics.TwoHotCritic(**own)
        if words["target"] == "two-hot"
        else critics.HLGaussCritic(**own, value_eta=words["eta"])
    )
    logits, returns = torch.randn(50, 21, requires_grad=True), torch.linspace(-6, 8, 50)
    found = classification_loss(logits, returns, -3, 5, **words)
    expected = kind.loss(jnp.asarray(logits.detach()), jnp.asarray(returns))
    np.testing.assert_allclose(found.detach(), expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(
        value_of(logits, -3, 5).detach(), kind.value(jnp.asarray(logits.detach())), rtol=1e-4, atol=1e-5
    )
    found.sum().backward()
    assert torch.isfinite(logits.grad).all()


@pytest.mark.parametrize("target", ["hl-gauss", "two-hot"])
def test_a_critics_target_is_a_constant_of_the_logits_precision(target):
    logits, returns = torch.randn(50, 101, requires_grad=True), (torch.randn(50) * 300).bfloat16().requires_grad_()
    found = classification_loss(logits, returns, -1000.0, 1000.0, target)
    torch.testing.assert_close(found, classification_loss(logits, returns.detach().float(), -1000.0, 1000.0, target))
    found.sum().backward()
    assert returns.grad is None
    assert torch.isfinite(logits.grad).all()


@pytest.mark.parametrize("centers", ["inside", "bounds"])
@pytest.mark.parametrize("std", [0.01, 0.6, 3.0])
def test_first_policies_are_galtons(centers, std):
    bins = Bins(-1.0, 1.0, 41, centers)
    for name, start in (
        ("gaussian", exploration.init_gaussian_logits(bins, 0.0, std)),
        ("clipped-gaussian", exploration.init_clipped_gaussian_logits(bins, jnp.zeros((1, 1)), jnp.full((1, 1), std))),
    ):
        ours, theirs = jax.nn.softmax(start[0]), torch.softmax(first_logits(41, name, std, centers), -1)
        np.testing.assert_allclose(theirs, ours, atol=2e-6)
    layer = initialize_(torch.nn.Linear(8, 82), 41, "clipped-gaussian", std, centers, head_scale=4.0)
    first = Histogram(layer(torch.zeros(8)).unflatten(-1, (2, 41)), bin_centers=centers, head_scale=4.0)
    np.testing.assert_allclose(first.probs.detach()[1], theirs, atol=1e-5)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"low": -np.inf}, "low is .*-inf.* bins need finite bounds"),
        ({"low": 1.0, "high": 1.0}, "each low must lie below its high"),
        ({"low": 1e7, "high": 1e7 + 1}, "5 bins between them are too narrow for float32"),
        ({"low": [0.0, 0.0, 0.0]}, r"low has shape \(3,\); the logits .* have d = 2"),
        ({"low": "none"}, "low is 'none'; it must be a number"),
        ({"logits": torch.zeros(2, 1)}, "the number of bins is 1; it must be an integer of at least 2"),
        ({"logits": torch.zeros(5)}, r"logits have shape \(5,\); they must be"),
        ({"logits": torch.full((2, 5), torch.nan)}, "logits hold NaN or infinity"),
        ({"logits": torch.full((2, 5), -torch.inf)}, "logits hold NaN or infinity"),
        ({"low": -np.inf, "validate_args": False}, "bins need finite bounds"),
        ({"low": torch.tensor(1.0), "high": torch.tensor(-1.0), "validate_args": False}, "each low must lie below its"),
        ({"head_scale": 0.0}, "head_scale is 0.0; it must be finite, and greater than 0"),
        ({"eta": 0.0}, "eta is 0.0; the target's width must be finite"),
        ({"loss": "gaussian"}, "loss is 'gaussian'; choose from hl-one-hot, hl-gauss, hl-gauss-centred"),
        ({"target_tails": "cut"}, "target_tails is 'cut'; choose from"),
    ],
)
def test_what_makes_no_distribution_is_refused(words, message):
    with pytest.raises(galton.UsageError, match=message):
        Histogram(**{"logits": torch.zeros(2, 5), "validate_args": True} | words)


def test_bounds_keep_their_digits_in_float64():
    fine = Histogram(torch.zeros(1, 5, dtype=torch.float64), low=0.1, high=0.7, validate_args=True)
    assert fine.high.item() == 0.7
    assert abs(kl_divergence(fine, Histogram(torch.zeros(1, 5), low=0.1, high=0.7)).item()) < 1e-6


def test_an_action_outside_of_the_box_is_refused():
    found = Histogram(torch.zeros(2, 5), validate_args=True)
    found.log_prob(torch.tensor([1.00001, -1.0]))
    with pytest.raises(galton.UsageError, match=r"an action is 1.5, outside of the box from \[-1.0, -1.0\] to"):
        found.log_prob(torch.tensor([1.5, 0.0]))
    with pytest.raises(galton.UsageError, match=r"actions have shape \(4,\); they must be \[..., d\], and d is 2"):
        Histogram(torch.zeros(4, 2, 5)).log_prob(torch.zeros(4))
    with pytest.raises(galton.UsageError, match="the network has diverged"):
        Histogram(torch.full((2, 5), torch.nan), validate_args=False).sample()


def test_an_action_that_is_nan_has_no_likelihood_where_nobody_validates():
    action = torch.tensor([[0.0, torch.nan], [0.0, 0.5]])
    for loss in KINDS:
        found = Histogram(torch.randn(2, 2, 9), loss=loss, validate_args=False)
        for told in (found.log_prob(action), found.loss(action)):
            assert torch.isnan(told).tolist() == [True, False]


def test_half_precision_logits_are_scaled_in_float32():
    logits = (torch.randn(50, 2, 41) * 3).bfloat16()
    scaled = Histogram(logits, head_scale=3.0).log_probs
    torch.testing.assert_close(scaled, Histogram(logits.float(), head_scale=3.0).log_probs)
    assert torch.isfinite(Histogram(torch.tensor([[0.0, 20_000.0]]).half(), head_scale=4.0).log_probs).all()


def test_what_makes_no_critic_first_policy_or_divergence_is_refused():
    logits = torch.zeros(4, 5)
    for arguments, words, message in (
        ((logits, torch.zeros(4, 1), -1, 1), {}, r"returns have shape \(4, 1\)"),
        ((logits, torch.zeros(4), -np.inf, 1), {}, "low is -inf and high 1; both must be finite"),
        ((logits, torch.zeros(4), -1, 1), {"eta": 0.0}, "eta is 0.0"),
        ((logits[:, :1], torch.zeros(4), -1, 1), {}, r"logits have shape \(4, 1\)"),
    ):
        with pytest.raises(galton.UsageError, match=message):
            classification_loss(*arguments, **words)
    with pytest.raises(galton.UsageError, match="the number of bins is 1"):
        first_logits(1)
    with pytest.raises(galton.UsageError, match="bin_centers is 'bound'"):
        first_logits(5, bin_centers="bound")
    with pytest.raises(galton.UsageError, match="the layer has no bias"):
        initialize_(torch.nn.Linear(3, 10, bias=False), 5)
    with pytest.raises(galton.UsageError, match="other bounds than the other"):
        kl_divergence(Histogram(logits, validate_args=True), Histogram(logits, -2.0, 2.0))
    with pytest.raises(galton.UsageError, match="d, k and bin_centers"):
        kl_divergence(Histogram(torch.zeros(2, 5)), Histogram(torch.zeros(1, 5)))
