"""Dask as what carries shards: the workers of a scheduler that runs."""

import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor
from pathlib import Path

from galton.errors import UsageError, require
from galton.extras import needed

with needed("a scheduler", "distributed"):
    import distributed

PATIENCE = 10
"""Seconds to wait for a scheduler that is said to run."""
LOST = (distributed.scheduler.KilledWorker, CancelledError, distributed.client.FutureCancelledError)
"""The errors that a future raises whose workers died."""


@contextlib.contextmanager
def connect(address: str, tls: Path | None = None) -> Iterator[tuple[Executor, Callable[[], int]]]:
    """Connect to a scheduler that runs: an executor, and a function that says how many shards it can work on now.

    Each thread of the scheduler's workers is one place.

    Args:
        address: such as tcp://host:8786, or tls://.
        tls: a folder with ca.pem, cert.pem and key.pem.

    Raises:
        UsageError: no scheduler answers there, or a file is missing.
    """
    keys = security(tls)
    require(
        tls is None or address.startswith("tls://"), f"scheduler is {address!r}; with tls it must begin with tls://"
    )
    try:
        client = distributed.Client(address, security=keys, timeout=PATIENCE)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        raise UsageError(f"scheduler is {address!r}, where none answers: {error}") from None

    def width() -> int:
        try:
            return sum(client.nthreads().values())
        except OSError as error:
            raise UsageError(
                f"scheduler is {client.scheduler.address}, which no longer answers ({error}); start it and run the "
                "same command again, which goes on where this one stopped"
            ) from None

    with client:
        yield client.get_executor(pure=False), width


def security(folder: Path | None) -> distributed.Security | None:
    """Return the keys in a folder, if one is given; UsageError for those that are missing."""
    if folder is None:
        return None
    files = {name: folder / f"{name}.pem" for name in ("ca", "cert", "key")}
    for path in files.values():
        require(path.is_file(), f"tls is {folder}, which holds no {path.name}; it needs ca.pem, cert.pem and key.pem")
    roles = ("client", "scheduler", "worker")
    pairs = {f"tls_{role}_{name}": str(files[name]) for role in roles for name in ("cert", "key")}
    return distributed.Security(require_encryption=True, tls_ca_file=str(files["ca"]), **pairs)
