"""Records of results as JSON has them."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, SupportsFloat

import numpy as np


def rounded(number: SupportsFloat) -> float:
    """Round to eight significant digits: those behind them depend on the order in which a processor adds."""
    return float(f"{float(number):.8g}")


def plain(value: Any, number: Callable[[float], float] = float) -> Any:
    """Records as dictionaries, arrays as lists, and None for numbers that are not finite.

    Args:
        value: of anything that JSON or this knows.
        number: makes each finite number with decimals what it is to be.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name), number) for field in dataclasses.fields(value)}
    if hasattr(value, "_asdict"):
        return plain(value._asdict(), number)
    if isinstance(value, Mapping):
        return {str(name): plain(of, number) for name, of in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist(), number)
    if isinstance(value, list | tuple):
        return [plain(entry, number) for entry in value]
    if isinstance(value, float):
        return number(value) if math.isfinite(value) else None
    return value
