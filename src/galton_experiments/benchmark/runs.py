"""The runs of a part: gathered from its sweeps into one small file, and read from it."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from jaxtyping import Float, Int

from galton.errors import require
from galton.training.train import final
from galton_experiments.benchmark.protocol import Selection
from galton_experiments.benchmark.stages import Part, Role, Stage
from galton_experiments.runs import curves, finals, steps
from galton_experiments.sweep import columns
from galton_experiments.sweep.parquet import opened, to_bytes, with_record
from galton_experiments.sweep.study import Setting, canonical

CURVES = ("judged", "training")
"""The curves that are kept of each run: the metric that it is judged by, and the training return."""
_KEYS = ("method", "role", "draw", "setting", "trial")
_SCHEMA = pa.schema(
    [("method", pa.string()), ("role", pa.string()), ("draw", pa.int32()), ("setting", pa.string())]
    + [("trial", pa.int32()), ("seed", pa.uint32()), ("diverged_at", pa.int32()), ("final_step", pa.int32())]
    + [(f"final_{name}", pa.float32()) for name in CURVES]
    + [("steps", pa.list_(pa.field("element", pa.int32())))]
    + [(name, pa.list_(pa.field("element", pa.float32()))) for name in CURVES]
)


@dataclasses.dataclass(frozen=True, eq=False)
class Runs:
    """The runs of a part: a row for each of its entries and trials, in their order."""

    part: Part
    table: pa.Table

    @property
    def stage(self) -> Stage:
        """The stage that it is a part of."""
        return self.part.stage

    @property
    def task(self) -> str:
        """The name of its task."""
        return self.part.task.name

    def finals(self, method: str, role: Role, curve: str = "judged") -> Float[np.ndarray, "rows trials"]:
        """The final mean of one of CURVES, a row for each draw of this role; NaN for a diverged run."""
        return finals(self._of(method, role), curve).reshape(-1, self.part.trials)

    def finals_at(self, method: str, share: float, last: float) -> Float[np.ndarray, "draws trials"] | None:
        """Return the number that judges each run of a method's draws, read after a share of its steps.

        It is the mean of the last part of the curve up to there; NaN for a run that has diverged by then. None if there
        is none of a run in which no episode has ended by then.
        """
        if share == 1:
            return self.finals(method, "draw")
        found = []
        for row in self._of(method, "draw").select(["steps", "judged", "diverged_at"]).to_pylist():
            n = max(1, sum(step <= share * row["steps"][-1] for step in row["steps"]))
            gone = 0 <= row["diverged_at"] <= row["steps"][n - 1]
            found.append(_final(row["judged"][:n], row["diverged_at"] if gone else -1, last))
            if np.isnan(found[-1]) and not gone:
                return None
        return np.array(found, np.float32).astype(float).reshape(-1, self.part.trials)  # as `finals` are kept

    def diverged(self, method: str, role: Role) -> int:
        """Count the runs that diverged."""
        return int((self._of(method, role)["diverged_at"].to_numpy() >= 0).sum())

    def trained(self, method: str, role: Role) -> int:
        """Environment steps of all runs together."""
        return int(self._of(method, role)["final_step"].to_numpy().sum(dtype=np.int64))

    def curves(self, method: str, role: Role) -> tuple[Int[np.ndarray, " L"], Float[np.ndarray, "runs L"]]:
        """The log points, and the curve that judges each run; NaN once it has diverged."""
        own = self._of(method, role)
        return steps(own), curves(own, "judged")

    def save(self, digest: str) -> bytes:
        """The whole file; the same bytes for the same runs."""
        return to_bytes(with_record(self.table, _record(self.part, digest)), compression_level=19)

    @classmethod
    def load(cls, data: bytes, part: Part, digest: str, where: str) -> "Runs":
        """The runs of a part in a file that `save` made.

        Raises:
            UsageError: another file, or the runs of something else.
        """

        def read(table: pa.Table, record: dict[str, Any]) -> Runs:
            _check(table, record, part, digest)
            return cls(part, table.replace_schema_metadata(None))

        return opened(data, where, read, "not what this benchmark writes", "remove it to make it again")

    def _of(self, method: str, role: Role) -> pa.Table:
        entries = [i for i, entry in enumerate(self.part.entries) if (entry.method, entry.role) == (method, role)]
        rows = np.ravel(np.array(entries, int)[:, None] * self.part.trials + np.arange(self.part.trials))
        return self.table.take(pa.array(rows))


def gather(part: Part, tables: Sequence[pa.Table], selection: Selection) -> Runs:
    """The runs of a part from the results of its studies, which are done."""
    metrics = {"judged": selection.metric, "training": "training_return"}
    names = dict.fromkeys(["setting", "trial", "seed", "diverged_at", "steps", *metrics.values()])
    by_setting: dict[Setting, list[dict[str, Any]]] = {}
    for study, table in zip(part.studies, tables, strict=True):
        for row in table.select([*names]).to_pylist():
            by_setting.setdefault(study.settings[row["setting"]], []).append(row)
    rows = [row for entry in part.entries for row in by_setting[entry.setting]]
    found: dict[str, list[Any]] = dict(zip(_KEYS, map(list, zip(*_keys(part), strict=True)), strict=True))
    found |= {name: [row[name] for row in rows] for name in ("seed", "diverged_at", "steps")}
    found["final_step"] = [row["steps"][-1] for row in rows]
    for curve, metric in metrics.items():
        found[curve] = [row[metric] for row in rows]
        finals = [_final(row[metric], row["diverged_at"], selection.last) for row in rows]
        unknown = sum(np.isnan(each) and row["diverged_at"] < 0 for each, row in zip(finals, rows, strict=True))
        told = (
            f"tasks.{part.task.name} has {unknown:,} runs in whose {rows[0]['steps'][-1]:,} steps no episode ended, so "
            "nothing judges them; give the task more steps, or selection.metric = 'evaluation_return', and another "
            "folder"
        )
        require(unknown == 0 or curve != "judged", told)
        found[f"final_{curve}"] = finals
    return Runs(part, pa.table({name: found[name] for name in _SCHEMA.names}, schema=_SCHEMA))


def _final(curve: Sequence[float], diverged_at: int, last: float) -> float:
    """The mean of the last part of a run's curve; NaN for a diverged run."""
    return float(final(np.array([curve], np.float64), np.array([diverged_at]), last)[0])


def _record(part: Part, digest: str) -> dict[str, object]:
    """Return what the file says of itself."""
    return {"benchmark": digest, "stage": part.stage, "task": part.task.name}


def _keys(part: Part) -> list[tuple[str, str, int, str, int]]:
    """Return the keys of its rows, in order: method, role, draw, setting and trial."""
    return [
        (entry.method, entry.role, entry.draw, canonical(entry.setting.record()), trial)
        for entry in part.entries
        for trial in range(part.trials)
    ]


def _check(table: pa.Table, record: dict[str, Any], part: Part, digest: str) -> None:
    """Raise UsageError unless a table has the rows of this part."""
    for name, value in _record(part, digest).items():
        require(record.get(name) == value, f"its {name} is {record.get(name)!r}, not {value!r}")
    columns.check_names(table, _SCHEMA.names)
    require(table.schema.equals(_SCHEMA), f"its columns are {table.schema.to_string(show_schema_metadata=False)}")
    keys = zip(*(table.column(name).to_pylist() for name in _KEYS), strict=True)
    require([*keys] == _keys(part), "its rows are not those that the file asks for, under this version's defaults")
