"""Agents for tests, by their words and the bounds of their actions."""

import numpy as np

from galton.agents import read
from galton.parts import Box


def agent(config=None, hypers=None, low=(-1.0,), high=(1.0,)):
    """The agent of these words, in a box."""
    return read((config or {}) | (hypers or {})).on(Box.of(np.atleast_1d(low), np.atleast_1d(high)))
