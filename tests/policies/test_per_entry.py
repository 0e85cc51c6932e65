"""Numbers of an action may have bins, centers, a first policy and a target's width of their own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ndtr

from galton import Bins, UsageError, targets
from galton.agents import make_agent, words_of
from galton.bins import PlacedBins, mu_law
from galton.losses import HLGauss
from galton.parts import Box
from galton.policies.per_entry import read

BOX = Box.of([-1, 0], [1, 4])
NAMED = Box.of([-1, -1, 0, 0], [1, 1, 4, 2], (0, 0, 0, 3))._replace(names=("arm.0", "arm.1", "wheel", "gear"))
CENTERS = (-1, -0.1, 0, 0.1, 0.9)


def on(box=BOX, **words):
    return make_agent(**{"loss": "hl-gauss", "n_bins": 7, "eta": 0.5} | words).on(box)


def random_policy(agent, n=6):
    outputs = jax.random.normal(jax.random.key(0), (n, agent.policy.n_outputs))
    return agent.policy.distribution(outputs, {})


def test_a_list_has_a_value_for_each_number_and_a_dictionary_one_by_name_or_place():
    assert on(n_bins=(5, 9)).policy.sizes == (5, 9)
    assert on(n_bins={1: 9}).policy.sizes == (100, 9)
    assert on(per_entry=["1.n_bins=9"]).policy.sizes == (7, 9)
    agent = on(NAMED, n_bins={"arm": 5, "2": 9})
    assert agent.policy.sizes == (5, 5, 9, 3)
    assert on(NAMED, bin_centers=(0, 0.5, 1)).policy.sizes == (3, 3, 3, 3)
    assert words_of(agent)["per_entry"] == ("arm.n_bins=5", "2.n_bins=9")


def test_each_number_is_as_in_a_policy_of_its_own():
    agent = on(n_bins=(5, 9), eta={"*": 0.5, 0: 1.5}, initial_policy=("gaussian", "uniform"))
    alone = [on(Box.of([-1], [1]), n_bins=5, eta=1.5, initial_policy="gaussian"), on(Box.of([0], [4]), n_bins=9)]
    found = random_policy(agent)
    rows = jnp.split(jax.random.normal(jax.random.key(0), (6, 14)), [5], -1)
    action = found.sample(agent.policy.noise(jax.random.key(1), (6,)))
    own = [one.policy.distribution(row, {}) for one, row in zip(alone, rows, strict=True)]
    for name in ("log_prob", "entropy"):
        arguments = [action] if name == "log_prob" else []
        each = [getattr(one, name)(*(a[:, i : i + 1] for a in arguments)) for i, one in enumerate(own)]
        np.testing.assert_allclose(getattr(found, name)(*arguments), sum(each), rtol=1e-5)
    each = [one.loss(policy, action[:, i : i + 1]) for i, (one, policy) in enumerate(zip(alone, own, strict=True))]
    np.testing.assert_allclose(agent.loss(found, action), sum(each), rtol=1e-5)
    expected = agent.loss.expected_target(found)
    for i, (one, policy) in enumerate(zip(alone, own, strict=True)):
        k = one.policy.n_bins
        np.testing.assert_allclose(expected[:, i, :k], one.loss.expected_target(policy)[:, 0], atol=1e-6)
    first = jnp.concatenate([one.policy.init()[0] for one in alone])
    np.testing.assert_allclose(agent.policy.init()[0], first)


@pytest.mark.parametrize("tails", ["rescaled", "edges", "reflected"])
@pytest.mark.parametrize("eta", [0.2, 0.8, 3.0])
def test_targets_of_placed_bins_are_a_normals_masses_in_the_actions_units(tails, eta):
    bins = PlacedBins(-1.0, 1.0, CENTERS)
    edges = np.array([-1, -0.55, -0.05, 0.05, 0.5, 1])
    np.testing.assert_allclose(bins.edges[0], edges, rtol=1e-6)
    sigma = eta * 2 / 5
    for action in (*CENTERS, 0.7, -0.4):
        images = [action] if tails != "reflected" else [4 * m + a for m in range(-9, 10) for a in (action, 2 - action)]
        wanted = sum(np.diff(ndtr((edges - image) / sigma)) for image in images)
        if tails == "edges":
            wanted[[0, -1]] += ndtr((-1 - action) / sigma), ndtr((action - 1) / sigma)
        found = targets.hl_gauss(bins, jnp.array([action], float), eta, tails)[0]
        np.testing.assert_allclose(found, wanted / wanted.sum(), atol=2e-6)
    agent = on(Box.of([-1], [1]), bin_centers=CENTERS, eta=eta, target_tails=tails)
    policy = random_policy(agent)
    kernel = np.stack([targets.hl_gauss(bins, jnp.array([center], float), eta, tails)[0] for center in CENTERS])
    np.testing.assert_allclose(agent.loss.expected_target(policy)[:, 0], policy.probs[:, 0] @ kernel, atol=1e-6)
    np.testing.assert_allclose(HLGauss.target(agent.loss, policy, bins.decode(jnp.full((6, 1), 3)))[0, 0], kernel[3])


def test_bins_that_lie_closer_in_the_middle_follow_the_mu_law():
    centers = mu_law(-1, 1, 9, mu=255)
    np.testing.assert_allclose(np.sign(centers) * np.log1p(255 * abs(centers)) / np.log(256), np.linspace(-1, 1, 9))
    assert (centers[0], centers[-1]) == (-1, 1)
    agent = on(Box.of([2], [6]), bin_centers={0: "mu-law"}, n_bins=9)
    np.testing.assert_allclose(agent.policy.bins.centers[0], 4 + 2 * centers, rtol=1e-6)


def test_placed_bins_as_even_ones_are_even():
    even, placed = Bins(-1, 3, 6, "bounds"), PlacedBins(-1, 3, np.linspace(-1, 3, 6))
    action = jax.random.uniform(jax.random.key(0), (1000, 1), minval=-1.5, maxval=3.5)
    np.testing.assert_array_equal(even.encode(action), placed.encode(action))
    np.testing.assert_allclose(placed.edges, even.edges, atol=1e-6)


def test_a_first_gaussian_over_placed_bins_has_its_moments():
    agent = on(Box.of([-1], [1]), bin_centers={0: "mu-law"}, n_bins=101, initial_policy="gaussian", log_std_init=-1.5)
    first = agent.policy.distribution(agent.policy.init()[0], {})
    np.testing.assert_allclose(first.std(), np.exp(-1.5), rtol=0.02)
    np.testing.assert_allclose(first.mean(), 0, atol=1e-6)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"n_bins": (5,)}, "'n_bins=.5.', 1 values, and the action has 2 numbers"),
        ({"n_bins": {"wheel": 5}}, "'wheel' is no number of the action; its entries are 0, 1"),
        ({"n_bins": {0: 1}}, "n_bins in '0.n_bins=1' is 1; it must be an integer of at least 2"),
        ({"eta": {0: 0.0}}, "eta in '0.eta=0.0' is 0.0; it must be finite, and greater than 0"),
        ({"bin_centers": (0, -1)}, "bin_centers is .0, -1.; each must lie above the one before"),
        ({"bin_centers": {0: (0, 2)}}, "bin_centers is .0, 2.; they must lie within the bounds, -1 and 1"),
        ({"bin_centers": {0: (0,)}}, "bin_centers is .0,.; give two numbers or more"),
        ({"initial_policy": {0: "wide"}}, "is 'wide'; choose from uniform"),
        ({"per_entry": ["0.gamma=1"]}, "write entry.setting=value"),
        ({"per_entry": ["n_bins=5"]}, "say of which entry, or give a list"),
        ({"n_bins": (5, 9), "bin_sample": "uniform"}, "bin_sample is 'uniform'; where .* bins differ, leave it"),
        ({"n_bins": (5, 9), "policy": "ordinal"}, "per_entry is .*; it goes with policy 'histogram'"),
        ({"ordered": ("1",), "policy": "ordinal"}, "ordered is .*; it goes with policy 'histogram', not 'ordinal"),
    ],
)
def test_what_no_entry_can_have_is_refused(words, message):
    with pytest.raises(UsageError, match=message):
        on(**words)


def test_a_choice_has_no_bins():
    with pytest.raises(UsageError, match=r"'gear' is no number of the action; its entries are arm.0, arm.1, wheel"):
        on(NAMED, n_bins={"gear": 5})


def test_words_are_read_as_they_are_told():
    assert read("arm.0.n_bins=5") == ("arm.0", "n_bins", 5)
    assert read("*.bin_centers=[-1, 0.5]") == ("*", "bin_centers", [-1, 0.5])
