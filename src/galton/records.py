"""Records that grow: a part may get a setting without renaming any point of a sweep or refusing a file.

What is written, hashed and compared is made of the settings of version 1 and of those later ones that differ from
their usual values (`agents.written`). So a point keeps its name, and with it its seeds and files, however many settings
are added; and a reader fills in what it does not find. Two rules follow: the default of a setting that was added later
never changes, and neither do the settings of version 1.
"""

import dataclasses
import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from galton.errors import NewerVersionError, require

Fields = dict[str, Any]
"""Fields of a record by name; each has the type that the record declares."""

FIRST_FIELDS = (
    *("loss", "n_bins", "n_steps", "n_envs", "net_arch", "initial_policy", "exploration", "bin_sample"),
    *("deterministic_action", "normalize_advantage", "normalize_observation", "normalize_reward"),
    *("learning_rate", "eta", "gamma", "gae_lambda", "vf_coef", "ent_coef", "max_grad_norm"),
)
"""The settings that version 0.1.0 wrote, all of them always, in its order."""


def refuse_unknown(what: str, names: Collection[str], known: Collection[str]) -> None:
    """Raise NewerVersionError for names that this version does not know, which a newer one may have added."""
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise NewerVersionError(
            f"{what} has {', '.join(unknown)}, which this version of Galton does not know: a newer one wrote it, or a "
            "part of your own has it; update Galton to read it, or import the module where the part is registered"
        )


def filled(rows: Collection[Mapping[str, object]], default: Mapping[str, object]) -> list[dict[str, object]]:
    """The same rows with the same fields each, in one order: what a row leaves out has its default."""
    names = dict.fromkeys(name for row in rows for name in row)
    for name in names:
        require(name in default or all(name in row for row in rows), f"{name} is missing and has no default")
    return [{name: row[name] if name in row else default[name] for name in names} for row in rows]


def plain(value: Any) -> Any:
    """Records as dictionaries, arrays as lists, and None for numbers that are not finite."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, Mapping):
        return {str(name): plain(of) for name, of in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
