"""Tables as strangers might write them: a valid one with something changed, by a seed."""

import json

import numpy as np
import pyarrow as pa


def replaced(table, name, column):
    return table.set_column(table.column_names.index(name), name, column)


def drop(table, draw):
    return table.drop_columns([str(draw.choice(table.column_names))])


def rename(table, draw):
    names = list(table.column_names)
    names[draw.integers(len(names))] = "other"
    return table.rename_columns(names)


def twice(table, draw):
    name = str(draw.choice(table.column_names))
    return table.append_column(name, table.column(name))


def text(table, draw):
    name = str(draw.choice(table.column_names))
    return replaced(table, name, pa.array([f"<{i}>" for i in range(table.num_rows)]))


def objects(table, draw):
    name = str(draw.choice(table.column_names))
    return replaced(table, name, pa.array([{"a": i} for i in range(table.num_rows)]))


def missing(table, draw):
    name = str(draw.choice(table.column_names))
    values = table.column(name).to_pylist()
    values[draw.integers(len(values))] = None
    return replaced(table, name, pa.array(values, table.column(name).type))


def longer_lists(table, draw):
    lists = [field.name for field in table.schema if pa.types.is_fixed_size_list(field.type)]
    name = str(draw.choice(lists))
    values = np.array(table.column(name).to_pylist())
    wide = np.concatenate([values, values[:, -1:]], 1)
    return replaced(table, name, pa.FixedSizeListArray.from_arrays(pa.array(wide.ravel()), wide.shape[1]))


def ragged_lists(table, draw):
    lists = [field.name for field in table.schema if pa.types.is_fixed_size_list(field.type)]
    name = str(draw.choice(lists))
    values = table.column(name).to_pylist()
    values[0] = values[0][:-1]
    return replaced(table, name, pa.array(values))


def flat(table, draw):
    lists = [field.name for field in table.schema if pa.types.is_fixed_size_list(field.type)]
    name = str(draw.choice(lists))
    return replaced(table, name, pa.array([row[0] for row in table.column(name).to_pylist()]))


def wrong_number(table, draw):
    name = str(draw.choice(["setting", "trial", "diverged_at"]))
    values = table.column(name).to_pylist()
    values[draw.integers(len(values))] = int(draw.choice([99, -2, -1000, 2**31 - 1]))
    return replaced(table, name, pa.array(values, table.column(name).type))


def floats(table, draw):
    name = str(draw.choice(["setting", "trial", "diverged_at"]))
    return replaced(table, name, pa.array([value + 0.5 for value in table.column(name).to_pylist()]))


def one_run_twice(table, draw):
    return table.take([0, *range(table.num_rows)])


def steps_that_fall(table, draw):
    values = np.array(table.column("steps").to_pylist(), np.int32)[:, ::-1]
    lists = pa.FixedSizeListArray.from_arrays(pa.array(np.ascontiguousarray(values).ravel()), values.shape[1])
    return replaced(table, "steps", lists)


def no_rows(table, draw):
    return table.slice(0, 0)


def no_record(table, draw):
    return table.replace_schema_metadata(None)


def another_record(table, draw):
    content = draw.choice(["", "[]", "null", "7", '"x"', "{}", "{", "[" * 5000, '{"study": 1, "shard": 2}'])
    return table.replace_schema_metadata({b"galton": str(content)})


def part_of_the_record(table, draw):
    """One entry, wherever in the record, gone or of another type."""
    record = json.loads(table.schema.metadata[b"galton"])
    place = record
    while True:
        key = str(draw.choice(sorted(place))) if isinstance(place, dict) else int(draw.integers(len(place)))
        deeper = place[key]
        if not isinstance(deeper, dict | list) or not deeper or draw.integers(3) == 0:
            break
        place = deeper
    if draw.integers(2):
        del place[key]
    else:
        place[key] = [None, "x", -7.5, [], {}, [["x"]], {"x": 1}, 10**30, True, "NaN"][draw.integers(10)]
    return table.replace_schema_metadata({b"galton": json.dumps(record, sort_keys=True)})


MUTATIONS = [value for value in list(vars().values()) if callable(value) and value is not replaced]
