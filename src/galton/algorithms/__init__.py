"""Learning algorithms by name, pure functions on pytrees, and what looks up the names in a configuration.

A new one is a record in a file and a line in ALGORITHMS; what every actor-critic does is in actor_critic.
"""

import numpy as np
from jaxtyping import Float

from galton.algorithms import a2c, credit, ppo
from galton.algorithms.base import Agent, Algorithm, Scalars
from galton.critics import CRITICS, find_critic
from galton.errors import UsageError, require, unknown
from galton.losses import find_loss
from galton.policies import POLICIES, USES
from galton.records import defaults
from galton.types import Config, Hypers

ALGORITHMS: dict[str, Algorithm] = {
    "a2c": a2c.ALGORITHM,
    "ppo": ppo.ALGORITHM,
}

__all__ = [
    "ALGORITHMS",
    "Agent",
    "Algorithm",
    "Scalars",
    "check_choices",
    "check_together",
    "find_algorithm",
    "idle",
    "may_idle",
    "policy_of",
    "refuse_idle",
    "refuse_others",
    "resolve",
]


def resolve(config: Config, low: Float[np.ndarray, " d"], high: Float[np.ndarray, " d"]) -> Agent:
    """Look up what a configuration names, once and for all.

    Raises:
        UsageError: an unknown name, choices that don't fit together, or a setting that its algorithm can't use.
    """
    check_choices(config)
    loss, algorithm, critic = find_loss(config.loss), find_algorithm(config.algorithm), find_critic(config.critic)
    box = (tuple(float(x) for x in np.asarray(bound, np.float32)) for bound in (low, high))
    return Agent(config, loss, POLICIES[policy_of(config)].create, critic.create, algorithm, *box)


def check_choices(config: Config) -> None:
    """Raise UsageError for a configuration that can't be trained in any box, as `resolve` does."""
    loss, algorithm, name = find_loss(config.loss), find_algorithm(config.algorithm), policy_of(config)
    fitting = [known for known, policy in POLICIES.items() if loss.family in ("density", policy.family)]
    require(
        name in fitting,
        f"policy is {name!r}, but the loss {config.loss!r} needs a {loss.family}; choose from {', '.join(fitting)}",
    )
    find_critic(config.critic)
    refuse_others(config, config)
    refuse_idle(config, config)
    credit.check(config, loss, algorithm)
    algorithm.check(config)


def policy_of(config: Config) -> str:
    """The key in POLICIES of a configuration's policy; UsageError lists the names if there is none."""
    name = find_loss(config.loss).policy if config.policy == "auto" else config.policy
    if name not in POLICIES:
        raise unknown("policy", config.policy, ("auto", *POLICIES))
    return name


def check_together(config: Config, hypers: Hypers) -> None:
    """Raise UsageError where the numbers don't fit the choices."""
    refuse_others(config, hypers)
    for settings in (config, hypers):
        refuse_idle(config, settings)
    find_critic(config.critic).check(config, hypers)


def refuse_others(config: Config, settings: Config | Hypers) -> None:
    """Raise UsageError where a setting that only other algorithms or critics have a use for is not at its default."""
    choices = {
        "algorithm": {name: algorithm.own for name, algorithm in ALGORITHMS.items()},
        "critic": {name: critic.uses for name, critic in CRITICS.items()},
    }
    usual = defaults(type(settings))
    for choice, uses in choices.items():
        chosen = getattr(config, choice)
        for other, names in uses.items():
            for name in sorted(set(names) & set(usual) - set(uses[chosen])):
                given = np.atleast_1d(getattr(settings, name))
                default = np.float32(usual[name]) if given.dtype == np.float32 else usual[name]
                for value in given[given != default][:1]:
                    raise UsageError(f"{name} is {value!s}; it goes with {choice} {other!r}, not {chosen!r}")


def refuse_idle(config: Config, settings: Config | Hypers) -> None:
    """Raise UsageError where a setting is not at its default that the configuration's loss and policy have no use for.

    Settings of before these checks are not among them: what files have, they may have. They may also have a policy that
    nobody has registered here, of which nothing is known.
    """
    usual, whose = defaults(type(settings)), idle(config)
    for name in whose.keys() & usual.keys():
        given = getattr(settings, name)
        values = np.atleast_1d(usual[name] if given is None else given)  # None is without_unused's
        for value in values[values != usual[name]][:1]:
            if may_idle(name, value):
                continue
            shown, policy = repr(str(value)) if isinstance(value, str) else str(value), policy_of(config)
            raise UsageError(
                f"{name} is {shown}; it goes with {whose[name]}, not with the policy {policy!r} and the loss "
                f"{config.loss!r}"
            )
    if isinstance(settings, Hypers):
        credit.check_numbers(config, settings)


def may_idle(name: str, value: object) -> bool:
    """Whether files of before these checks may have a setting although nothing uses it."""
    old = ("eta", "n_bins", "exploration", "bin_sample", "deterministic_action")
    return name in old or (name, value) == ("initial_policy", "gaussian")


def idle(config: Config) -> dict[str, str]:
    """The fields that the configuration's loss and policy have no use for, each with what has one.

    None where the policy is one that nobody has registered here.
    """
    if config.policy not in ("auto", *POLICIES):
        return {}
    loss, policy = find_loss(config.loss), policy_of(config)
    found: dict[str, str] = {}
    if POLICIES[policy].family != "histogram":
        bins = ("n_bins", "initial_policy", "exploration", "bin_sample", "deterministic_action", "bin_centers")
        found |= dict.fromkeys((*bins, "target_tails"), "a policy over bins")
    if "eta" not in (*loss.uses, *USES.get(policy, ())):
        found |= dict.fromkeys(("eta", "target_tails"), "targets of width η")
    if "rpo_alpha" not in USES.get(policy, ()):
        found["rpo_alpha"] = "the policy 'rpo'"
    if policy == "beta":
        found |= dict.fromkeys(("log_std_init", "log_std_min"), "a policy that has a σ")
    return found


def find_algorithm(name: str) -> Algorithm:
    """The entry of that name; UsageError lists the names if there is none."""
    if name not in ALGORITHMS:
        raise unknown("algorithm", name, ALGORITHMS)
    return ALGORITHMS[name]
