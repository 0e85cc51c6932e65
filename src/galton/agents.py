"""Agents of flat words, and the words of agents."""

from collections.abc import Mapping
from typing import Any

from galton import schedules
from galton.algorithms import Agent, Rollout
from galton.algorithms.base import name_of
from galton.errors import require
from galton.parts import Part, Schedule, settings, unusual
from galton.policies import POLICIES
from galton.records import FIRST_FIELDS, Fields
from galton.words import CHOICES, Words, chosen, from_sb3, idle, refuse_idle, usual_of, values_of, vocabulary


def make_agent(**words: Any) -> Agent:
    """The agent of these settings, in flat words; what they leave out has the usual value of its algorithm.

    Args:
        words: the settings of all parts by name, such as n_bins=50 or eta=2.0, and the words that choose parts: loss,
            policy, critic, algorithm, weighting, entropy_target, network and optimizer, each a name or a part itself.
            A number may be an array `[R]`, one for each of R runs. What SB3 writes otherwise is understood: a number as
            a linear function of what remains of training, target_kl=None, net_arch={"pi": [...], "vf": [...]}.

    Raises:
        UsageError: an unknown name, a value out of range, parts that don't fit together, or a setting that none of the
            parts has.
    """
    words = from_sb3(words)
    usual = usual_of(words.get("algorithm", CHOICES["algorithm"].usual))
    others = idle(words).union(*(settings(type(part)) for part in words.values() if isinstance(part, Part)))
    return read({name: value for name, value in usual.items() if name not in others} | words)


def read(words: Words) -> Agent:
    """The agent of these words, with each part's own default for what they leave out; UsageError as `make_agent`."""
    return Agent(**parts_of(words))


def parts_of(words: Words) -> dict[str, Any]:
    """The parts of these words, by the agent's fields, whether or not they fit together; UsageError as `make_agent`."""
    given = values_of(words)
    found: dict[str, Any] = chosen(given) | {"rollout": Rollout}
    refuse_idle(given)
    _refuse_beside_parts(found, given)
    return {
        field: part if isinstance(part, Part) else part(**{n: given[n] for n in settings(part) if n in given})
        for field, part in found.items()
    }


def _refuse_beside_parts(found: Mapping[str, Any], words: Words) -> None:
    """Raise UsageError for a setting that is given beside the only part that has it."""
    of_kinds = {name for part in found.values() if not isinstance(part, Part) for name in settings(part)}
    for part in (part for part in found.values() if isinstance(part, Part)):
        for name in (settings(type(part)).keys() & words.keys()) - of_kinds:
            other = unusual(words[name], vocabulary().usual[name])
            require(not other, f"{name} is {other} beside {part!r}; give it to the part")


def words_of(agent: Agent) -> Fields:
    """The words of an agent; one with a part that has no name in its registry has the part itself as the word."""
    found: Fields = {name: getattr(agent.rollout, name) for name in settings(type(agent.rollout))}
    for field, (word, registry, *_) in CHOICES.items():
        part = agent.policy.head if field == "policy" else getattr(agent, field)
        names = [name for name, kind in registry.items() if kind is type(part)]
        found[word] = names[0] if names else part
        found |= {name: getattr(part, name) for name in settings(type(part))} if names else {}
    if found["policy"] == agent.loss.policy:
        found["policy"] = "auto"
    known = vocabulary()
    usual = known.usual  # of numbers that no run changes
    absent = {name: usual[name] for name, value in found.items() if value is None and known.is_number(name)}
    return {name: (found | absent)[name] for name in known.usual if name in found}


def policy_name(agent: Agent) -> str:
    """The key in POLICIES of an agent's policy; the name of its class where it is not there."""
    return name_of(agent.policy.head, POLICIES)


def written(words: Words) -> Fields:
    """The words to write down, those of version 1 and later unusual ones; UsageError for a part without a name."""
    for name, value in words.items():
        told = f"{name} is {value!r}, and files hold names; give its class a line in the registry of its kind"
        require(not isinstance(value, Part) or type(value) in schedules.SCHEDULES.values(), told)
    usual = vocabulary().usual
    return {
        name: words.get(name, value)
        for name, value in usual.items()
        if name in FIRST_FIELDS or (name in words and words[name] != value)
    }


def in_two(words: Words) -> dict[str, Fields]:
    """The words as JSON has them: those that change shapes or code under `config`, and numbers under `hypers`."""
    known = vocabulary()
    config = {name: value for name, value in words.items() if not known.is_number(name)}
    return {
        "config": {name: list(value) if isinstance(value, tuple) else value for name, value in config.items()},
        "hypers": {name: _number(value) for name, value in words.items() if name not in config},
    }


def _number(value: Any) -> float | str:
    if isinstance(value, Schedule):
        return schedules.told(value)
    return value if isinstance(value, str) else float(value)
