"""Tables as the bytes of a Parquet file, each with a record of what it is."""

import io
import json
from collections.abc import Mapping
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

_RECORD = b"galton"


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
