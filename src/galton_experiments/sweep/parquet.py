"""Tables as the bytes of a Parquet file, each with a record of what it is."""

import io
import json
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from galton.errors import MALFORMED, NewerVersionError, UsageError, in_a_line

_RECORD = b"galton"
T = TypeVar("T")


def with_record(table: pa.Table, record: Mapping[str, object]) -> pa.Table:
    """The table with that record, and no other, in its metadata."""
    return table.replace_schema_metadata({_RECORD: json.dumps(record, sort_keys=True)})


def record_of(table: pa.Table) -> dict[str, Any]:
    """The record that `with_record` gave the table.

    Raises:
        KeyError: it has none.
        ValueError: what it has is something else.
    """
    try:
        return json.loads((table.schema.metadata or {})[_RECORD])
    except RecursionError as error:
        raise ValueError(str(error)) from None


def to_bytes(table: pa.Table, **options: object) -> bytes:
    """A whole Parquet file; the same bytes for the same table.

    Args:
        table: what to write.
        options: further ones of `pyarrow.parquet.write_table`.
    """
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd", **options)
    return buffer.getvalue()


def from_bytes(data: bytes) -> pa.Table:
    """The table in a Parquet file.

    This thread alone reads it. `pyarrow.parquet.read_table` would leave parts of the data to threads of its own, and
    where one of those lets go of them while Python ends, it aborts the process (apache/arrow, issues 33975 and 34314).

    Raises:
        pyarrow.ArrowException: the data are no Parquet file.
    """
    return pq.ParquetFile(pa.BufferReader(data)).read(use_threads=False)


def opened(data: bytes, where: str, check: Callable[[pa.Table, dict[str, Any]], T], told: str, remedy: str) -> T:
    """Return what a check makes of the table and the record in a file.

    Args:
        data: the file.
        where: its name, for messages.
        check: raises an error for what can't be used.
        told: what a file is not that it refuses.
        remedy: what is to be done about it.

    Raises:
        UsageError: no Parquet file, or one that the check refuses; the message says why.
    """
    try:
        table = from_bytes(data)
        return check(table, record_of(table))
    except NewerVersionError as error:
        raise NewerVersionError(f"{where} can't be read: {error}") from None
    except MemoryError:
        raise
    except (pa.ArrowException, OSError, *MALFORMED) as error:
        raise UsageError(f"{where} is {told}: {in_a_line(error)}; {remedy}") from None
