"""Who trains a sweep: processes on this machine, or workers of a Dask scheduler."""

import contextlib
import dataclasses
import importlib
from collections.abc import Iterator
from pathlib import Path

from galton.errors import require
from galton_experiments.sweep.engine import CarryOut
from galton_experiments.sweep.executors import Place, one_per_core, one_per_gpu
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.view import carry, workers


@dataclasses.dataclass(frozen=True)
class Workers:
    """Who trains: processes on this machine, or the workers of a scheduler."""

    workers: int | None = None
    """Processes, by default one per core."""
    gpus: int = 0
    """A process for each of so many CUDA devices instead; give a --shard-width of thousands with it."""
    scheduler: str | None = None
    """A Dask scheduler that runs, such as tls://host:8786: its workers train, instead of processes here."""
    tls: Path | None = None
    """A folder with ca.pem, cert.pem and key.pem: encrypt and authenticate all that goes to workers and back."""

    def check(self) -> None:
        """Raise UsageError for options that don't go together, and for what they need and is not installed."""
        here, far = "processes here, without", self.scheduler is not None
        go_with(self, "workers", not (self.gpus or far), f"{here} gpus or scheduler")
        go_with(self, "gpus", not far, f"{here} scheduler")
        go_with(self, "tls", far, "a scheduler")
        self.places()
        if far:
            importlib.import_module("galton_experiments.sweep.cluster").security(self.tls)

    def places(self) -> list[Place]:
        """Return the places where the processes of this machine live."""
        return one_per_gpu(self.gpus) if self.gpus else one_per_core(self.workers)

    @contextlib.contextmanager
    def hired(self) -> Iterator[CarryOut]:
        """The workers for a while: a function that has them carry plans out, one after the other."""
        if self.scheduler is None:
            with workers(self.places()) as carry_out:
                yield carry_out
            return
        from galton_experiments.sweep import cluster

        with cluster.connect(self.scheduler, self.tls) as (executor, width):
            yield lambda store, plan: carry(Store(store.absolute), plan, executor, width, cluster.LOST)


def go_with(options: object, name: str, they_do: bool, what: str) -> None:
    """Raise UsageError where this option was given and does not go with the others."""
    value = getattr(options, name)
    require(they_do or value == getattr(type(options), name), f"{name} is {value}; it goes with {what}")
