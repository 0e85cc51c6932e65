"""The plan: every run of a sweep, dealt into shards, on disk. It is the truth; what carries it out is disposable."""

import dataclasses
import functools
import hashlib
import itertools
import sys
from typing import Any

import numpy as np
import pyarrow as pa
from jaxtyping import Int, UInt

from galton.agents import read
from galton.algorithms import Agent
from galton.envs.registry import is_known
from galton.errors import MALFORMED, NewerVersionError, UsageError, in_a_line, require, require_integer
from galton.words import vocabulary
from galton_experiments.sweep import columns
from galton_experiments.sweep.parquet import from_bytes, record_of, to_bytes, with_record
from galton_experiments.sweep.store import Store, checksum
from galton_experiments.sweep.study import Program, Setting, Study, canonical

FILE = "plan.parquet"
MOST_RUNS = 100_000
"""The most runs that one shard may have."""
_COLUMNS: dict[str, type[np.generic]] = {"shard": np.int32, "setting": np.int32, "trial": np.int32, "seed": np.uint32}
COMMON = "common"
"""The word that stands for the setting in the seeds of a study whose settings share them."""


@dataclasses.dataclass(frozen=True)
class Shard:
    """Runs that are trained side by side, W of them, the plan's `shard_width` at most, by one program."""

    index: int
    agent: Agent
    """That of all runs; its numbers are `[W]`."""
    setting: Int[np.ndarray, " W"]
    """Each run's setting, as an index into the plan's settings."""
    trial: Int[np.ndarray, " W"]
    seeds: UInt[np.ndarray, " W"]
    name: str
    """A hash of all that determines its results."""


@dataclasses.dataclass(frozen=True)
class Plan:
    """R runs in S shards. Nothing in it ever changes but that new shards are added behind the last one."""

    study: Study
    """The study with all of its settings, in the order in which they were added."""
    shard_width: int
    shard: Int[np.ndarray, " R"]
    """Each run's shard; the numbers never go down."""
    setting: Int[np.ndarray, " R"]
    """Each run's setting, as an index into the study's settings."""
    trial: Int[np.ndarray, " R"]
    seed: UInt[np.ndarray, " R"]

    @classmethod
    def create(cls, study: Study, shard_width: int | np.integer | None = None) -> "Plan":
        """The runs of a study, grouped by their programs, in shards of `shard_width`.

        By default 16 on Galton's own environments and 32 on others.

        Raises:
            UsageError: a width out of range, or a setting that can't be trained.
        """
        if shard_width is None:
            shard_width = 16 if is_known(study.env) else 32
        _check_width(shard_width)
        none = np.zeros(0, np.int32)
        empty = dataclasses.replace(study, settings=study.settings[:1])
        return cls(empty, int(shard_width), none, none, none, none.astype(np.uint32)).extended(study)

    def extended(self, study: Study) -> "Plan":
        """The same plan, with shards added for what it lacks of this study: a plan has all trials of all settings.

        Raises:
            UsageError: the study differs in something that all runs share, or has a new setting that can't be trained.
        """
        for name in self.study.constants() | study.constants():
            ours, theirs = getattr(self.study, name), getattr(study, name)
            require(ours == theirs, f"{name} is {theirs!r}, but the plan has {ours!r}; name another folder")
        place = {known: i for i, known in enumerate(self.study.settings)}
        if all(module in sys.modules for module in study.imports):  # else the workers may know losses that we don't
            for wanted in study.settings:
                if not (self.n_runs and wanted in place):
                    _ = wanted.agent  # what training would refuse is refused now: a plan stands in the way of others
        for wanted in study.settings:
            place.setdefault(wanted, len(place))
        settings, trials = tuple(place), max(study.trials, self.study.trials if self.n_runs else 0)

        setting = np.repeat(np.arange(len(settings), dtype=np.int32), trials)
        trial = np.tile(np.arange(trials, dtype=np.int32), len(settings))
        new = ~np.isin(setting.astype(np.int64) << 32 | trial, self.setting.astype(np.int64) << 32 | self.trial)
        setting, trial = setting[new], trial[new]
        groups: dict[Program, int] = {}
        group = np.array([groups.setdefault(s.program, len(groups)) for s in settings], np.int32)[setting]
        order = np.lexsort((trial, setting, group))
        setting, trial, group = setting[order], trial[order], group[order]
        place_in_group = np.arange(len(group)) - np.searchsorted(group, group)
        shard = self.n_shards - 1 + np.cumsum(place_in_group % self.shard_width == 0)
        names = [COMMON if study.common_seeds else s.name for s in settings]
        seeds = [fold_in(study.seed, names[s], t) for s, t in zip(setting.tolist(), trial.tolist(), strict=True)]
        return Plan(
            dataclasses.replace(study, settings=settings, trials=trials),
            self.shard_width,
            np.r_[self.shard, shard.astype(np.int32)],
            np.r_[self.setting, setting],
            np.r_[self.trial, trial],
            np.r_[self.seed, np.array(seeds, np.uint32)],
        )

    @property
    def n_runs(self) -> int:
        """Count the runs of the plan, R."""
        return len(self.shard)

    @property
    def n_shards(self) -> int:
        """Count the shards of the plan, S."""
        return int(self.shard[-1]) + 1 if len(self.shard) else 0

    @functools.cached_property
    def bounds(self) -> Int[np.ndarray, " starts"]:
        """Return the index at which each shard's runs begin, and the one at which the last shard ends `[S + 1]`."""
        return np.searchsorted(self.shard, np.arange(self.n_shards + 1))

    @functools.cached_property
    def firsts(self) -> list[Setting]:
        """A setting of each shard, whose program is that of all."""
        settings = self.study.settings
        return [settings[i] for i in self.setting[self.bounds[:-1]].tolist()]

    @functools.cached_property
    def names(self) -> list[str]:
        """The name of each shard: a hash of all that determines its results."""
        common = canonical([self.study.constants(), self.shard_width]).encode()
        settings = np.array([setting.name.encode() for setting in self.study.settings])[self.setting]
        columns = [np.ascontiguousarray(column) for column in (settings, self.trial, self.seed)]
        bounds = self.bounds.tolist()
        return [
            checksum(common + b"".join(column[start:stop].tobytes() for column in columns))[:16]
            for start, stop in itertools.pairwise(bounds)
        ]

    def get(self, index: int) -> Shard:
        """The shard of that number, with the runs to train.

        Raises:
            UsageError: there is none of that number.
        """
        fits = 0 <= index < self.n_shards
        require(fits, f"shard is {index}; the plan has {self.n_shards}, from 0 to {self.n_shards - 1}")
        start, stop = self.bounds[index : index + 2].tolist()
        setting, trial, seeds = (column[start:stop] for column in (self.setting, self.trial, self.seed))
        settings = [self.study.settings[i] for i in setting.tolist()]
        numbers = {
            name
            for one in settings
            for name, value in one.record().items()
            if vocabulary().is_number(name) and not isinstance(value, str)
        }
        columns = {name: np.array([one[name] for one in settings], np.float32) for name in numbers}
        return Shard(index, read(settings[0].record() | columns), setting, trial, seeds, self.names[index])

    def save(self, store: Store) -> None:
        """Write the plan into its folder, in place of an earlier and shorter one."""
        columns = {"shard": self.shard, "setting": self.setting, "trial": self.trial, "seed": self.seed}
        record = self.study.record() | {"shard_width": self.shard_width}
        table = pa.table(columns)
        digest = _digest(record, table)
        store.write(FILE, to_bytes(with_record(table, {"plan": record, "digest": digest})))

    @classmethod
    def load(cls, store: Store) -> "Plan":
        """The plan that a folder holds.

        Raises:
            UsageError: it holds no plan, or one that was damaged.
        """
        return _parse(store.url, _content(store))

    @staticmethod
    def imports(store: Store) -> tuple[str, ...]:
        """The modules that the plan in a folder names: what they register may have settings of the plan.

        Raises:
            UsageError: as `load`.
        """
        record, _ = _whole(store.url, _content(store))
        try:
            return tuple(map(str, record["constants"]["imports"]))
        except MALFORMED as error:
            raise _of_somebody_else(store.url, error) from None


def _content(store: Store) -> bytes:
    try:
        return store.read(FILE)
    except FileNotFoundError:
        raise UsageError(f"out is {store.url}, which holds no sweep; start one with: galton sweep ENV") from None


def _whole(url: str, data: bytes) -> tuple[dict[str, Any], pa.Table]:
    """The record of a plan and its table; UsageError unless both are what was written."""
    try:
        table = from_bytes(data)
        whole = record_of(table)
        record = whole["plan"]
        intact = whole["digest"] == _digest(record, table)
    except (pa.ArrowException, OSError, *MALFORMED):
        intact = False
    if not intact:
        raise UsageError(
            f"out is {url}, whose {FILE} was damaged; put it back from a copy, or plan the same sweep in another "
            "folder and move the shards folder there: whole shards of the same runs count"
        )
    return record, table


def _of_somebody_else(url: str, error: Exception) -> UsageError:
    return UsageError(f"out is {url}, whose {FILE} is none of Galton's: {in_a_line(error)}; plan the sweep anew")


@functools.lru_cache(maxsize=4)
def _parse(url: str, data: bytes) -> Plan:
    record, table = _whole(url, data)
    try:
        plan = Plan(Study.of_record(record), record["shard_width"], *_columns(table))
        _check(plan)
    except NewerVersionError as error:
        raise NewerVersionError(f"out is {url}, whose {FILE} can't be read: {error}") from None
    except MALFORMED as error:
        raise _of_somebody_else(url, error) from None
    return plan


def _columns(table: pa.Table) -> list[np.ndarray]:
    """Shard, setting, trial and seed of each run; UsageError where one is missing or of another type."""
    columns.check_names(table, _COLUMNS)
    return [columns.numbers(table, name, kind) for name, kind in _COLUMNS.items()]


def _check(plan: Plan) -> None:
    """Raise UsageError unless a plan is one that `create` and `extended` make."""
    _check_width(plan.shard_width)
    shard, setting, trial, n = plan.shard, plan.setting, plan.trial, len(plan.study.settings)
    for name, given, most in (("setting", setting, n), ("trial", trial, plan.study.trials)):
        require(((given >= 0) & (given < most)).all(), f"its {name} must be 0 to {most - 1}, as the study has {most}")
    wanted = n * plan.study.trials
    n_pairs = len(np.unique(setting.astype(np.int64) << 32 | trial))
    require(len(shard) == n_pairs == wanted, f"it must have each trial of each setting once, {wanted:,} runs")
    steps = np.diff(shard, prepend=-1)
    require(steps[0] == 1 and ((steps == 0) | (steps == 1)).all(), "its shards must be numbered from 0 on, in order")
    require(np.bincount(shard).max() <= plan.shard_width, f"a shard of it has more than {plan.shard_width} runs")
    programs: dict[Program, int] = {}
    group = np.array([programs.setdefault(s.program, len(programs)) for s in plan.study.settings])[setting]
    require((np.diff(group)[steps[1:] == 0] == 0).all(), "a shard of it has settings of several programs")


def _check_width(shard_width: Any) -> None:
    require_integer("shard_width", shard_width, 1)
    require(shard_width <= MOST_RUNS, f"shard_width is {shard_width:,}; it must be {MOST_RUNS:,} at most")


def _digest(record: dict[str, object], table: pa.Table) -> str:
    columns = b"".join(np.ascontiguousarray(column.to_numpy()).tobytes() for column in table.columns)
    return checksum(canonical(record).encode() + columns)


def fold_in(study: int, setting: str, trial: int) -> int:
    """The seed of a run, 0 … 2³² − 1: a hash of the study's seed, the setting's name and the trial.

    Neither other settings nor other trials have a part in it.
    """
    content = study.to_bytes(8, "little") + trial.to_bytes(8, "little") + setting.encode()
    return int.from_bytes(hashlib.blake2b(content, digest_size=4).digest(), "little")
