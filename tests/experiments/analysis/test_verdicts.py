"""Marks of several comparisons, adjusted together, and numbers as they are written."""

import numpy as np

from galton_experiments.analysis.statistics import Comparison, Interval
from galton_experiments.analysis.verdicts import decide, rounded


def found(p, above, mean):
    return Comparison(Interval(*np.float64([mean, mean - 1, mean + 1])), p, above)


def test_all_are_adjusted_together_and_mean_and_ranks_must_agree():
    clear = {"a": found(0.001, 0.9, 2.0), "b": found(0.001, 0.1, -2.0), "c": found(0.001, 0.9, -2.0)}
    few = {"d": found(np.nan, 0.9, 2.0)}
    assert {name: each.mark for name, each in decide(clear | few).items()} == {"a": "✓", "b": "✗", "c": "≈", "d": "?"}
    assert decide(clear)["a"].p == 0.003
    assert decide({"a": found(0.03, 0.9, 2.0)})["a"].mark == "✓"
    assert {each.mark for each in decide(dict.fromkeys("ab", found(0.03, 0.9, 2.0))).values()} == {"≈"}


def test_large_numbers_have_no_decimals():
    assert rounded(Interval(*np.float64([608.3, 230.1, 986.5]))) == "+608 ± 378"
    assert rounded(Interval(*np.float64([-1897.2, -3076.0, -718.4])), "") == "−1,897 ± 1,179"
    assert rounded(Interval(*np.float64([0.5, 0.25, 0.75])), "") == "0.50 ± 0.25"
    assert rounded(Interval(*np.float64([0.5, np.nan, np.nan]))) == "+0.50"
