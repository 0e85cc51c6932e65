"""Records that grow: a field may be added to Config or Hypers without renaming a setting or refusing a file.

What is written, hashed and compared is made of the fields of version 1 and of those later ones that differ from
their defaults. So a setting keeps its name, and with it its seeds and files, however many fields are added; and a
reader fills in what it does not find. Two rules follow: the default of a field that was added later never changes,
and neither do the version-1 fields.
"""

import dataclasses
import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from galton.errors import NewerVersionError, require

Fields = dict[str, Any]
"""Fields of a record by name; each has the type that the record declares."""

FIRST_FIELDS = frozenset(
    {
        *("loss", "n_bins", "n_steps", "n_envs", "net_arch", "initial_policy", "exploration", "bin_sample"),
        *("deterministic_action", "normalize_advantage", "normalize_observation", "normalize_reward"),
        *("learning_rate", "eta", "gamma", "gae_lambda", "vf_coef", "ent_coef", "max_grad_norm"),
    }
)
"""The fields of Config and Hypers that version 0.1.0 wrote, all of them always."""


def defaults(record: type) -> Fields:
    """The fields of a frozen dataclass or NamedTuple with their defaults, in order."""
    if dataclasses.is_dataclass(record):
        return {field.name: field.default for field in dataclasses.fields(record)}
    return dict(getattr(record, "_field_defaults"))  # noqa: B009


def written(record: object) -> Fields:
    """The fields to write down: those of version 1, and the later ones that differ from their defaults."""
    values = {name: (getattr(record, name), default) for name, default in defaults(type(record)).items()}
    return {name: value for name, (value, default) in values.items() if name in FIRST_FIELDS or value != default}


def refuse_unknown(what: str, names: Collection[str], known: Collection[str]) -> None:
    """Raise unless this version knows every name.

    Raises:
        NewerVersionError: a field that this version does not have, which a newer one may have added.
    """
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise NewerVersionError(
            f"{what} has {', '.join(unknown)}, which this version of Galton does not know: a newer one wrote it; "
            "update Galton to read it"
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
