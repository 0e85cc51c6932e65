"""What is fuzzed: each reader of files, with valid ones to begin with and how they are changed.

A reader gives a value or one of ERRORS. Anything else is a finding: another exception, or what `guard` watches for.
"""

import functools
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from galton.cli._runs import known, points
from galton.deploy.card import card
from galton.envs.registry import read_constants
from galton.errors import CheckpointError, UsageError
from galton.models import Model
from galton.saving.result_folder import CONFIG, read_settings
from galton_experiments.benchmark.draws import draws, setting
from galton_experiments.benchmark.reading import read
from galton_experiments.sweep import shard
from galton_experiments.sweep.grid import read_grid
from galton_experiments.sweep.parquet import record_of
from galton_experiments.sweep.plan import FILE, Plan
from galton_experiments.sweep.results import collect
from galton_experiments.sweep.store import Store, checksum

from . import changes
from .guard import FindingError, reading_only

HERE = Path(__file__).parent
GOLDEN = HERE.parent / "golden" / "v1"
EXAMPLES = HERE.parents[1] / "examples"
ERRORS = (CheckpointError, UsageError)
"""The errors that readers of files have; NewerVersionError is a UsageError."""


class Target(NamedTuple):
    """A reader under attack."""

    read: Callable[[Path], None]
    """Reads what `place` has put into a folder, and uses what was read."""
    place: Callable[[bytes, Path], None]
    """Puts a file's bytes where the reader looks for them."""
    seeds: tuple[str, ...]
    """Valid files in tests/golden/v1, as glob patterns."""
    change: changes.Change
    """How a file becomes another that is nearly as valid."""


def _file(name: str) -> Callable[[bytes, Path], None]:
    def place(data: bytes, folder: Path) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)

    return place


def _model(folder: Path) -> None:
    model = Model.load(folder / "model.safetensors")
    assert repr(model)
    assert model.num_timesteps >= 0


def _plan(folder: Path) -> None:
    plan = Plan.load(Store(str(folder)))
    assert len(plan.names) == len(plan.firsts) == plan.n_shards
    for index in {0, plan.n_shards - 1}:
        assert len(plan.get(index).seeds) >= 1
    assert plan.study.modules is not None


@functools.cache
def _sweep() -> Plan:
    return Plan.load(Store(str(GOLDEN / "sweep")))


def _place_shard(data: bytes, folder: Path) -> None:
    shards = folder / shard.FOLDER
    shards.mkdir(exist_ok=True)
    for there in shards.iterdir():
        there.unlink()
    (shards / f"0000000-{_sweep().names[0]}-{checksum(data)}.parquet").write_bytes(data)


def _shard(folder: Path) -> None:
    store, plan = Store(str(folder)), _sweep()
    done = shard.finished(store, plan)[0]
    table = shard.read(store, done)
    assert table is not None
    assert shard.report(0, table).index == 0
    found = collect(store, plan)
    assert found.num_rows == table.num_rows
    assert record_of(found)


def _grid(folder: Path) -> None:
    settings = read_grid(folder / "grid.toml", {})
    assert len({setting.name for setting in settings}) == len(settings) > 0


def _benchmark(folder: Path) -> None:
    protocol = read(folder / "benchmark.toml")
    drawn = draws(protocol)
    for method in protocol.methods:
        assert len(drawn[method.name]) == protocol.budget.settings >= 1
        for task in protocol.tasks:
            assert setting(protocol, method, drawn[method.name][0], task, fresh=True).name


@functools.cache
def _carded() -> Model:
    return Model.load(GOLDEN / "run" / "model.safetensors")


def _place_run(data: bytes, folder: Path) -> None:
    """A line of config.json, and behind it the lines of metrics.jsonl."""
    settings, _, metrics = data.partition(b"\n")
    (folder / CONFIG).write_bytes(settings)
    (folder / "metrics.jsonl").write_bytes(metrics)


def _run(folder: Path) -> None:
    settings, log = read_settings(folder), points(folder / "metrics.jsonl")
    assert all(known(folder / "metrics.jsonl").keys() >= point.keys() for point in log)
    constants = read_constants(json.dumps(settings.get("env_kwargs", {})))
    assert isinstance(constants, dict)
    assert card(_carded(), settings, log).encode()


TARGETS = {
    "checkpoints": Target(
        _model, _file("model.safetensors"), ("checkpoints/*.safetensors", "run/*.safetensors"), changes.model
    ),
    "plans": Target(_plan, _file(FILE), (f"sweep/{FILE}",), changes.planned),
    "shards": Target(_shard, _place_shard, ("sweep/shards/0000000-*.parquet",), changes.table),
    "grids": Target(_grid, _file("grid.toml"), ("grid.toml",), changes.text),
    "benchmarks": Target(_benchmark, _file("benchmark.toml"), (), changes.text),
    "runs": Target(_run, _place_run, (), changes.documents),
}
"""The readers by the name of what they read."""


def seeds(name: str) -> list[bytes]:
    """Valid files of a target, and what was found with it, oldest first."""
    golden = [path.read_bytes() for pattern in TARGETS[name].seeds for path in sorted(GOLDEN.glob(pattern))]
    if name == "benchmarks":
        golden = [(EXAMPLES / "benchmark.toml").read_bytes()]
    if name == "runs":
        settings = re.sub(rb"\s*\n\s*", b"", (GOLDEN / "run" / CONFIG).read_bytes())
        golden = [settings + b"\n" + (GOLDEN / "run" / "metrics.jsonl").read_bytes()]
    return golden + [path.read_bytes() for path in sorted((HERE / "corpus" / name).glob("*"))]


def warm_up(name: str, folder: Path) -> None:
    """Read a valid file, so that what is loaded once is loaded: NumPy's, JAX's and Arrow's own modules."""
    TARGETS[name].place(seeds(name)[0], folder)
    TARGETS[name].read(folder)


def run(name: str, data: bytes, folder: Path) -> bool:
    """Read one input; whether it was taken for a valid file.

    Raises:
        Exception: a finding.
    """
    target = TARGETS[name]
    target.place(data, folder)
    with reading_only():
        try:
            target.read(folder)
        except ERRORS as error:
            if "\n" in str(error):
                raise FindingError(f"it said in several lines {error}") from error
            return False
    return True
