"""A study as data: one environment, a list of settings, and trials of each."""

import dataclasses
import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, NamedTuple

from galton.agents import agent_of, flat, parts_of
from galton.algorithms import Agent
from galton.errors import require
from galton.fields import AtLeast, check_fields
from galton.losses import find_loss
from galton.parts import settings
from galton.policies import POLICIES
from galton.records import FIRST_FIELDS, Fields, defaults, filled, refuse_unknown, written
from galton.training.train import log_plan
from galton.types import Config, Count, Hypers, check_hypers, check_one_run, make_config


class Setting(NamedTuple):
    """One point of a grid: a Config and Hypers."""

    config: Config
    """What changes shapes or code."""
    hypers: Hypers
    """The hyperparameters, as plain numbers."""

    @property
    def agent(self) -> Agent:
        """The agent that it is; UsageError for parts that don't fit together."""
        return agent_of(*self)

    def record(self) -> Fields:
        """The fields that it is known by: later ones that have their defaults are left out (see `galton.records`)."""
        return written(self.config) | written(self.hypers)

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> "Setting":
        """The setting with these fields, the rest at their defaults.

        Raises:
            UsageError: an unknown field, a value out of range.
        """
        for name in record:
            known = ", ".join(DEFAULTS)
            require(name in DEFAULTS, f"{name!r} is no setting; choose from {known}")
        config = make_config({name: value for name, value in record.items() if name not in Hypers._fields})
        if config.policy == find_loss(config.loss).policy:
            config = dataclasses.replace(config, policy="auto")  # the same setting has one name
        given = Hypers(**{name: value for name, value in record.items() if name in Hypers._fields})
        check_one_run(given)
        setting = cls(config, Hypers._make(float(number) for number in given))
        if config.policy in ("auto", *POLICIES):  # of one that nobody has registered here nothing is known
            parts_of(flat(*setting))["critic"].check(config.normalize_reward)
        return setting

    def brief(self) -> str:
        """What the grids vary of its loss, in a line."""
        loss, policy = find_loss(self.config.loss), POLICIES.get(self.config.policy)
        parts = [f"learning rate {self.hypers.learning_rate:.3g}"]
        parts += [f"k {self.config.n_bins}"] if loss.family == "histogram" else []
        own = {*settings(loss), *(settings(policy) if policy else ())}
        parts += [f"η {self.hypers.eta:.3g}"] if "eta" in own else []
        later = [(name, value) for name, value in self.record().items() if name not in FIRST_FIELDS]
        parts += [f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}" for name, value in later]
        return ", ".join(parts)

    @property
    def name(self) -> str:
        """A hash of its record: the same in every study that holds it, and in every version of Galton."""
        return hashlib.sha256(canonical(self.record()).encode()).hexdigest()[:16]


DEFAULTS = defaults(Config) | defaults(Hypers)
"""All fields of a setting, with their defaults."""


Natural = Annotated[int, AtLeast(0)]
"""A whole number that may be 0."""


MOST_RUNS = 10_000_000
"""How many runs a study may have."""

MOST_LOGS = 1_000_000
"""How many points a learning curve of a study may have."""


@dataclasses.dataclass(frozen=True)
class Study:
    """What a sweep trains: settings on one environment, with several runs of each."""

    env: str
    """A name in ENVS or a Gymnasium id (`module:Id` imports the module first)."""
    settings: tuple[Setting, ...]
    """The points of the grid, each of them once."""
    trials: Count
    """Runs of each setting, each with a seed of its own."""
    steps: Count
    """Environment steps per run."""
    logs: Count = 100
    """How many points each learning curve has."""
    eval_episodes: Natural = 10
    """Episodes of the deterministic policy at each of them."""
    env_kwargs: str = "{}"
    """The environment's keyword arguments, as JSON."""
    seed: Natural = 0
    """The study's seed: another one gives every run a fresh seed."""
    imports: tuple[str, ...] = ()
    """Modules that every worker imports first: where losses, policies and environments of your own are registered."""
    common_seeds: bool = False
    """Whether trial t of every setting has the same seed: first episodes, the environment's noise and the critic's
    start are then drawn alike, and settings are compared in pairs. Otherwise every run has a seed of its own."""
    eval_mean: bool = False
    """Whether evaluation plays once more by the mean of the policy's distribution (see `train`)."""

    def __post_init__(self) -> None:
        check_fields(self)
        require(len(self.settings) > 0, "settings is empty; give at least one")
        require(len(set(self.settings)) == len(self.settings), "settings holds the same setting twice; give each once")
        n = len(self.settings) * self.trials
        require(
            n <= MOST_RUNS,
            f"trials is {self.trials:,}, which makes {n:,} runs; give fewer of them; {MOST_RUNS:,} is the most",
        )
        require(self.seed < 2**63, f"seed is {self.seed}; it must be less than 2⁶³")
        points = {
            log_plan(config, self.steps, self.logs)[0]: (config.n_envs, config.n_steps)
            for config in dict.fromkeys(setting.config for setting in self.settings)
        }
        shown = " and ".join(
            f"{n} with {n_envs} × {n_steps} steps an update" for n, (n_envs, n_steps) in points.items()
        )
        require(
            len(points) == 1,
            f"logs is {self.logs}, which makes {shown}; choose steps and logs so that every setting has as many",
        )
        require(max(points) <= MOST_LOGS, f"logs is {self.logs:,}; a curve may have {MOST_LOGS:,} points at most")

    @property
    def modules(self) -> tuple[str, ...]:
        """The modules that training needs: those to import, and that of an environment called `module:Id`."""
        of_env = (self.env.partition(":")[0],) if ":" in self.env else ()
        return (*self.imports, *of_env)

    def constants(self) -> dict[str, object]:
        """What every run shares, for JSON."""
        record = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        later = {field.name: field.default for field in dataclasses.fields(self) if field.name not in _FIRST_FIELDS}
        return {
            name: value
            for name, value in record.items()
            if name not in ("settings", "trials") and not (name in later and value == later[name])
        }

    def record(self) -> dict[str, object]:
        """The whole study, for JSON."""
        settings = _by_field([setting.record() for setting in self.settings])
        return {"constants": self.constants(), "trials": self.trials, "settings": settings}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> "Study":
        """The study with this record.

        Raises:
            NewerVersionError: a setting has fields that this version does not know.
            UsageError: a field is not what it must be.
        """
        settings = record["settings"]
        refuse_unknown("the study", [*settings["same"], *settings["different"]], DEFAULTS)
        names = {field.name for field in dataclasses.fields(cls)}
        refuse_unknown("the study", record["constants"], names)
        constants = record["constants"] | {"imports": tuple(record["constants"]["imports"])}
        columns = settings["same"] | settings["different"]
        check_hypers(Hypers(**{name: values for name, values in columns.items() if name in Hypers._fields}))
        return cls(settings=tuple(_settings(**settings)), trials=record["trials"], **constants)


_FIRST_FIELDS = frozenset(
    {"env", "settings", "trials", "steps", "logs", "eval_episodes", "env_kwargs", "seed", "imports"}
)
"""The fields that version 0.1.0 wrote, always; later ones are left out where they have their defaults."""


def canonical(record: object) -> str:
    """JSON that is the same for equal records."""
    return json.dumps(record, sort_keys=True, separators=(",", ":"))


def _by_field(records: list[Fields]) -> dict[str, dict[str, object]]:
    """Fields with one value for all settings, and the lists of values of the others."""
    rows = filled(records, DEFAULTS)
    lists = {name: [row[name] for row in rows] for name in rows[0]}
    same = {name: values[0] for name, values in lists.items() if all(value == values[0] for value in values)}
    return {"same": same, "different": {name: values for name, values in lists.items() if name not in same}}


def _settings(same: Fields, different: dict[str, list[object]]) -> Iterator[Setting]:
    """The settings that `_by_field` took apart."""
    configs: dict[str, Config] = {}
    for values in zip(*different.values(), strict=True) if different else [()]:
        record = same | dict(zip(different, values, strict=True))
        hypers = Hypers(**{name: record.pop(name) for name in Hypers._fields if name in record})
        key = repr(record)
        config = configs.get(key) or configs.setdefault(key, make_config(record))
        yield Setting(config, hypers)
