"""Every method draws common numbers from one Latin hypercube, and its own from a second one beside it."""

import functools
from collections.abc import Collection

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from galton.errors import UsageError
from galton.records import Fields
from galton.words import usual_of
from galton_experiments.benchmark.priors import Priors
from galton_experiments.benchmark.protocol import Method, Protocol, Task
from galton_experiments.sweep.grid import task_defaults
from galton_experiments.sweep.study import Setting

Quantiles = dict[str, Float[np.ndarray, " n"]]
"""The quantile of each draw in a field's prior, by field; each n-th of a prior has one."""
CANDIDATES = 200
"""Hypercubes of which a method's own is chosen."""
Draws = dict[str, list[Fields]]
"""The values of the drawn fields, by method and draw; those that count in lengths of a run are multiples of it."""


def draws(protocol: Protocol) -> Draws:
    """Return the draws of every method: the same quantiles of the common fields for all, and as many draws for each.

    The first draws are the file's anchors. What an anchor does not name is fixed, or has its usual value.
    The order of fields and methods in the file has no part in it, and no method in another's draws. Methods whose own
    fields have the same names have the same quantiles of these too.
    """
    n, common = _n_random(protocol), _common(protocol)
    found: Draws = {}
    for method in protocol.methods:
        quantiles = common | _own(protocol, method, common)
        searched = protocol.searched(method)
        found[method.name] = [
            {name: fields[name].values[0] for name in sorted(fields)} for fields in protocol.anchored(method)
        ] + [{name: searched[name].at(float(quantiles[name][i])) for name in sorted(searched)} for i in range(n)]
    return found


def setting(protocol: Protocol, method: Method, drawn: Fields, task: Task, fresh: bool) -> Setting:
    """The setting that a draw of a method is on a task.

    What neither file nor draw names is the task's and the algorithm's usual value, as under the preset "paper".

    Raises:
        UsageError: values that are out of range or don't go together; the message names method and task.
    """
    steps = task.steps(fresh)
    fixed: dict[str, object] = {}
    for table in (protocol.fixed, method.fixed, task.fixed):
        fixed |= _times(table, {name: prior.values[0] for name, prior in table.items()}, steps)
    usual = usual_of(protocol.algorithm(method))
    try:
        scaled = {name: value * task.scale[name] if name in task.scale else value for name, value in drawn.items()}
        fields = task_defaults(task.env) | usual | fixed | _times(protocol.searched(method), scaled, steps)
        return Setting(fields)
    except (TypeError, OverflowError, UsageError) as error:
        raise UsageError(f"methods.{method.name} on tasks.{task.name}: {error}") from None


def _n_random(protocol: Protocol) -> int:
    """Count the draws of each method that are no anchors."""
    return protocol.budget.settings - len(protocol.anchors)


def _common(protocol: Protocol) -> Quantiles:
    """Those of the common fields, from one hypercube."""
    columns = sorted(protocol.prior)
    if not columns:
        return {}
    return dict(
        zip(columns, _spread(_seed(protocol, "prior", columns), len(columns), _n_random(protocol)), strict=True)
    )


@functools.lru_cache(maxsize=8)  # it takes a second
def _spread(seed: tuple[int, ...], n_fields: int, n: int) -> Float[np.ndarray, "fields n"]:
    """A Latin hypercube whose points scipy has spread evenly over all fields at once."""
    cube = qmc.LatinHypercube(n_fields, seed=np.random.default_rng(seed), optimization="random-cd")
    return cube.random(n).T


def _own(protocol: Protocol, method: Method, common: Quantiles) -> Quantiles:
    """Those of a method's own fields: the Latin hypercube, of CANDIDATES, that is the least correlated with the others.

    With a dozen draws a hypercube by chance would have η rise with the learning rate, and nobody could tell them apart.
    """
    columns = sorted(method.search)
    if not columns:
        return {}
    rng = np.random.default_rng(_seed(protocol, "search", columns))
    cube = qmc.LatinHypercube(len(columns), seed=rng)
    n = _n_random(protocol)
    beside = np.array([*common.values()]).reshape(len(common), n)
    candidates = [np.asarray(cube.random(n).T) for _ in range(CANDIDATES)]
    found = candidates[int(np.argmin([_correlation(own, beside) for own in candidates]))]
    return dict(zip(columns, found, strict=True))


def _correlation(own: Float[np.ndarray, "own n"], beside: Float[np.ndarray, "others n"]) -> float:
    """The largest correlation, either way, of a field with another; 0 for one draw, which has none."""
    if own.shape[1] < 2:
        return 0.0
    found = np.corrcoef(np.vstack([own, beside]) if len(beside) else own).reshape(len(own) + len(beside), -1)
    return float(np.abs(np.triu(found, 1)[: len(own)]).max())


def _seed(protocol: Protocol, table: str, columns: Collection[str]) -> tuple[int, ...]:
    return protocol.seed, *" ".join([table, *columns]).encode()


def _times(priors: Priors, values: Fields, steps: int) -> Fields:
    """The values, those that count in lengths of a run in environment steps."""
    counted = {name for name, prior in priors.items() if prior.in_steps}
    return {name: value * steps if name in counted else value for name, value in values.items()}
