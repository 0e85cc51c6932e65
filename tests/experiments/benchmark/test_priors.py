"""Quantiles of priors."""

import numpy as np
import pytest
from scipy import stats

from galton import UsageError
from galton_experiments.benchmark.priors import Prior, read_table

QUANTILES = np.linspace(0, 1, 41)
DISTRIBUTIONS = {
    "uniform": ([-2, 3], stats.uniform(-2, 5).ppf),
    "log-uniform": ([1e-4, 1e-1], stats.loguniform(1e-4, 1e-1).ppf),
    "log-uniform-below-1": ([0.9, 0.999], lambda q: 1 - stats.loguniform(1e-3, 1e-1).ppf(1 - q)),
}


@pytest.mark.parametrize("kind", DISTRIBUTIONS)
def test_a_quantile_is_scipys_to_four_digits(kind):
    ends, ppf = DISTRIBUTIONS[kind]
    prior = Prior.read("prior.x", {kind: ends})
    found = np.array([prior.at(float(q)) for q in QUANTILES])
    np.testing.assert_allclose(found, ppf(QUANTILES), rtol=6e-4, atol=1e-12)
    assert (found[0], found[-1]) == (ends[0], ends[1])
    assert all(len(f"{1 - x if kind.endswith('1') else x:.10g}".strip("-0.").replace(".", "")) <= 6 for x in found)


def test_a_choice_has_equal_shares():
    prior = Prior.read("prior.n_bins", {"choice": [50, 100, [1, 2]]})
    assert [prior.at(q) for q in (0.0, 0.33, 0.34, 0.66, 0.67, 0.9999, 1.0)] == [50, 50, 100, 100, *[[1, 2]] * 3]


def test_what_is_no_table_is_a_value():
    assert not Prior.read("fixed.loss", "gaussian").is_drawn
    assert Prior.read("fixed.decay_steps", {"value": 1, "times": "steps"}) == Prior("value", (1,), in_steps=True)
    assert Prior.read("prior.decay_steps", {"choice": [0, 1], "times": "steps"}).told() == "0, 1 × steps"


WRONG = [
    ({"normal": [0, 1]}, r"prior.x is \{'normal': \[0, 1\]\}, which is no prior; write a table such as"),
    ({"uniform": [0, 1], "choice": [1]}, "which is no prior"),
    ({"uniform": [0, 1], "log": True}, "which is no prior"),
    ({"uniform": [1]}, r"prior.x.uniform is \[1\]; give a list of two numbers"),
    ({"uniform": 3}, "prior.x.uniform is 3; give a list of two numbers"),
    ({"uniform": ["a", "b"]}, "prior.x.uniform has 'a'; it must have finite numbers"),
    ({"uniform": [0, float("inf")]}, "prior.x.uniform has inf; it must have finite numbers"),
    ({"uniform": [False, True]}, "prior.x.uniform has False"),
    ({"uniform": [1, 1]}, "its first number must be less than its second"),
    ({"log-uniform": [0, 1]}, "prior.x.log-uniform is .*; its numbers must be above 0"),
    ({"log-uniform-below-1": [0.5, 1]}, "its numbers must be below 1"),
    ({"choice": []}, r"prior.x.choice is \[\]; give a list of one value or more"),
    ({"choice": ["a"], "times": "steps"}, "prior.x.choice has 'a'; it must have finite numbers"),
    ({"choice": [1], "times": "seconds"}, "prior.x.times is 'seconds'; leave it out, or write"),
]


@pytest.mark.parametrize(("given", "words"), WRONG, ids=[str(given) for given, _ in WRONG])
def test_what_describes_no_prior_is_refused_by_its_place(given, words):
    with pytest.raises(UsageError, match=words):
        Prior.read("prior.x", given)


def test_a_field_that_changes_the_program_is_drawn_by_choice_alone():
    read_table("prior", {"n_bins": {"choice": [50, 100]}}, drawn=True)
    with pytest.raises(UsageError, match=r"prior.n_bins is uniform, but each value .* write \{ choice"):
        read_table("prior", {"n_bins": {"uniform": [50, 100]}}, drawn=True)
    with pytest.raises(
        UsageError, match=r"prior.n_bins has times, which goes with a number that no program depends on"
    ):
        read_table("prior", {"n_bins": {"choice": [1], "times": "steps"}}, drawn=True)
    with pytest.raises(UsageError, match="which is no setting; did you mean learning_rate"):
        read_table("prior", {"lerning_rate": {"uniform": [0, 1]}}, drawn=True)
