"""The columns of a table of runs that a file holds: what they must be, whoever wrote them."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pyarrow as pa
from jaxtyping import Shaped

from galton.errors import UsageError, require


def check_names(table: pa.Table, needed: Iterable[str]) -> None:
    """Raise UsageError unless all these columns are there, and none twice."""
    names = table.column_names
    twice = sorted({name for name in names if names.count(name) > 1})
    missing = [name for name in needed if name not in names]
    require(not missing, f"it has no column {', '.join(missing)}")
    require(not twice, f"it has the column {', '.join(twice)} twice")


def numbers(table: pa.Table, name: str, kind: type[np.generic]) -> Shaped[np.ndarray, " R"]:
    """A column with a number of this kind for each run; UsageError for anything else."""
    return _numpy(name, table.column(name).combine_chunks(), kind)


def curves(table: pa.Table, name: str, kind: type[np.generic], n_logs: int | None = None) -> Shaped[np.ndarray, "R L"]:
    """A column with a list for each run, of a number of this kind for each log point; UsageError for anything else.

    Args:
        table: of runs.
        name: of the column.
        kind: of the numbers.
        n_logs: how many log points there must be; None for any number.
    """
    column = table.column(name).combine_chunks()
    width = column.type.list_size if pa.types.is_fixed_size_list(column.type) else 0
    wanted = "a list for each run" if n_logs is None else f"a list of {n_logs} for each run"
    require(width > 0 and n_logs in (None, width), f"its {name} are {column.type}; they must be {wanted}")
    require(column.null_count == 0, f"its {name} are missing in {column.null_count} rows")
    return _numpy(name, column.flatten(), kind).reshape(-1, width)


def check_record(record: object, example: dict[str, Any]) -> None:
    """Raise UsageError unless a record has all that an example has, each of its type, and floats 0 or more."""
    if not isinstance(record, dict):
        raise UsageError(f"its record is {type(record).__name__}, not an object of JSON")
    for name, like in example.items():
        require(name in record, f"its record has no {name}")
        value = record[name]
        if isinstance(like, float):
            fits = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < float("inf")
        else:
            fits = isinstance(value, type(like)) and not isinstance(value, bool)
        if fits and isinstance(like, list):
            fits = all(isinstance(entry, type(like[0])) for entry in value)
        words = f"a list of {type(like[0]).__name__}" if isinstance(like, list) else type(like).__name__
        require(fits, f"its record has {name} {value!r}; it must be {words}")


def _numpy(name: str, column: Any, kind: type[np.generic]) -> np.ndarray:
    wanted = pa.from_numpy_dtype(kind)
    require(column.type == wanted, f"its {name} are {column.type}; they must be {wanted}")
    require(column.null_count == 0, f"its {name} are missing in {column.null_count} places")
    return np.asarray(column.to_numpy(zero_copy_only=False))
