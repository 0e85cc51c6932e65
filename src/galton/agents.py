"""Agents by their flat words: settings by name, as arguments, command lines and files have them, read into parts.

Every name belongs to the parts that have a setting of that name. Which parts there are, some of the words say: `loss`,
`policy`, `critic`, `algorithm`, `weighting`, `entropy_target`.
"""

from collections.abc import Collection, Mapping
from typing import Any

from galton.algorithms import ALGORITHMS, CREDITS, ENTROPIES, Agent, Rollout, find_algorithm
from galton.critics import CRITICS, find_critic
from galton.errors import UsageError, require, require_word, unknown
from galton.losses import LOSSES, find_loss
from galton.networks import MLP
from galton.optimizers import Adam
from galton.parts import Part, settings, unusual
from galton.policies import POLICIES
from galton.records import defaults
from galton.types import Config, Hypers

Words = Mapping[str, Any]
"""Settings by name; those that are left out have their usual values."""
Kinds = dict[str, type[Part]]
"""The class of each part of an agent, by the agent's field."""

REGISTRIES: dict[str, tuple[str, Mapping[Any, type[Part]]]] = {
    "policy": ("policy", POLICIES),
    "loss": ("loss", LOSSES),
    "critic": ("critic", CRITICS),
    "algorithm": ("algorithm", ALGORITHMS),
    "credit": ("weighting", CREDITS),
    "entropy": ("entropy_target", ENTROPIES),
}
"""The parts that a word chooses, by the agent's field: the word, and what there is to choose from."""

CHOOSING = [word for word, _ in REGISTRIES.values()]
"""The words that choose a part."""

ONLY: Kinds = {"network": MLP, "optimizer": Adam, "rollout": Rollout}
"""The parts that there is one kind of."""

USUAL: dict[str, Any] = {**defaults(Config), **defaults(Hypers)}
"""The value of each word that nobody says."""

MAY_IDLE = ("eta", "n_bins", "exploration", "bin_sample", "deterministic_action", "box_units")
"""Files may have these settings although nothing uses them: they were set for several losses and policies at once."""


def flat(config: Config, hypers: Hypers) -> dict[str, Any]:
    """The words of these records."""
    return {name: getattr(config, name) for name in defaults(Config)} | hypers._asdict()


def agent_of(config: Config, hypers: Hypers) -> Agent:
    """The agent of these records; its numbers are those of the hypers, one for each or `[R]`.

    Raises:
        UsageError: as `read`.
    """
    return read(flat(config, hypers))


def read(words: Words) -> Agent:
    """The agent of these words; what they leave out has its usual value.

    Raises:
        UsageError: an unknown name, a value out of range, parts that don't fit together, or a setting that none of the
            parts has.
    """
    return Agent(**parts_of(words))


def parts_of(words: Words) -> dict[str, Any]:
    """The parts of these words, by the agent's fields, of which nobody has said whether they fit together.

    Raises:
        UsageError: as `read`, but for parts that don't fit together.
    """
    chosen = kinds(words)
    for name in sorted(words.keys() - USUAL.keys() - owned()):
        raise UsageError(f"{name!r} is no setting; choose from {', '.join(sorted(owned()))}")
    check_choices(words)
    refuse_idle(words)
    return {
        field: kind(**{name: words.get(name, USUAL.get(name, getattr(kind, name, None))) for name in settings(kind)})
        for field, kind in chosen.items()
    }


def kinds(words: Words) -> Kinds:
    """The class of each part that these words choose, whether they fit together or not.

    Raises:
        UsageError: an unknown name.
    """
    said = USUAL | dict(words) | {"policy": policy_name(words)}
    find_loss(said["loss"])
    find_algorithm(said["algorithm"])
    find_critic(said["critic"])
    require_word("weighting", said["weighting"], tuple(CREDITS))
    return {field: registry[said[word]] for field, (word, registry) in REGISTRIES.items()} | ONLY


def check_choices(words: Words) -> None:
    """Raise UsageError for a policy that the loss does not fit, or for what the algorithm does not carry out."""
    said = USUAL | dict(words) | {"policy": policy_name(words)}
    loss, algorithm = find_loss(said["loss"]), find_algorithm(said["algorithm"])
    fitting = [known for known, policy in POLICIES.items() if loss.family in ("density", policy.family)]
    require(
        said["policy"] in fitting,
        f"policy is {said['policy']!r}, but the loss {said['loss']!r} needs a {loss.family}; choose from "
        f"{', '.join(fitting)}",
    )
    for choice in ("negative_target", "weighting", "entropy_target"):
        require(
            said[choice] == USUAL[choice] or choice in algorithm.choices,
            f"{choice} is {said[choice]!r}, which algorithm {said['algorithm']!r} does not carry out; leave it at "
            f"{USUAL[choice]!r}",
        )
    require(
        said["negative_target"] == "same" or CREDITS[said["weighting"]].is_signed,
        f"negative_target is {said['negative_target']!r}, but with weighting {said['weighting']!r} no weight is "
        "negative; choose one of the two",
    )


def policy_name(words: Words) -> str:
    """The key in POLICIES of the policy that these words choose; UsageError lists the names if there is none."""
    name = words.get("policy", "auto")
    name = find_loss(words.get("loss", USUAL["loss"])).policy if name == "auto" else name
    if name not in POLICIES:
        raise unknown("policy", name, ("auto", *POLICIES))
    return str(name)


def policy_of(config: Config) -> str:
    """The key in POLICIES of a configuration's policy."""
    return policy_name({"loss": config.loss, "policy": config.policy})


def idle(words: Words, fields: Collection[str] = tuple(REGISTRIES)) -> set[str]:
    """The settings that some part has, and none of those that these words choose.

    Args:
        words: of which only those count that choose a part.
        fields: the parts that the words choose; of the others each may be there.

    Returns:
        nothing for a policy that nobody has registered here, of which nothing is known.
    """
    if words.get("policy", "auto") not in ("auto", *POLICIES):
        return set()
    chosen = kinds({name: value for name, value in words.items() if name in CHOOSING})
    there = {name for kind in ONLY.values() for name in settings(kind)}
    for field, (_, registry) in REGISTRIES.items():
        for kind in [chosen[field]] if field in fields else registry.values():
            there |= settings(kind).keys()
    return owned() - there


def owned() -> set[str]:
    """The settings that some part has."""
    of_choices = (kind for _, registry in REGISTRIES.values() for kind in registry.values())
    return {name for kind in (*of_choices, *ONLY.values()) for name in settings(kind)}


def refuse_idle(words: Words) -> None:
    """Raise UsageError where a setting is not at its usual value that none of the parts has."""
    for name in sorted(idle(words) & words.keys()):
        if not may_idle(name, words[name]) and (other := unusual(words[name], USUAL[name])):
            raise UsageError(f"{name} is {other}; it {_whose(name, words)}")


def _whose(name: str, words: Words) -> str:
    """Which parts have a setting, and which are there instead."""
    owners: list[str] = []
    instead: list[str] = []
    said = USUAL | dict(words) | {"policy": policy_name(words)}
    for word, registry in REGISTRIES.values():
        having = [repr(key) for key, kind in registry.items() if name in settings(kind)]
        if having:
            owners.append(f"{word} {', '.join(having)}")
            instead.append(repr(said[word]) if not instead else f"{word} {said[word]!r}")
    return f"goes with {' or '.join(owners)}, not {' and '.join(instead)}"


def may_idle(name: str, value: object) -> bool:
    """Say whether a setting may have this value although nothing uses it."""
    return name in MAY_IDLE or (name, value) == ("initial_policy", "gaussian")
