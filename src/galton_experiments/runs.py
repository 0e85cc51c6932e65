"""Runs in a file small enough to keep: a row for each with its final numbers and its curves."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from jaxtyping import Bool, Float, Int, Shaped

from galton.errors import require
from galton.losses import find_loss
from galton.training.log import MEAN_ACTION_RETURN
from galton.training.train import final
from galton_experiments.analysis.statistics import fill_until
from galton_experiments.sweep import columns
from galton_experiments.sweep.parquet import opened, to_bytes, with_record
from galton_experiments.sweep.results import Best, best_settings
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Setting, Study

_KEYS = ("setting", "trial", "seed", "final_training_return", "final_evaluation_return", "diverged_at", "steps")
"""The columns of a sweep's results that are not curves of a metric."""
_KEYS_KEPT = ("setting", "trial", "diverged_at", "steps", "final_training_return", "final_evaluation_return")
"""Those of them that a summary has."""
CURVES = ("training_return", "evaluation_return", "entropy")
"""The metrics that are kept of each log point; of the others only their final means are."""
CURVES_TOO = (MEAN_ACTION_RETURN,)
"""Those that are kept where they were logged."""


Provenance = Mapping[str, Any]
"""The record of how a sweep was made: budget, versions, machines, seconds of training."""


@dataclasses.dataclass(frozen=True)
class Summary:
    """A summary is what is kept of a sweep: R runs of a study with L log points each."""

    study: Study
    """The settings, trials and steps of the sweep are those of this study."""
    provenance: Provenance
    """The record of how it was made."""
    table: pa.Table
    """A row for each run: its setting's place in the study, its trial, final numbers and curves."""

    @classmethod
    def of_results(cls, study: Study, results: pa.Table, provenance: Provenance) -> "Summary":
        """The summary of the table of all runs that `sweep.results.collect` gathered."""
        diverged_at = results.column("diverged_at").to_numpy()
        content = {name: results.column(name) for name in ("setting", "trial", "diverged_at")}
        metrics = [name for name in results.column_names if name not in _KEYS and not name.startswith("setting.")]
        for metric in metrics:
            curves = lists(results, metric)
            content[f"final_{metric}"] = pa.array(final(curves, diverged_at).astype(np.float32))
            if metric in (*CURVES, *CURVES_TOO):
                as_read = pa.list_(pa.field("element", pa.float32()), curves.shape[1])
                content[metric] = pa.FixedSizeListArray.from_arrays(_shorten(curves).ravel(), type=as_read)
        content["steps"] = results.column("steps")
        return cls(study, provenance, pa.table(content))

    def save(self, store: Store, name: str) -> None:
        """Write it as one file; the same bytes for the same summary."""
        data = to_bytes(
            with_record(self.table, {"study": self.study.record(), "provenance": dict(self.provenance)}),
            compression_level=19,
            use_dictionary=["setting", "trial", "diverged_at", "steps.list.element"],
            column_encoding={
                f"{metric}.list.element": "BYTE_STREAM_SPLIT"
                for metric in (*CURVES, *CURVES_TOO)
                if metric in self.table.column_names
            },
        )
        store.write(name, data)

    @classmethod
    def load(cls, store: Store, name: str) -> "Summary":
        """The summary that `save` wrote to a file.

        Raises:
            FileNotFoundError: no such file.
            UsageError: something else is there.
        """

        def read(table: pa.Table, record: dict[str, Any]) -> Summary:
            study = Study.of_record(record["study"])
            check(table, study)
            columns.check_record(record, {"provenance": {}})
            return cls(study, record["provenance"], table.replace_schema_metadata(None))

        told = "no summary of a sweep, or was damaged"
        return opened(store.read(name), f"{name} in {store.url}", read, told, "remove it, and make it again")

    @functools.cached_property
    def best(self) -> dict[str, Best]:
        """Each loss's best setting, by its mean final training return (App. C.2)."""
        return best_settings(self.study, self.table)

    @property
    def steps(self) -> Int[np.ndarray, " L"]:
        """Return the environment steps that were taken by each log point."""
        return steps(self.table)

    @functools.cached_property
    def setting(self) -> Int[np.ndarray, " R"]:
        """Each run's setting, as an index into the study's settings."""
        return np.asarray(self.table.column("setting").to_numpy())

    def rows(self, *settings: Setting) -> Bool[np.ndarray, " R"]:
        """Mark the rows that are runs of these settings."""
        wanted = np.zeros(len(self.study.settings), bool)
        wanted[[self._place[setting] for setting in settings]] = True
        return wanted[self.setting]

    @functools.cached_property
    def _place(self) -> dict[Setting, int]:
        return {setting: i for i, setting in enumerate(self.study.settings)}

    def part(self, settings: Sequence[Setting], trials: int | None = None) -> "Summary":
        """The runs of these settings, in their order, as a summary of their own; or only so many trials of each."""
        trials = self.study.trials if trials is None else min(trials, self.study.trials)
        place = np.full(len(self.study.settings), -1, np.int32)
        place[[self._place[setting] for setting in settings]] = np.arange(len(settings))
        rows = (place[self.setting] >= 0) & (self.table.column("trial").to_numpy() < trials)
        table = self.table.filter(pa.array(rows))
        setting = pa.array(place[table.column("setting").to_numpy()])
        table = table.set_column(table.column_names.index("setting"), "setting", setting)
        study = dataclasses.replace(self.study, settings=tuple(settings), trials=trials)
        return Summary(study, self.provenance, table.sort_by([("setting", "ascending"), ("trial", "ascending")]))

    def is_paired_with(self, other: "Summary") -> bool:
        """Say whether trial t has the same seed in both."""
        both = self.study, other.study
        return all(study.common_seeds for study in both) and both[0].seed == both[1].seed

    def joined(self, other: "Summary") -> "Summary":
        """These runs and those of another sweep with the same log points, as many trials as both have."""
        trials = min(self.study.trials, other.study.trials)
        parts = [each.part(each.study.settings, trials) for each in (self, other)]
        n = len(self.study.settings)
        shifted = pa.array((parts[1].setting + n).astype(np.int32))
        ours, theirs = parts[0].table, parts[1].table
        theirs = theirs.set_column(theirs.column_names.index("setting"), "setting", shifted)
        names = [name for name in ours.column_names if name in theirs.column_names]
        table = pa.concat_tables([ours.select(names), theirs.select(names)])
        settings, common_seeds = (*self.study.settings, *other.study.settings), self.is_paired_with(other)
        study = dataclasses.replace(self.study, settings=settings, trials=trials, common_seeds=common_seeds)
        return Summary(study, self.provenance, table)

    def final(self, metric: str) -> Float[np.ndarray, " R"]:
        """A metric's mean over the last 5% of each run; NaN for a diverged one."""
        return finals(self.table, metric)

    def curves(self, metric: str) -> Float[np.ndarray, "R L"]:
        """One of CURVES, each point without a finished episode as the one before it; NaN once a run has diverged."""
        return curves(self.table, metric)


def check(table: pa.Table, study: Study) -> None:
    """Raise UsageError unless a table holds runs of this study, as `Summary.of_results` makes it."""
    columns.check_names(table, (*_KEYS_KEPT, *CURVES))
    setting, trial, diverged_at = (
        columns.numbers(table, name, np.int32) for name in ("setting", "trial", "diverged_at")
    )
    for name, given, n in (("setting", setting, len(study.settings)), ("trial", trial, study.trials)):
        require(((given >= 0) & (given < n)).all(), f"its {name} must be 0 to {n - 1}, as the study has {n}")
    by_run = setting.astype(np.int64) * study.trials + trial
    require((np.diff(by_run) >= 0).all(), "its rows must be sorted by setting and trial, for pairs go by their places")
    require(len(set(zip(setting.tolist(), trial.tolist(), strict=True))) == len(setting), "it has one run twice")
    require(len(setting) > 0, "it has no runs")
    at = columns.curves(table, "steps", np.int32)
    require((at[:, 0] > 0).all() and (np.diff(at) > 0).all(), "its steps must rise, from one log point to the next")
    require((diverged_at >= -1).all(), "its diverged_at are no steps")
    for name in table.column_names:
        if name in (*CURVES, *CURVES_TOO):
            columns.curves(table, name, np.float32, at.shape[1])
        elif name not in _KEYS_KEPT[:4]:
            require(name.startswith("final_"), f"it has a column {name}, which no summary has")
            columns.numbers(table, name, np.float32)
    for loss in {setting["loss"] for setting in study.settings}:
        find_loss(loss)


def finals(table: pa.Table, metric: str) -> Float[np.ndarray, " R"]:
    """The final mean of a metric of each run; NaN for a diverged one."""
    return np.asarray(table.column(f"final_{metric}").to_numpy(), np.float64)


def steps(table: pa.Table) -> Int[np.ndarray, " L"]:
    """Return the environment steps that were taken by each log point of runs that have the same ones."""
    return np.asarray(lists(table.slice(0, 1), "steps")[0])


def curves(table: pa.Table, metric: str) -> Float[np.ndarray, "R L"]:
    """A metric's curves of runs with the same log points.

    A point without a finished episode is as the one before it; once a run has diverged, they are NaN.
    """
    diverged_at = table.column("diverged_at").to_numpy()
    return fill_until(lists(table, metric).astype(np.float64), steps(table), diverged_at)


def lists(table: pa.Table, name: str) -> Shaped[np.ndarray, "R L"]:
    """A column of lists, all of one length, as a matrix."""
    column = table.column(name).combine_chunks()
    return np.asarray(column.flatten().to_numpy(zero_copy_only=False)).reshape(len(column), -1)


def _shorten(curves: Float[np.ndarray, "R L"]) -> Float[np.ndarray, "R L"]:
    """Rounded to 12 bits of mantissa, 1 part in 8,000: what noise needs, at a third of the bytes."""
    bits = np.ascontiguousarray(curves, np.float32).view(np.uint32)
    rounded = (bits + np.uint32(1 << 10)) & np.uint32(~((1 << 11) - 1) & 0xFFFFFFFF)
    return np.where(np.isfinite(curves), rounded.view(np.float32), curves).astype(np.float32)
