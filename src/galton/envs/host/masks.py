"""Masks of actions: the values that an environment allows in each state, as sb3-contrib's MaskablePPO asks for them."""

from typing import Any

import numpy as np
from jaxtyping import Float

from galton.envs.host.answers import as_numbers, blame, parts, shown
from galton.envs.host.state import Env
from galton.errors import BrokenEnvironmentError, UsageError, require
from galton.parts import Box

KEY, METHOD = "action_mask", "action_masks"


def n_entries(name: str, told: object, box: Box) -> int:
    """The number of entries of a mask; UsageError for one that does not go with the action."""
    values, of_choices, n_numbers = as_numbers(told), sum(box.n_values), len(box.numbers)
    if values is None:
        raise UsageError(
            f"{name}'s action mask is {shown(told)}; give one array of 1 and 0, all choices one after the other"
        )
    n = values.size
    rest = n - of_choices
    require(
        n > 0 and (rest == 0 or (n_numbers > 0 and rest > 0 and rest % n_numbers == 0)),
        f"{name}'s action mask has {n} entries; it must have one for each value of each choice, which are "
        f"{of_choices}, and none of the {n_numbers} numbers or one for each of their bins",
    )
    return n


def first_of(name: str, env: Env, box: Box) -> object:
    """The mask of an environment's first state, or None.

    It is not asked where it can't have a mask: without a method `action_masks` and without choices.
    """
    if not (has_method(env) or box.choices):
        return None
    with blame(f"{name}: reset"):
        answer = env.reset(seed=0)
    return of_one(env, parts(answer, "observation, info", "reset", name)[1], name)


def has_method(env: Env) -> bool:
    """Say whether an environment or one of its wrappers has a method `action_masks`."""
    return bool(env.has_wrapper_attr(METHOD))


def of_one(env: Env, info: Any, where: str) -> Any:
    """The mask that an environment tells in its present state, or None: its method's, or else that of the info."""
    if has_method(env):
        with blame(f"{where}: {METHOD}"):
            return env.get_wrapper_attr(METHOD)()
    return info.get(KEY) if isinstance(info, dict) else None


def checked(told: object, box: Box, where: str) -> Float[np.ndarray, " n"]:
    """A mask as 1 and 0; BrokenEnvironmentError for another shape, other numbers, or an entry without any value."""
    values = as_numbers(told)
    if values is None or values.size != box.n_mask or not np.isin(values, (0, 1)).all():
        raise BrokenEnvironmentError(
            f"{where}: the action mask is {shown(told)}; it must be {box.n_mask} of 1 and 0, or True and False"
        )
    mask: np.ndarray = values.ravel().astype(np.float32)
    entry = forbidden(mask, box)
    if entry is not None:
        raise BrokenEnvironmentError(
            f"{where}: the action mask allows no value of entry {entry} of the action; allow one at least, or end "
            "the episode there"
        )
    return mask


def forbidden(mask: Float[np.ndarray, "*n m"], box: Box) -> int | None:
    """The first entry of the action that has no value that is allowed, in one of these masks; None without any."""
    end = 0
    for entry, size in enumerate(box.mask_sizes):  # np.split takes longer, and each step asks
        end += size
        if size and not mask[..., end - size : end].any(-1).all():
            return entry
    return None
