"""What is handed over as an environment: records of the user's own that are not finished, and what they lack."""

import dataclasses

import pytest

from galton import UsageError
from galton.envs import LQR, Environment, MountainCar
from galton.envs.find import find

BOUNDS = ["action_low", "action_high", "observation_low", "observation_high"]
NUMBERS = ["max_episode_steps", "optimal_return", "random_return"]
MEMBERS = [*BOUNDS, *NUMBERS, "reset", "noise", "step", "observe"]


def without(*names):
    """A Mountain Car that lacks those members."""
    kept = {name: getattr(MountainCar, name) for name in MEMBERS if name not in names}
    return type("Hill", (), kept | {"__repr__": lambda self: "Hill()"})()


def test_a_record_with_all_members_is_taken_as_it_is():
    whole = without()
    assert isinstance(whole, Environment)
    assert find(whole) is whole


@pytest.mark.parametrize("name", MEMBERS)
def test_a_record_that_lacks_a_member_is_told_which(name):
    with pytest.raises(UsageError, match=rf"env is Hill\(\), a record that lacks {name}; .* not known is None"):
        find(without(name))


def test_all_that_is_missing_is_named():
    with pytest.raises(UsageError, match=r"lacks action_low, random_return, noise; give it all of galton\.envs\.Envir"):
        find(without("random_return", "noise", "action_low"))


def test_what_only_resets_and_steps_may_be_of_any_library():
    others = set(MEMBERS) - {"reset", "step"}
    with pytest.raises(UsageError, match=r"env is Hill\(\); give a Gymnasium id"):
        find(without(*others))


def test_a_record_that_can_not_be_hashed_is_told_the_remedy():
    members = {name: getattr(MountainCar, name) for name in MEMBERS}
    melting = dataclasses.make_dataclass("Melting", [], namespace=members)()
    with pytest.raises(UsageError, match=r"Melting\(\), a record that can't be hashed, .*make it a frozen dataclass"):
        find(melting)


def test_the_class_of_a_record_is_not_a_record():
    with pytest.raises(UsageError, match=r"env is <class 'galton.envs.lqr.LQR'>, a class; .*by calling it"):
        find(LQR)
