"""Returns of any scale are printed with decimals that show them."""

import math
from typing import SupportsFloat


def fitting(*returns: SupportsFloat) -> str:
    """The format of returns that stand together: two decimals, or two digits of the largest where that is below 0.1."""
    largest = max((size for size in map(abs, map(float, returns)) if math.isfinite(size)), default=0.0)
    decimals = max(2, 1 - math.floor(math.log10(largest))) if largest else 2
    return f",.{decimals}f"
