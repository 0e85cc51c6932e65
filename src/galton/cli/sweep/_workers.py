"""Who trains a sweep: processes on this machine, or workers of a Dask scheduler or of a batch system."""

import contextlib
import dataclasses
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import tyro

from galton.errors import require, require_integer
from galton.sweep.engine import CarryOut
from galton.sweep.executors import Place, one_per_core, one_per_gpu
from galton.sweep.store import Store
from galton.sweep.view import carry, workers


@dataclasses.dataclass(frozen=True)
class Workers:
    """Who trains: processes on this machine, or the workers of a scheduler or a cluster."""

    workers: int | None = None
    """Processes, by default one per core."""
    gpus: int = 0
    """A process for each of so many CUDA devices instead; give a --shard-width of thousands with it."""
    scheduler: str | None = None
    """A Dask scheduler that runs, such as tls://host:8786: its workers train, instead of processes here."""
    cluster: Annotated[Literal["htcondor", "slurm", "pbs"] | None, tyro.conf.arg(metavar="{htcondor,slurm,pbs}")] = None
    """A batch system to start such workers with, from a login node."""
    jobs: int = 10
    """How many of them; each is one core."""
    walltime: str = "12:00:00"
    """How long each job may run."""
    memory: str = "2GB"
    """How much memory each job gets."""
    directives: tuple[str, ...] = ()
    """Further lines for the batch system, such as its account; for HTCondor NAME=VALUE."""
    tls: Path | None = None
    """A folder with ca.pem, cert.pem and key.pem: encrypt and authenticate all that goes to workers and back."""

    @property
    def far(self) -> bool:
        """Whether they are anywhere else than in processes of this command."""
        return bool(self.scheduler or self.cluster)

    def check(self) -> None:
        """Raise UsageError for options that don't go together, and for what they need and is not installed."""
        require(
            not (self.scheduler and self.cluster),
            f"scheduler is {self.scheduler!r} and cluster {self.cluster!r}; give one of them",
        )
        here = "processes here, without"
        go_with(self, ("workers",), not (self.gpus or self.far), f"{here} gpus, scheduler or cluster")
        go_with(self, ("gpus",), not self.far, f"{here} scheduler or cluster")
        go_with(self, ("tls",), self.far, "a scheduler or a cluster")
        go_with(self, ("jobs", "walltime", "memory", "directives"), self.cluster is not None, "a cluster")
        self.places()
        right = re.fullmatch(r"\d+:\d\d:\d\d", self.walltime) is not None
        require(right, f"walltime is {self.walltime!r}; write 12:00:00")
        for line in self.directives:
            right = self.cluster != "htcondor" or "=" in line
            require(right, f"directives holds {line!r}; for HTCondor each is NAME=VALUE")
        if self.far:
            require_integer("jobs", self.jobs, 1)
            importlib.import_module("galton.sweep.cluster").check(self.cluster, self.tls)

    def places(self) -> list[Place]:
        """Where the processes of this machine live."""
        return one_per_gpu(self.gpus) if self.gpus else one_per_core(self.workers)

    @contextlib.contextmanager
    def hired(self, store: Store) -> Iterator[CarryOut]:
        """The workers for a while: a function that has them carry plans out, one after the other."""
        if not self.far:
            with workers(self.places()) as carry_out:
                yield carry_out
            return
        from galton.sweep import cluster

        if self.scheduler:
            hired = cluster.connect(self.scheduler, self.tls)
        else:
            jobs = cluster.Jobs(self.jobs, self.walltime, self.memory, self.directives)
            hired = cluster.start(str(self.cluster), jobs, store.local or Path.cwd(), self.tls)
        with hired as (executor, width):
            yield lambda store, plan: carry(Store(store.absolute), plan, executor, width, cluster.LOST)


def go_with(options: object, names: tuple[str, ...], they_do: bool, what: str) -> None:
    """Raise UsageError where one of these options was given and does not go with the others."""
    for name in names:
        value = getattr(options, name)
        require(they_do or value == getattr(type(options), name), f"{name} is {value}; it goes with {what}")
