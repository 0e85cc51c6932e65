import numpy as np
import pytest

from galton_experiments.analysis.statistics import Comparison, Interval
from studies.paper.verdicts import Unit, claim, marks, null, summed_up, unit


def found(mean, p, side=None):
    """A comparison with this mean difference and p, whose ranks lie on the mean's side."""
    side = int(np.sign(mean)) if side is None else side
    return Comparison(Interval(*np.float64([mean, mean - 1, mean + 1])), p, 0.5 + 0.4 * side)


FOR, AGAINST, OPEN = found(2.0, 0.001), found(-2.0, 0.001), found(0.1, 0.7)
FEW, NULL = found(2.0, np.nan), null("null: nothing learned")


def judged(units, **options):
    return claim("§1", "words", "test", units, **options)


@pytest.mark.parametrize(
    ("units", "expected", "count"),
    [
        ([FOR, FOR], "holds", (2, 2)),
        ([FOR, FEW, NULL], "holds", (1, 1)),
        ([FOR, OPEN], "holds in part", (1, 2)),
        ([FOR, AGAINST], "holds in part", (1, 2)),
        ([FOR, AGAINST, AGAINST], "does not hold", (1, 3)),
        ([AGAINST, OPEN], "does not hold", (0, 2)),
        ([OPEN, OPEN], "not decidable here", (0, 2)),
        ([FEW, NULL], "not decidable here", None),
        ([], "not decidable here", None),
    ],
)
def test_a_claim_is_k_of_n_units_that_can_be_decided(units, expected, count):
    told = judged({str(i): each for i, each in enumerate(units)})
    assert (told.verdict, told.count) == (expected, count)


def test_each_unit_is_a_line_with_its_mark_number_and_adjusted_p():
    told = judged({"A": FOR, "B": AGAINST, "C": OPEN, "D": NULL, "E": FEW})
    assert told.number.splitlines() == [
        "✓ A +2.00 ± 1.00, P = 0.90, p = 0.003",
        "✗ B −2.00 ± 1.00, P = 0.10, p = 0.003",
        "≈ C +0.10 ± 1.00, P = 0.90, p = 0.70",
        "∅ D null: nothing learned",
        "? E +2.00 ± 1.00, P = 0.90",
    ]
    assert told.why == "1 of 3 as the paper says, 1 clearly the contrary."


def test_what_one_decision_makes_clear_many_do_not():
    assert marks({"A": found(1.0, 0.03)}) == {"A": "✓"}
    assert marks({name: found(1.0, 0.03) for name in "AB"}) == dict.fromkeys("AB", "≈")
    assert marks({"A": found(1.0, 0.03), "B": FEW, "C": NULL})["A"] == "✓"


def test_a_mean_that_points_against_the_ranks_is_not_clear():
    """As where one run in fifty fails: the mean is lower, nearly every run is higher."""
    assert marks({"A": found(-2.0, 1e-6, side=1)}) == {"A": "≈"}


def test_a_claim_of_no_harm_holds_unless_there_is_some():
    assert judged({"A": OPEN, "B": FOR}, unless_contrary=True).count == (2, 2)
    assert judged({"A": OPEN, "B": AGAINST}, unless_contrary=True).verdict == "holds in part"
    assert judged({"A": AGAINST}, unless_contrary=True).verdict == "does not hold"
    assert judged({"A": FEW}, unless_contrary=True).verdict == "not decidable here"


def test_notes_follow_the_count_and_sum_up_by_name():
    note = summed_up("By the other return", {"A": FOR, "B": OPEN, "C": OPEN})
    assert note == "By the other return: 1 as the paper says (A); 2 no clear difference (B, C)."
    assert claim("§1", "w", "t", {"A": FOR}, "", note).why == f"1 of 1 as the paper says.\n{note}"
    assert summed_up("Nothing", {}) == ""
    assert claim("§1", "w", "t", {}, note).why == "What it needs was not trained."


def test_a_unit_may_tell_something_else_than_the_difference():
    assert unit(FOR, "80 and 120") == Unit("80 and 120", 0.001, 1)
    assert judged({"A": unit(FOR, "80 and 120")}).number == "✓ A 80 and 120, p = 0.001"
