"""What a model's constructor can be told: the fields of Config and Hypers as keyword arguments."""

import inspect
import math
from collections.abc import Iterable
from typing import Any, Literal, TypedDict

from galton.agents import idle
from galton.algorithms import Algorithm
from galton.errors import did_you_mean, require_integer
from galton.models.hints import refuse_schedules, unexpected
from galton.presets import PAPER, Preset
from galton.records import Fields, defaults
from galton.tasks import settings_of
from galton.types import Config, Hypers, make_config


class Settings(TypedDict, total=False):
    """The fields of Config and Hypers, which describe them; their defaults are the algorithm's."""

    policy: str
    learning_rate: float
    decay_steps: float
    n_steps: int
    batch_size: int
    n_epochs: int
    ratio: Literal["auto", "smoothed", "true"]
    gamma: float
    gae_lambda: float
    clip_range: float
    target_kl: float | None
    normalize_advantage: bool
    ent_coef: float
    vf_coef: float
    max_grad_norm: float
    clip_separately: bool
    critic: str
    n_value_bins: int
    value_min: float
    value_max: float
    value_eta: float
    eta: float
    n_bins: int
    log_std_init: float
    log_std_min: float
    box_units: float
    rpo_alpha: float
    net_arch: Iterable[int]
    normalize_observation: bool
    normalize_reward: bool
    initial_policy: Literal["uniform", "gaussian", "clipped-gaussian"]
    exploration: Literal["softmax", "gaussian"]
    bin_sample: Literal["center", "uniform"]
    noise_correlation: float
    deterministic_action: Literal["mode", "mean", "median"]
    bin_centers: Literal["inside", "bounds"]
    target_tails: Literal["rescaled", "edges"]
    eta_rule: Literal["fixed", "policy"]
    eta_min: float
    eta_max: float
    negative_target: Literal["same", "one-hot"]
    weighting: Literal["advantage", "awr", "v-mpo"]
    temperature: float
    entropy_target: bool
    entropy_start: float
    entropy_end: float
    entropy_steps: float
    entropy_rate: float
    entropy_alpha_min: float


def usual(algorithm: type[Algorithm], env: object = None, preset: Preset = Preset(PAPER)) -> Fields:  # noqa: B008
    """The settings that an algorithm knows, in the order of Settings, with the values that nobody has to name.

    A named task's go before the preset's, and the preset's before the algorithm's.
    """
    values = _usual(algorithm, env, preset)
    unknown = idle({"algorithm": algorithm.name}, ["algorithm"])
    return {name: values[name] for name in Settings.__annotations__ if name not in unknown}


def _usual(algorithm: type[Algorithm], env: object, preset: Preset) -> Fields:
    """All fields of Config and Hypers."""
    plain = defaults(Config) | defaults(Hypers) | dict(algorithm.defaults)
    task = plain | settings_of(env) | dict(algorithm.defaults)
    own = {name for name in plain if task[name] != plain[name]}
    if "n_steps" in own:
        own.add("n_envs")  # the task's rollout is whole
    return task | {name: value for name, value in preset.settings.items() if name not in own}


def split(
    algorithm: type[Algorithm],
    preset: Preset,
    n_envs: int | None,
    settings: Fields,
    env: object = None,
    ready: int | None = None,
) -> tuple[Config, Hypers]:
    """The settings as the records that training takes; what is not among them is as `usual` has it.

    Args:
        algorithm: what learns.
        preset: the loss, and what changes the usual values.
        n_envs: copies of the environment, None for the usual number.
        settings: what was named beside these.
        env: what was given as the environment; only a name means something here.
        ready: how many environments were given ready-made, None where copies are made.

    Raises:
        TypeError: a name that is no setting of this algorithm.
        UsageError: a value out of range.
    """
    known = usual(algorithm, env, preset)
    for name in settings:
        if name not in known:
            known_ones = f"it takes {', '.join(known)}{did_you_mean(name, known)}"
            raise unexpected(algorithm.label, name, known_ones)
    refuse_schedules(settings)
    copies = _usual(algorithm, env, preset)["n_envs"]
    n_envs = (ready or copies) if n_envs is None else n_envs
    given = known | settings
    if given.get("target_kl", math.inf) is None:  # as SB3 has it
        given["target_kl"] = math.inf
    if n_envs != copies > 1 and "n_steps" not in settings:
        given["n_steps"] = _as_long(copies * known["n_steps"], n_envs, given.get("batch_size", 1))
    numbers = {name: value for name, value in given.items() if name in Hypers._fields}
    fields = {name: value for name, value in given.items() if name not in numbers}
    arguments = {"loss": preset.loss, "n_envs": n_envs, "algorithm": algorithm.name}
    return make_config(fields | arguments), Hypers(**numbers)


def _as_long(rollout: int, n_envs: Any, batch_size: Any) -> int:
    """How many steps of each environment make a rollout of that length or a little more, in whole minibatches."""
    require_integer("n_envs", n_envs, 1)
    require_integer("batch_size", batch_size, 1)
    unit = batch_size // math.gcd(n_envs, batch_size)
    return unit * math.ceil(rollout / (n_envs * unit))


def unusual(algorithm: type[Algorithm], config: Config, hypers: Hypers) -> str:
    """The copies of the environment, and the settings that are not the algorithm's usual ones, as keyword arguments."""
    own = {name: getattr(config, name, None) for name in usual(algorithm)} | hypers._asdict()
    changed = {name: own[name] for name, value in usual(algorithm).items() if own[name] != value}
    return ", ".join(f"{name}={value!r}" for name, value in {"n_envs": config.n_envs, **changed}.items())


def signature(algorithm: type[Algorithm]) -> inspect.Signature:
    """What help() and editors show of a model's constructor: every setting with its default."""
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
