"""A model's constructor takes the settings of an agent's parts as keyword arguments."""

import inspect
import math
from typing import Any

from galton.agents import words_of
from galton.algorithms import Agent, Algorithm
from galton.errors import did_you_mean, require_integer
from galton.models.hints import HINTS, unexpected
from galton.presets import PAPER, Preset
from galton.records import Fields
from galton.tasks import settings_of
from galton.words import from_sb3, idle, vocabulary, without_idle

Choice = type[Algorithm] | Algorithm
"""An algorithm of ALGORITHMS, or one whose numbers are its own."""
_FEW_STEPS = 5
"""Over fewer steps advantages are mostly the critic's opinion."""


def _word(algorithm: Choice) -> Any:
    return algorithm if isinstance(algorithm, Algorithm) else algorithm.name


def usual(algorithm: Choice, env: object = None, preset: Preset = Preset(PAPER)) -> Fields:  # noqa: B008
    """The settings that an algorithm knows, with the values that nobody has to name.

    A named task's go before the preset's, and the preset's before the algorithm's. The loss, the algorithm and n_envs
    have arguments of their own.
    """
    elsewhere = {"loss", "algorithm", "n_envs", *idle({"algorithm": _word(algorithm)}, ["algorithm"])}
    return {name: value for name, value in _usual(algorithm, env, preset).items() if name not in elsewhere}


def _usual(algorithm: Choice, env: object, preset: Preset) -> Fields:
    plain = vocabulary().usual | dict(algorithm.defaults)
    task = plain | settings_of(env) | dict(algorithm.defaults)
    own = {name for name in plain if task[name] != plain[name]}
    if "n_steps" in own:
        own.add("n_envs")  # the task's rollout is whole
    return task | {name: value for name, value in preset.settings.items() if name not in own}


def all_words(
    algorithm: Choice,
    preset: Preset,
    n_envs: int | None,
    settings: Fields,
    env: object = None,
    ready: int | None = None,
) -> Fields:
    """The settings as `agents.read` takes them; what is not among them is as `usual` has it.

    `ready` says how many environments were given ready-made, None where copies are made. TypeError for a name that is
    no setting of this algorithm, UsageError for a value out of range.
    """
    known = usual(algorithm, env, preset)
    for name in settings:
        if name not in known:
            known_ones = did_you_mean(name, known).lstrip("; ") or f"it takes {', '.join(known)}"
            raise unexpected(algorithm.label, name, "" if name in HINTS else known_ones)
    settings = from_sb3(settings)
    copies = _usual(algorithm, env, preset)["n_envs"]
    n_envs = (ready or copies) if n_envs is None else n_envs
    given = known | settings
    if n_envs != copies > 1 and "n_steps" not in settings:
        own = vars(algorithm) if isinstance(algorithm, Algorithm) else given
        given["n_steps"] = _as_long(copies * known["n_steps"], n_envs, own.get("batch_size", 1))
    given |= {"loss": preset.loss, "n_envs": n_envs, "algorithm": _word(algorithm)}
    usual_ones = {name: value for name, value in known.items() if name not in settings}
    return without_idle(given, usual_ones)


def told_of_few_steps(words: Fields, settings: Fields, known: Fields) -> str:
    """Say that so many environments leave a rollout hardly a step, where nobody said how many; "" where it has some."""
    if "n_steps" in settings or words["n_steps"] >= min(_FEW_STEPS, known["n_steps"]):
        return ""
    told = f"n_envs is {words['n_envs']:,}, and a rollout stays as long as it was, so n_steps is {words['n_steps']}"
    return f"{told}; give n_steps too, and a batch_size that suits it"


def _as_long(rollout: int, n_envs: Any, batch_size: Any) -> int:
    """The steps of each environment that make a rollout of that length or a little more, in whole minibatches."""
    require_integer("n_envs", n_envs, 1)
    require_integer("batch_size", batch_size, 1)
    unit = batch_size // math.gcd(n_envs, batch_size)
    return unit * math.ceil(rollout / (n_envs * unit))


def unusual(agent: Agent) -> Fields:
    """The settings of an agent that are not its algorithm's usual ones."""
    own, known = words_of(agent), usual(agent.algorithm)
    return {name: own[name] for name, value in known.items() if name in own and own[name] != value}


def signature(algorithm: type[Algorithm]) -> inspect.Signature:
    """The signature that help() and editors show of a model's constructor: every setting with its default."""
    parameter, keyword = inspect.Parameter, inspect.Parameter.KEYWORD_ONLY
    return inspect.Signature(
        [
            parameter("env", parameter.POSITIONAL_OR_KEYWORD),
            parameter("loss", parameter.POSITIONAL_OR_KEYWORD, default=None),
            parameter("preset", keyword, default=None),
            *(parameter(name, keyword, default=value) for name, value in usual(algorithm).items()),
            parameter("n_envs", keyword, default=None),
            parameter("seed", keyword, default=0),
            parameter("env_kwargs", keyword, default=None),
            parameter("verbose", keyword, default=0),
        ]
    )
