"""Agents for tests, by the flat records and the bounds of their actions."""

import numpy as np

from galton import Config, Hypers
from galton.agents import agent_of
from galton.parts import Box


def agent(config=Config(), hypers=Hypers(), low=(-1.0,), high=(1.0,)):  # noqa: B008
    """The agent of these records in a box."""
    return agent_of(config, hypers).on(Box.of(np.atleast_1d(low), np.atleast_1d(high)))
