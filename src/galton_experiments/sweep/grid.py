"""Grids: products of values, and those with a name."""

import itertools
import math
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from galton.errors import UsageError, did_you_mean, is_number, require, require_integer
from galton.losses import LOSSES
from galton.parts import settings
from galton.records import Fields
from galton.saving import files
from galton.tasks import settings_of, task_of
from galton.words import CHOICES, idle, may_idle, values_of
from galton_experiments.sweep.study import Setting

MOST_SETTINGS = 100_000
"""The most points that a block of a grid may have, or settings that are drawn of a loss; ten short lists make more."""


def expand(blocks: Iterable[Mapping[str, object]], base: Mapping[str, object]) -> tuple[Setting, ...]:
    """Each block's product: a list is an axis (net_arch's, a list of lists, as others' whose value is one).

    Args:
        blocks: settings by name.
        base: for the fields that a block doesn't name, as `bases` has it.

    Raises:
        UsageError: an unknown field, a value out of range, or more than MOST_SETTINGS points.
    """
    points: list[Fields] = []
    for block in blocks:
        axes = {name: _axis(name, value) for name, value in block.items()}
        n = math.prod(map(len, axes.values()))
        require(
            n <= MOST_SETTINGS, f"{', '.join(axes)} have {n:,} combinations; give lists with {MOST_SETTINGS:,} at most"
        )
        points += [dict(zip(axes, point, strict=True)) for point in itertools.product(*axes.values())]
    found: dict[Setting, None] = {}
    for point, unused in zip(points, _unused(points, [base] * len(points)), strict=True):
        same = {name for name in unused & {*point} if may_idle(name, point[name])}  # other values make no other agent
        own = {name: value for name, value in point.items() if name not in same}
        found[Setting(_base(base, point, unused) | own)] = None
    return tuple(found)


def bases(points: Sequence[Mapping[str, object]], given: Sequence[Mapping[str, object]]) -> Iterator[Fields]:
    """The base given for each point, without what its loss and policy have no use for where those of another have one.

    What none of them has a use for stays, to be refused by name.
    """
    return map(_base, given, points, _unused(points, given))


def _base(base: Mapping[str, object], point: Mapping[str, object], unused: Collection[str]) -> Fields:
    """The base without what a point does not use; a rate that is a schedule has no other decay."""
    own = {*unused, *(["decay_steps"] if isinstance(point.get("learning_rate"), str) else [])}
    return {name: value for name, value in base.items() if name not in own or may_idle(name, value)}


def _unused(points: Sequence[Mapping[str, object]], given: Sequence[Mapping[str, object]]) -> list[set[str]]:
    """For each point what its loss and policy have no use for, and those of another have one."""
    whole = [{**base, **point} for base, point in zip(given, points, strict=True)]
    usual = {word: CHOICES[word].usual for word in ("loss", "policy")}
    choices = [tuple(values_of({word: fields.get(word, usual[word]) for word in usual}).values()) for fields in whole]
    unused = {choice: idle(dict(zip(("loss", "policy"), choice, strict=True))) for choice in dict.fromkeys(choices)}
    nobodys = set.intersection(*unused.values()) if unused else set()
    return [unused[choice] - nobodys for choice in choices]


def _axis(name: str, value: object) -> Sequence[object]:
    if not isinstance(value, list | tuple):
        return [value]
    if name in ("net_arch", "critic_arch", "ordered", "per_entry"):
        return value if value and isinstance(value[0], list | tuple) else [value]
    require(len(value) > 0, f"{name} is an empty list; give at least one value")
    return value


def task_defaults(env: str) -> dict[str, object]:
    """The settings of App. C.2 for a task, to put a grid upon."""
    return settings_of(env)


def paper_blocks(rates: Sequence[float], bins: Sequence[int], etas: Sequence[float]) -> list[dict[str, object]]:
    """App. C.2's grid with these values: rates for all three losses, bins for both classifications, η for HL-Gauss."""
    return [
        {"loss": "gaussian", "learning_rate": rates},
        {"loss": "hl-one-hot", "learning_rate": rates, "n_bins": bins},
        {"loss": "hl-gauss", "learning_rate": rates, "n_bins": bins, "eta": etas},
    ]


def paper_grid(env: str, base: Mapping[str, object]) -> tuple[Setting, ...]:
    """The grid of App. C.2: 88 settings, 76 on the bandit."""
    task = task_of(env)
    return expand(paper_blocks(task.learning_rates, [50, 100, 200], task.etas), base)


def random_grid(base: Mapping[str, Any], n: int = 16, seed: int = 0) -> tuple[Setting, ...]:
    """N settings of each loss, drawn around the base's learning rate.

    Log-uniform: the learning rate within a factor of 10 of the base's, η from 0.1 to 4; n_bins is 50, 100 or 200. A
    longer draw begins with a shorter one.
    """
    require_integer("n_settings", n, 1)
    require(n <= MOST_SETTINGS, f"n_settings is {n}; it must be at most {MOST_SETTINGS:,}")
    usual = base["learning_rate"]
    told = f"learning_rate is {usual}, a schedule, around which no rate can be drawn; give a number, or another grid"
    require(is_number(usual), told)
    found: list[dict[str, object]] = []
    for name, loss in LOSSES.items():
        draw = np.random.default_rng((seed, *name.encode()))
        for _ in range(n):
            rate = usual * 10 ** draw.uniform(-1, 1)
            bins, eta = int(draw.choice([50, 100, 200])), math.exp(draw.uniform(math.log(0.1), math.log(4)))
            found.append({"loss": name, "learning_rate": float(f"{rate:.3g}")})
            if loss.family == "histogram":
                found[-1]["n_bins"] = bins
            if "eta" in settings(loss):
                found[-1]["eta"] = float(f"{eta:.3g}")
    return expand(found, base)


def read_grid(path: Path, base: Mapping[str, object]) -> tuple[Setting, ...]:
    """The settings of a TOML file: `[[grid]]` tables as for `expand`.

    Raises:
        UsageError: no such file, no TOML, no grid in it, an unknown field, a value out of range.
    """
    try:
        record = tomllib.loads(files.read(path, files.TEXT).decode())
    except (OSError, ValueError, RecursionError) as error:
        meant = did_you_mean(path, GRIDS)
        raise UsageError(f"grid is {str(path)!r}, which can't be read as TOML: {error}{meant}") from None
    blocks = record.get("grid")
    right = set(record) == {"grid"} and isinstance(blocks, list) and all(isinstance(b, dict) for b in blocks)
    require(right and bool(blocks), f"grid is {str(path)!r}; it must hold one or more [[grid]] tables and nothing else")
    algorithm = base.get("algorithm", CHOICES["algorithm"].usual)
    try:
        for block in blocks:  # type: ignore[union-attr]
            others = [name for name in _axis("algorithm", block.get("algorithm", algorithm)) if name != algorithm]
            told = f"algorithm is {others}, and the base's settings are of {algorithm!r}; give each a sweep of its own"
            require(not others, told)
        return expand(blocks, base)  # type: ignore[arg-type]
    except (TypeError, UsageError) as error:
        raise UsageError(f"grid is {str(path)!r}: {error}") from None


GRIDS: dict[str, Callable[[str, Mapping[str, object], int], tuple[Setting, ...]]] = {
    "paper": lambda env, base, _: paper_grid(env, base),
    "random": lambda _, base, n: random_grid(base, n),
}
"""The grids with a name: (environment, fields that all settings share unless the grid says otherwise, settings per loss
where the grid leaves that open) → settings."""


def find_grid(name: str, env: str, base: Mapping[str, object] | None = None, n: int = 16) -> tuple[Setting, ...]:
    """A name in GRIDS, or a TOML file; the base is by default the task's."""
    base = task_defaults(env) if base is None else base
    return GRIDS[name](env, base, n) if name in GRIDS else read_grid(Path(name), base)
