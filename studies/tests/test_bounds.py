"""The numbers that are read off samples are right where the samples' factors are known."""

import numpy as np
import pyarrow as pa

from studies.paper.norms import crossings, findings, look_means, read, smaller_from

from .samples import SERIES, SHARED, plain, sample, table

KNOWN = table(plain)


def test_findings_of_known_samples():
    found = findings(KNOWN)
    assert len(found) == 2 * len(SERIES)
    printed, likelihood = found["lqr", "gaussian", "sigma"], found["lqr", "gaussian", "sigma^2"]
    softmax, centred = found["lqr", "hl-gauss", ""], found["lqr", "hl-gauss-centred", ""]
    for finding, own in ((printed, 1.0), (likelihood, 2.0), (softmax, 1.5)):
        np.testing.assert_allclose(finding.own_bound, [own, own])
        np.testing.assert_allclose(finding.bound, [SHARED * own] * 2)
        np.testing.assert_allclose(finding.norm, [0.25 * SHARED * own] * 2)
        np.testing.assert_allclose(finding.tightness, [0.25, 0.25])
        np.testing.assert_allclose([finding.deviation, finding.variation], 0, atol=1e-6)
    for finding, exponent in ((printed, 0), (likelihood, -1), (softmax, 0)):
        np.testing.assert_allclose(finding.exponent, exponent, atol=1e-6)
    assert np.isnan(centred.exponent).all()


def test_a_look_counts_for_the_steps_around_it():
    """At steps 0, 10 and 100 the bound is 1, 2 and 9 times |A|; they stand for 5, 50 and 45 of 100 steps."""
    ratios = {0: 1.0, 10: 2.0, 100: 9.0}
    rows = table(lambda *of: [sample(a, of[4], ratios[of[3]] / SHARED) for a in (-1.0, 3.0)], steps=tuple(ratios))
    found = findings(rows)["lqr", "gaussian", "sigma"]
    mean = 0.05 * 1 + 0.5 * 2 + 0.45 * 9
    deviation = (0.05 * (1 - mean) ** 2 + 0.5 * (2 - mean) ** 2 + 0.45 * (9 - mean) ** 2) ** 0.5
    np.testing.assert_allclose(found.bound, mean)
    np.testing.assert_allclose(found.deviation, deviation)
    np.testing.assert_allclose(found.variation, deviation / mean)


def test_large_advantages_weigh_no_more_than_small_ones():
    """The bound is 1 and 3 times |A|; the advantages of the latter are tiny."""
    rows = table(lambda *of: [sample(100.0, of[4], 1 / SHARED), sample(1e-3, of[4], 3 / SHARED)])
    np.testing.assert_allclose(findings(rows)["lqr", "gaussian", "sigma"].bound, [2.0, 2.0])


def test_seeds_are_kept_apart_whatever_the_order_of_rows():
    rows = table(lambda *of: [sample(1.0, 1.0, (1 + of[5]) * (1 + of[3] / 40) / SHARED)])
    shuffled = read(rows.take(np.random.default_rng(0).permutation(rows.num_rows)))
    chosen = (shuffled["loss"] == "hl-one-hot") & (shuffled["task"] == "lqr")
    means = look_means({name: column[chosen] for name, column in shuffled.items()}, "bound/|A|")
    np.testing.assert_allclose(means, [[1, 2], [2, 4]])


def test_without_an_advantage_nothing_is_divided():
    (empty,) = read(table(lambda *_: [sample(0.0, 1.0, 1.0)], ("lqr",), (0,), 1).slice(0, 1))["bound/|A|"]
    assert np.isnan(empty)


def test_smaller_from_the_step_after_the_last_at_which_it_is_not():
    steps, theirs = np.array([0, 10, 20, 30]), np.full((3, 4), 2.0)
    of = {None: [1, 1, 1, 2], 0: [1, 1, 1, 1], 20: [1, 3, 1, 1], 30: [3, 3, 3, 1]}
    for expected, looks in of.items():
        ours = np.array([looks, looks, [9.0, 9.0, 9.0, 9.0]])
        assert smaller_from(ours, theirs, steps) == expected


def test_a_crossing_is_counted():
    assert crossings(KNOWN) == 0
    norms = KNOWN.column("norm").to_numpy().copy()
    norms[0] = KNOWN.column("bound")[0].as_py() * (1 + 1e-4)
    norms[7] = np.nan
    norms[1] = 1e-3  # where the advantage and so the bound is 0
    planted = KNOWN.set_column(KNOWN.column_names.index("norm"), "norm", pa.array(norms))
    assert crossings(planted) == 3
