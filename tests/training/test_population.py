"""What is said of an environment before anything is compiled for it."""

import warnings

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete

from galton.training import population

from ..agents import agent
from ..envs.host.walks import Walk


class Seeing(Walk):
    observation_space = Dict(eye=Box(0, 255, (4, 4, 3), np.uint8), t=Discrete(4))


class Feeling(Walk):
    observation_space = Box(0, 255, (4,), np.uint8)


def stop(*_):
    raise NotImplementedError("what follows is slow")


@pytest.mark.parametrize(
    ("env", "normalize", "is_told"), [(Seeing, False, True), (Seeing, True, False), (Feeling, False, False)]
)
def test_raw_images_are_said_not_to_suit_the_networks(env, normalize, is_told, monkeypatch):
    monkeypatch.setattr(population, "HostPopulation", stop)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        with pytest.raises(NotImplementedError):
            population.populate(env, agent({"normalize_observation": normalize}), [0])
    assert len(told) == is_told
    for warning in told:
        assert str(warning.message).startswith("Seeing observes Dict('eye': Box(0, 255, (4, 4, 3), uint8)")
        assert "Galton has no convolutions" in str(warning.message)
        assert "normalize_observation=True" in str(warning.message)
