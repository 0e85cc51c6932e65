"""Boxes for the tests of spaces."""

import numpy as np
from gymnasium.spaces import Box


def box(low, high, dtype=np.float32):
    return Box(np.array(low, dtype), np.array(high, dtype), dtype=dtype)


UNIT = box([-1], [1])
