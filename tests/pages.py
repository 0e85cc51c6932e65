"""Pages that are made again from published data, on any processor."""

import decimal
import re

DECIMAL = re.compile(r"\d+\.\d+")


def check_alike(made, published):
    """Fail unless two files are alike, but for numbers that lie half-way between two and may be rounded to either."""
    made, published = made.read_text(), published.read_text()
    assert DECIMAL.split(made) == DECIMAL.split(published)
    for one, other in zip(DECIMAL.findall(made), DECIMAL.findall(published), strict=True):
        unit = decimal.Decimal(1).scaleb(decimal.Decimal(other).as_tuple().exponent)
        assert abs(decimal.Decimal(one) - decimal.Decimal(other)) <= unit
