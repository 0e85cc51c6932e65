import math

import pytest

from galton.decimals import fitting


@pytest.mark.parametrize(
    ("returns", "written"),
    [
        ((1234.5,), ["1,234.50"]),
        ((0.1, 0.02), ["0.10", "0.02"]),
        ((-0.00131, 0.0002), ["-0.0013", "0.0002"]),
        ((3e-7,), ["0.00000030"]),
        ((0.0, math.nan, -math.inf), ["0.00", "nan", "-inf"]),
        ((1e-9, 5.0), ["0.00", "5.00"]),
    ],
)
def test_returns_that_stand_together_have_two_digits_of_the_largest(returns, written):
    assert [format(value, fitting(*returns)) for value in returns] == written
