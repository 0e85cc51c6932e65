"""A study as data: one environment, a list of settings, and trials of each."""

import dataclasses
import functools
import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Any

import numpy as np

from galton import schedules
from galton.agents import parts_of, read, written
from galton.algorithms import Agent
from galton.envs.registry import module_of
from galton.errors import require
from galton.fields import AtLeast, annotations, as_numbers, checked
from galton.losses import find_loss
from galton.parts import Schedule, settings
from galton.policies import POLICIES
from galton.records import FIRST_FIELDS, Fields, refuse_unknown
from galton.training.train import log_plan
from galton.types import Count
from galton.words import idle, values_of, vocabulary

Program = tuple[tuple[str, Any], ...]
"""Settings that are no numbers, with their names."""


class Setting(Mapping[str, Any]):
    """One point of a grid: all settings by name. It is known by those of version 1 and by what is not usual of others.

    Args:
        words: its settings by name; the rest have their usual values.

    Raises:
        UsageError: an unknown name, a value out of range, several numbers for one, or a setting that no part has.
    """

    def __init__(self, words: Mapping[str, Any]) -> None:
        known, given = vocabulary(), values_of(words)
        for name in (name for name in given if known.is_number(name)):
            if not isinstance(given[name], Schedule):
                require(np.ndim(given[name]) == 0, f"{name} is {given[name]}; give one number")
                given[name] = float(as_numbers(name, given[name]))
        if given.get("policy", "auto") == find_loss(str(given.get("loss", known.usual["loss"]))).policy:
            given["policy"] = "auto"  # the same setting has one name
        if given.get("policy", "auto") in ("auto", *POLICIES):  # of one that nobody has registered nothing is known
            parts_of(given)["critic"].check(given.get("normalize_reward", known.usual["normalize_reward"]))
        self._record = written(_as_told(given))

    @classmethod
    def of_checked(cls, words: Mapping[str, Any]) -> "Setting":
        """The setting of words whose values are known to be right, as those of a column that was checked."""
        setting = cls.__new__(cls)
        setting._record = written(words)
        return setting

    def __getitem__(self, name: str) -> Any:
        return self._record[name] if name in self._record else vocabulary().usual[name]

    def __iter__(self) -> Iterator[str]:
        return iter(vocabulary().usual)

    def __len__(self) -> int:
        return len(vocabulary().usual)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Setting) and self._record == other._record

    def __hash__(self) -> int:
        return hash(tuple(self._record.items()))

    def __repr__(self) -> str:
        return f"Setting({self._record})"

    def replace(self, **words: Any) -> "Setting":
        """The same setting but for these words."""
        return Setting(self._record | words)

    def record(self) -> Fields:
        """The settings that it is known by: later ones that have their usual values are left out."""
        return dict(self._record)

    @functools.cached_property
    def agent(self) -> Agent:
        """The agent that it is; UsageError for parts that don't fit together."""
        return read(self._record)

    @functools.cached_property
    def program(self) -> Program:
        """Return what it is compiled for: all that is no number, and schedules."""
        known = vocabulary()
        return tuple(
            (name, value) for name, value in self._record.items() if isinstance(value, str) or not known.is_number(name)
        )

    @property
    def rollout_size(self) -> int:
        """The steps of one update, those of all environments together."""
        return int(self["n_steps"] * self["n_envs"])

    def brief(self, varied: Collection[str] = ()) -> str:
        """Describe in a line what the paper's grids vary of its loss, and what a study varies besides."""
        loss, policy = find_loss(self["loss"]), POLICIES.get(self["policy"])
        parts = [f"learning rate {_shown(self['learning_rate'])}"]
        parts += [f"k {self['n_bins']}"] if loss.family == "histogram" else []
        own = {*settings(loss), *(settings(policy) if policy else ())}
        parts += [f"η {_shown(self['eta'])}"] if "eta" in own else []
        told = {"loss", "learning_rate", "n_bins", "eta"} | idle({word: self[word] for word in ("loss", "policy")})
        names = [name for name in self._record if name not in FIRST_FIELDS] + [*varied]
        parts += [f"{name} {_shown(self[name])}" for name in dict.fromkeys(names) if name not in told]
        return ", ".join(parts)

    @functools.cached_property
    def name(self) -> str:
        """A hash of its record: the same in every study that holds it, and in every version of Galton."""
        return hashlib.sha256(canonical(self.record()).encode()).hexdigest()[:16]


def _as_told(words: Fields) -> Fields:
    """The words with schedules as their texts, which files and hashes are made of."""
    return {name: schedules.told(value) if isinstance(value, Schedule) else value for name, value in words.items()}


def _shown(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else f"{value}"


Natural = Annotated[int, AtLeast(0)]
"""A whole number that may be 0."""


MOST_RUNS = 10_000_000
"""The most runs that a study may have."""

MOST_STEPS = 2_000_000_000
"""The most environment steps that a run of a study may have; its tables count them in 32 bits."""

MOST_LOGS = 1_000_000
"""The most points that a learning curve of a study may have."""


@dataclasses.dataclass(frozen=True)
class Study:
    """A study is what a sweep trains: settings on one environment, with several runs of each."""

    env: str
    """A name in ENVS or a Gymnasium id (`module:Id` imports the module first)."""
    settings: tuple[Setting, ...]
    """The points of the grid, each of them once."""
    trials: Count
    """Runs of each setting, each with a seed of its own."""
    steps: Count
    """Environment steps per run."""
    logs: Count = 100
    """The number of points of each learning curve."""
    eval_episodes: Natural = 10
    """Episodes of the deterministic policy at each of them."""
    env_kwargs: str = "{}"
    """The environment's keyword arguments, as JSON."""
    seed: Natural = 0
    """The study's seed: another one gives every run a fresh seed."""
    imports: tuple[str, ...] = ()
    """Modules that every worker imports first: where losses, policies and environments of your own are registered."""
    common_seeds: bool = False
    """True if trial t of every setting has the same seed: first episodes, the environment's noise and the critic's
    start are then drawn alike, and settings are compared in pairs. Otherwise every run has a seed of its own."""
    eval_mean: bool = False
    """True if evaluation plays once more by the mean of the policy's distribution (see `train`)."""

    def __post_init__(self) -> None:
        for name, annotation in annotations(Study).items():
            object.__setattr__(self, name, checked(name, getattr(self, name), annotation))
        require(len(self.settings) > 0, "settings is empty; give at least one")
        require(len(set(self.settings)) == len(self.settings), "settings holds the same setting twice; give each once")
        n = len(self.settings) * self.trials
        require(
            n <= MOST_RUNS,
            f"trials is {self.trials:,}, which makes {n:,} runs; give fewer of them; {MOST_RUNS:,} is the most",
        )
        require(self.seed < 2**63, f"seed is {self.seed}; it must be less than 2⁶³")
        points = {
            log_plan(n_envs * n_steps, self.steps, self.logs)[0]: (n_envs, n_steps)
            for n_envs, n_steps in dict.fromkeys((s["n_envs"], s["n_steps"]) for s in self.settings)
        }
        shown = " and ".join(
            f"{n} with {n_envs} × {n_steps} steps an update" for n, (n_envs, n_steps) in points.items()
        )
        require(
            len(points) == 1,
            f"logs is {self.logs}, which makes {shown}; choose steps and logs so that every setting has as many",
        )
        require(max(points) <= MOST_LOGS, f"logs is {self.logs:,}; a curve may have {MOST_LOGS:,} points at most")
        require(self.steps <= MOST_STEPS, f"steps is {self.steps:,}; a run of a sweep may have {MOST_STEPS:,} at most")

    @property
    def modules(self) -> tuple[str, ...]:
        """The modules that training needs: those to import, and that of an environment called `module:Id`."""
        return (*self.imports, *module_of(self.env))

    @functools.cached_property
    def varied(self) -> tuple[str, ...]:
        """The names of what differs between settings."""
        records = [setting.record() for setting in self.settings]
        names = dict.fromkeys(name for record in records for name in record)
        return tuple(name for name in names if len({repr(record.get(name)) for record in records}) > 1)

    def constants(self) -> dict[str, object]:
        """Return what every run shares, for JSON."""
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
        refuse_unknown("the study", [*settings["same"], *settings["different"]], vocabulary().usual)
        names = {field.name for field in dataclasses.fields(cls)}
        refuse_unknown("the study", record["constants"], names)
        constants = record["constants"] | {"imports": tuple(record["constants"]["imports"])}
        return cls(settings=tuple(_settings(**settings)), trials=record["trials"], **constants)


_FIRST_FIELDS = frozenset(
    {"env", "settings", "trials", "steps", "logs", "eval_episodes", "env_kwargs", "seed", "imports"}
)
"""The fields that version 0.1.0 wrote, always; later ones are left out where they have their defaults."""


def canonical(record: object) -> str:
    """JSON that is the same for equal records."""
    return json.dumps(record, sort_keys=True, separators=(",", ":"))


def filled(rows: Collection[Mapping[str, object]], default: Mapping[str, object]) -> list[dict[str, object]]:
    """The same rows with the same fields each, in one order: what a row leaves out has its default."""
    names = dict.fromkeys(name for row in rows for name in row)
    for name in names:
        require(name in default or all(name in row for row in rows), f"{name} is missing and has no default")
    return [{name: row[name] if name in row else default[name] for name in names} for row in rows]


def _by_field(records: list[Fields]) -> dict[str, dict[str, object]]:
    """Fields with one value for all settings, and the lists of values of the others."""
    rows = filled(records, vocabulary().usual)
    lists = {name: [row[name] for row in rows] for name in rows[0]}
    same = {name: values[0] for name, values in lists.items() if all(value == values[0] for value in values)}
    return {"same": same, "different": {name: values for name, values in lists.items() if name not in same}}


def _settings(same: Fields, different: dict[str, list[object]]) -> Iterator[Setting]:
    """The settings that `_by_field` took apart; UsageError for a value out of range."""
    same = _as_told(values_of(same))
    columns = {name: _column(name, values) for name, values in different.items()}
    for values in zip(*columns.values(), strict=True) if columns else [()]:
        yield Setting.of_checked(same | dict(zip(columns, values, strict=True)))


def _column(name: str, values: list[object]) -> list[object]:
    """The values of one setting, each of those that differ checked once, and numbers all at once."""
    known = vocabulary()
    if known.is_number(name) and not any(isinstance(value, str) for value in values):
        return np.asarray(checked(name, values, known.annotations[name]), np.float64).tolist()
    found = {repr(value): _as_told(values_of({name: value}))[name] for value in values}
    return [found[repr(value)] for value in values]
