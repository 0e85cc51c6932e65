"""Dask as what carries shards: a scheduler that runs, or one started here whose workers a batch system starts."""

import contextlib
import dataclasses
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor
from pathlib import Path
from typing import NamedTuple

from galton.errors import UsageError, require, require_integer
from galton.extras import needed

with needed("a cluster", "dask_jobqueue", "distributed"):
    import dask_jobqueue
    import distributed

CLUSTERS = {
    "htcondor": dask_jobqueue.HTCondorCluster,
    "slurm": dask_jobqueue.SLURMCluster,
    "pbs": dask_jobqueue.PBSCluster,
}
PATIENCE = 10
"""Seconds to wait for a scheduler that is said to run."""
LOST = (distributed.scheduler.KilledWorker, CancelledError, distributed.client.FutureCancelledError)
"""The errors that a future raises whose workers died."""


class Jobs(NamedTuple):
    """What each job of a batch system asks for. It is one worker on one core."""

    n: int
    walltime: str
    """How long each job may run, in hours, minutes and seconds, as in 12:00:00."""
    memory: str
    """How much memory each job gets, such as 2GB."""
    directives: tuple[str, ...] = ()
    """Further lines for the batch system: its account, its queue."""


class Carrier(NamedTuple):
    """An executor, and a function that says how many shards it can work on now."""

    executor: Executor
    width: Callable[[], int]


def check(kind: str | None, tls: Path | None) -> None:
    """Raise UsageError for a batch system that this machine can't submit to, and for keys that are missing."""
    if kind is not None:
        require(kind in CLUSTERS, f"cluster is {kind!r}; choose from {', '.join(CLUSTERS)}")
        command = CLUSTERS[kind].job_cls.submit_command
        told = f"cluster is {kind!r}, but this machine has no {command}; run the command on a login node, or give "
        require(shutil.which(command) is not None, told + "--scheduler with the address of a Dask scheduler")
    if tls is not None:
        _security(tls)


@contextlib.contextmanager
def connect(address: str, tls: Path | None = None) -> Iterator[Carrier]:
    """Connect to a scheduler that runs; each thread of its workers is one place.

    Args:
        address: such as tcp://host:8786, or tls://.
        tls: a folder with ca.pem, cert.pem and key.pem.

    Raises:
        UsageError: no scheduler answers there, or a file is missing.
    """
    security = None if tls is None else _security(tls)
    require(
        tls is None or address.startswith("tls://"), f"scheduler is {address!r}; with tls it must begin with tls://"
    )
    try:
        client = distributed.Client(address, security=security, timeout=PATIENCE)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        raise UsageError(f"scheduler is {address!r}, where none answers: {error}") from None
    with client:
        yield _carrier(client)


@contextlib.contextmanager
def start(kind: str, jobs: Jobs, folder: Path, tls: Path | None = None) -> Iterator[Carrier]:
    """Start a scheduler in this process, and jobs of a batch system for its workers; jobs that end are started again.

    Args:
        kind: a key of CLUSTERS.
        jobs: what to ask for.
        folder: for the jobs' logs.
        tls: as for `connect`; the workers must see the folder under the same path.

    Raises:
        UsageError: an unknown batch system, or one that this machine can't submit to.
    """
    check(kind, tls)
    require_integer("jobs", jobs.n, 1)
    options, submitted = job_options(kind, jobs, folder), Submitted()
    job, security = _noting(CLUSTERS[kind].job_cls, submitted), None if tls is None else _security(tls)
    try:
        cluster = CLUSTERS[kind](job_cls=job, security=security, **options)
    except (OSError, RuntimeError, ValueError) as error:
        raise UsageError(f"cluster is {kind!r}, which can't be started here: {error}") from None
    with cluster, distributed.Client(cluster) as client:
        cluster.adapt(minimum_jobs=jobs.n, maximum_jobs=jobs.n)
        carrier = _carrier(client)

        def width() -> int:
            none_came = len(submitted.refusals) >= jobs.n and not submitted.n_taken
            require(not none_came, f"cluster is {kind!r}, which took no job: {' '.join(submitted.refusals[:1])}")
            return carrier.width()

        yield Carrier(carrier.executor, width)


@dataclasses.dataclass
class Submitted:
    """What a batch system said to the jobs that it was given."""

    n_taken: int = 0
    refusals: list[str] = dataclasses.field(default_factory=list)
    """The last line of each refusal, which says why."""


def _noting(job: type, submitted: Submitted) -> type:
    """This kind of job, which notes how it was received; Dask itself would log a refusal and wait for ever."""

    class Job(job):  # type: ignore[misc]
        async def start(self) -> None:
            try:
                await super().start()
                submitted.n_taken += 1
            except (OSError, RuntimeError, ValueError) as error:
                await distributed.deploy.spec.ProcessInterface.start(self)
                submitted.refusals.append((str(error).strip() or type(error).__name__).splitlines()[-1])

        async def close(self) -> None:
            await super().close()
            self.status = distributed.Status.closed

    return Job


def job_options(kind: str, jobs: Jobs, folder: Path) -> dict[str, object]:
    """The arguments of dask-jobqueue for one worker of one thread per job."""
    options: dict[str, object] = {
        "cores": 1,
        "processes": 1,
        "memory": jobs.memory,
        "log_directory": str(folder / "logs"),
        "death_timeout": 600,
        "scheduler_options": {"dashboard": False},
        "job_extra_directives": list(jobs.directives),
    }
    if kind == "htcondor":
        hours, minutes, seconds = map(int, jobs.walltime.split(":"))
        limit = (hours * 60 + minutes) * 60 + seconds
        extra = dict(line.split("=", 1) for line in jobs.directives)
        over = f"JobStatus == 2 && time() - EnteredCurrentStatus > {limit}"  # HTCondor has no walltime of its own
        return options | {"disk": "1GB", "job_extra_directives": {"periodic_remove": over} | extra}
    return options | {"walltime": jobs.walltime}


def _carrier(client: distributed.Client) -> Carrier:
    def width() -> int:
        try:
            return sum(client.nthreads().values())
        except OSError as error:
            raise UsageError(
                f"scheduler is {client.scheduler.address}, which no longer answers ({error}); start it and run the "
                "same command again, which goes on where this one stopped"
            ) from None

    return Carrier(client.get_executor(pure=False), width)


def _security(folder: Path) -> distributed.Security:
    files = {name: folder / f"{name}.pem" for name in ("ca", "cert", "key")}
    for path in files.values():
        require(path.is_file(), f"tls is {folder}, which holds no {path.name}; it needs ca.pem, cert.pem and key.pem")
    roles = ("client", "scheduler", "worker")
    pairs = {f"tls_{role}_{name}": str(files[name]) for role in roles for name in ("cert", "key")}
    return distributed.Security(require_encryption=True, tls_ca_file=str(files["ca"]), **pairs)
