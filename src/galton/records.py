"""Records that grow: a part may get a setting without renaming any point of a sweep or refusing a file.

What is written, hashed and compared is made of the settings of version 1 and of those later ones that differ from
their usual values (`agents.written`). So a point keeps its name, and with it its seeds and files, however many settings
are added; and a reader fills in what it does not find. Two rules follow: the default of a setting that was added later
never changes, and neither do the settings of version 1.
"""

from collections.abc import Collection
from typing import Any

from galton.errors import NewerVersionError

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
