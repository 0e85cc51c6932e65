"""The flat words of agents: settings by name, as arguments, command lines and files have them.

Every name belongs to the parts that have a setting of that name. Which parts there are, some of the words say: `loss`,
`policy`, `critic`, `algorithm` and the other words of CHOICES.
"""

import functools
import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

from galton import schedules
from galton.algorithms import ALGORITHMS, CREDITS, ENTROPIES, Agent, Algorithm, Rollout, find_algorithm
from galton.critics import CRITICS
from galton.errors import UsageError, did_you_mean, require, unknown
from galton.fields import annotations, checked
from galton.losses import LOSSES
from galton.networks import NETWORKS
from galton.optimizers import OPTIMIZERS
from galton.parts import Part, Schedule, is_number, settings, unusual
from galton.policies import POLICIES
from galton.policies.per_entry import spread
from galton.records import FIRST_FIELDS, Fields

Words = Mapping[str, Any]
"""Settings by name; those that are left out have their usual values."""


class Choice(NamedTuple):
    """A word that chooses a part."""

    word: str
    registry: Mapping[Any, type[Part]]
    """The classes to choose from, by name."""
    usual: Any
    """The value that nobody has to say."""
    meaning: str
    """The sentence that help says of it."""


CHOICES: dict[str, Choice] = {
    "loss": Choice("loss", LOSSES, "hl-gauss", "What is minimised, weighted by the advantage."),
    "policy": Choice(
        "policy",
        POLICIES,
        "auto",
        "The distribution of actions; auto is the one that the loss usually trains.",
    ),
    "critic": Choice("critic", CRITICS, "squared-error", "How values are learnt."),
    "algorithm": Choice("algorithm", ALGORITHMS, "a2c", "What is done with a rollout."),
    "credit": Choice(
        "weighting",
        CREDITS,
        "advantage",
        "What multiplies the loss: the advantage A, or a positive weight, AWR's exp(A / temperature), at "
        "most 20, or V-MPO's softmax of A / temperature over the better half of the batch, times its size.",
    ),
    "entropy": Choice(
        "entropy_target",
        ENTROPIES,
        False,
        "Hold the policy's entropy: a bonus of weight α · std(A) joins the fixed one, and α, of either "
        "sign, follows a target of the entropy, which goes from entropy_start to entropy_end.",
    ),
    "network": Choice("network", NETWORKS, "mlp", "The network of the actor, and that of the critic."),
    "optimizer": Choice("optimizer", OPTIMIZERS, "adam", "How a gradient moves parameters."),
}
"""The words that choose a part, by the agent's field."""

CHOOSING = [choice.word for choice in CHOICES.values()]
"""The words that choose a part."""

MAY_IDLE = ("eta", "n_bins", "exploration", "bin_sample", "deterministic_action", "box_units")
"""Files may have these settings although nothing uses them: they were set for several losses and policies at once."""


class Vocabulary(NamedTuple):
    """All words that somebody understands."""

    usual: Fields
    """The value of each that nobody has to say, in the order in which files have them."""
    annotations: dict[str, Any]
    """Each setting's annotation, by which its values are checked."""

    def is_number(self, word: str) -> bool:
        """Say whether a word is a number, which programs take as data."""
        return is_number(self.annotations.get(word))


def vocabulary() -> Vocabulary:
    """All words and settings that are registered by now; UsageError where parts differ in a default of one name."""
    return _vocabulary((*(kind for choice in CHOICES.values() for kind in choice.registry.values()), Rollout))


@functools.cache
def _vocabulary(kinds: tuple[type[Part], ...]) -> Vocabulary:
    usual: Fields = {choice.word: choice.usual for choice in CHOICES.values()}
    annotations: dict[str, Any] = {}
    for kind in kinds:
        for name, annotation in settings(kind).items():
            where = f"{kind.__name__}.{name}"
            require(hasattr(kind, name), f"{where} has no default; give it one, for an agent that is made by words")
            default = getattr(kind, name)
            same = name not in usual or bool(usual[name] == default)
            require(same, f"{where} is {default!r} by default, and {usual.get(name)!r} elsewhere; give it another name")
            usual.setdefault(name, default)
            annotations.setdefault(name, annotation)
    first = {name: i for i, name in enumerate(FIRST_FIELDS)}
    ordered = sorted(usual, key=lambda name: (is_number(annotations.get(name)), first.get(name, len(first))))
    return Vocabulary({name: usual[name] for name in ordered}, annotations)


def usual_of(algorithm: Any) -> Fields:
    """The settings whose usual value is another one under this algorithm; UsageError lists the names for none such."""
    return dict(algorithm.defaults if isinstance(algorithm, Algorithm) else find_algorithm(algorithm).defaults)


def from_sb3(words: Words) -> Fields:
    """The words, where some may be written as SB3 has them or by entry; UsageError for what can't be understood.

    That is a linear function of what remains of training in the place of a number, target_kl=None,
    clip_range_vf=None and net_arch={"pi": [...], "vf": [...]}.
    """
    known, net_arch, words = vocabulary(), words.get("net_arch"), spread(words)
    found = {name: schedules.of_remaining(name, v) if known.is_number(name) else v for name, v in words.items()}
    found |= {name: math.inf for name in ("target_kl", "clip_range_vf") if name in found and found[name] is None}
    if isinstance(ordered := found.get("ordered"), tuple | list):  # places may be numbers
        found["ordered"] = tuple(str(one) if isinstance(one, int) else one for one in ordered)
    if isinstance(net_arch, Mapping):
        both = set(net_arch) == {"pi", "vf"}
        require(both, f"net_arch is {net_arch!r}; give one list for both networks, or a list for each of pi and vf")
        found |= {"net_arch": net_arch["pi"], "critic_arch": net_arch["vf"]}
    return found


def values_of(words: Words) -> Fields:
    """The words with values as their annotations have them; UsageError for an unknown word or a value out of range."""
    known = vocabulary()
    for name in words:
        if name not in known.usual:
            told = did_you_mean(name, known.usual) or f"; choose from {', '.join(sorted(known.usual))}"
            raise UsageError(f"{name!r} is no setting{told}")
    return {name: _value(known, name, value) for name, value in words.items()}


def _value(known: Vocabulary, name: str, value: Any) -> Any:
    """A word's value as its annotation has it; a text in the place of a number is a schedule."""
    if known.is_number(name) and isinstance(value, str | Schedule):
        return schedules.read(name, value) if isinstance(value, str) else value
    return checked(name, value, known.annotations[name]) if name in known.annotations else _named(name, value)


def _named(word: str, value: Any) -> Any:
    """A word that chooses a part, whose name may be one that nobody has registered here; UsageError if it is none."""
    registry = next(choice.registry for choice in CHOICES.values() if choice.word == word)
    named = isinstance(value, str) and True not in registry
    return value if isinstance(value, Part) or named else _key(word, value, registry)


def chosen(words: Words) -> dict[str, Part | type[Part]]:
    """The part that each word is, or the class that it names."""
    found: dict[str, Any] = {}
    for field, (word, registry, usual, _) in CHOICES.items():
        name = words.get(word, usual)
        if word == "policy" and name == "auto":
            name = found["loss"].policy
        kind = annotations(Agent)[field]
        found[field] = checked(word, name, kind) if isinstance(name, Part) else registry[_key(word, name, registry)]
    return found


def _key(word: str, name: Any, registry: Mapping[Any, type[Part]]) -> Any:
    if True in registry:
        return checked(word, name, bool)
    if not isinstance(name, str) or name not in registry:
        raise unknown(word, name, ("auto", *registry) if word == "policy" else registry)
    return name


def idle(words: Words, fields: Collection[str] = tuple(CHOICES)) -> set[str]:
    """The settings that some part has, and none of those that these words choose; none for an unknown policy.

    Of parts that are not among `fields` each may be there.
    """
    policy = words.get("policy", "auto")
    if isinstance(policy, str) and policy not in ("auto", *POLICIES):
        return set()
    found = chosen({name: value for name, value in words.items() if name in CHOOSING})
    there = {*CHOOSING, *settings(Rollout)}
    for field, choice in CHOICES.items():
        for part in [found[field]] if field in fields else choice.registry.values():
            there |= settings(type(part) if isinstance(part, Part) else part).keys()
    return vocabulary().usual.keys() - there


def without_idle(words: Words, usual: Words) -> Fields:
    """The words without those that nobody has said and that go with other networks, critics and so on, or with no part.

    Those of other losses and policies stay. A part that is given has its own settings, and a learning rate that is a
    schedule has no other decay.

    Args:
        words: some of which are what a task or a preset has for everybody.
        usual: these; a word that has its value there was not said.
    """
    unused = idle(words, [field for field in CHOICES if field not in ("loss", "policy")])
    unused |= {name for part in words.values() if isinstance(part, Part) for name in settings(type(part))}
    if isinstance(words.get("learning_rate"), str | Schedule):
        unused.add("decay_steps")
    return {name: value for name, value in words.items() if name not in unused or value != usual.get(name)}


def refuse_idle(words: Words, named: Collection[str] = ()) -> None:
    """Raise UsageError where a setting is not at its usual value that none of the parts has.

    Those of MAY_IDLE may be, unless they are among those named.
    """
    usual = vocabulary().usual
    for name in sorted(idle(words) & words.keys()):
        idles = may_idle(name, words[name]) and name not in named
        if not idles and (other := unusual(words[name], usual[name])):
            raise UsageError(f"{name} is {other}; it {_whose(name, words)}")


def _whose(name: str, words: Words) -> str:
    """The parts that have a setting, and those that are there instead."""
    owners: list[str] = []
    instead: list[str] = []
    found = chosen(words)
    for field, (word, registry, usual, _) in CHOICES.items():
        having = [repr(key) for key, kind in registry.items() if name in settings(kind)]
        if having:
            owners.append(f"{word} {', '.join(having)}")
            there = found[field] if isinstance(found[field], type) else type(found[field])
            key = next((key for key, kind in registry.items() if kind is there), words.get(word, usual))
            instead.append(repr(key) if not instead else f"{word} {key!r}")
    return f"goes with {' or '.join(owners)}, not {' and '.join(instead)}"


def may_idle(name: str, value: object) -> bool:
    """Say whether a setting may have this value although nothing uses it."""
    return name in MAY_IDLE or (name, value) == ("initial_policy", "gaussian")
