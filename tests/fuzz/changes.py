"""Files as strangers might write them: a valid one with something changed, behind a checksum that is right again.

Each function takes the bytes of a file and a random.Random, and gives the bytes of another.
"""

import json
import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
from safetensors.numpy import load, save

from galton.saving import checkpoint
from galton_experiments.sweep import plan
from galton_experiments.sweep.parquet import from_bytes, record_of, to_bytes

from ..mutations import MUTATIONS, replaced

Change = Callable[[bytes, random.Random], bytes]
NUMBERS = (0, 1, -1, 2, 0.5, -0.0, 1e308, -1e308, 5e-324, 10**9, 2**31, -(2**31) - 1, 2**32, 2**63, 10**30)
ODD: list[Any] = [
    *(None, True, False, *NUMBERS, *map(float, ("nan", "inf", "-inf"))),
    *("", "x", "0", "nan", "..", "../../x", "/etc/passwd", "a\0b", "\ud800"),
    *("x" * 300, "os:system", "evil:Env-v0", "gaussian", "hl-gauss", "ppo", "a2c", "ordinal", "CON", "<b>", "{step}"),
    *([], {}, [None], [[]], [[[8]]], {"": 0}, ["x"] * 3, [0] * 50, [1, 2.5, "3"], {"Box": []}, [10**9, 10**9]),
]
RAW = (b"", b"\0", b"\xff" * 8, b"\xff\xff\xff\x7f", b"PAR1", b"{", b"[" * 2000, b'"', b"\\u0000", b"NaN")


def raw(data: bytes, draw: random.Random) -> bytes:
    """A few bytes replaced, taken out, put in, repeated or cut off."""
    content = bytearray(data)
    for _ in range(draw.choice([1, 1, 2, 4, 16])):
        start = draw.randrange(len(content) + 1)
        stop = min(len(content), start + draw.choice([0, 1, 2, 4, 8, 64]))
        new: bytes = draw.choice([draw.randbytes(stop - start), draw.choice(RAW), bytes(content[start:stop]) * 2, b""])
        content[start:stop] = new
    return bytes(content[: draw.randrange(len(content) + 1)] if draw.random() < 0.1 else content)


def value(given: Any, draw: random.Random) -> Any:
    """A value of JSON with one part of it changed, wherever that is."""
    if isinstance(given, dict | list) and given and draw.random() < 0.85:
        keys = list(given) if isinstance(given, dict) else list(range(len(given)))
        key = draw.choice(keys)
        changed = dict(given) if isinstance(given, dict) else list(given)
        kind = draw.random()
        if kind < 0.1:
            del changed[key]
        elif kind < 0.15 and isinstance(changed, list):
            changed.insert(key, draw.choice([*changed, *ODD]))
        elif kind < 0.15:
            changed[draw.choice([*keys, "x", "", "policy"])] = draw.choice([*changed.values(), *ODD])
        elif kind < 0.25:
            changed[key] = changed[draw.choice(keys)]
        else:
            changed[key] = value(changed[key], draw)
        return changed
    if isinstance(given, int | float) and not isinstance(given, bool) and draw.random() < 0.5:
        return draw.choice([given + 1, given - 1, -given, given * 10, given * 1000, float(given), str(given), [given]])
    return draw.choice([*ODD, [given], {"x": given}])


def model(data: bytes, draw: random.Random) -> bytes:
    """A checkpoint with another setting or another array, and the checksum of what it then holds."""
    if draw.random() < 0.25:
        return raw(data, draw)
    try:
        arrays = load(data)
        record = json.loads(json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]["galton"])
        record.pop("sha256", None)
    except Exception:  # an earlier change spoilt it
        return raw(data, draw)
    kind = draw.random()
    if kind < 0.1:
        record = value(record, draw)
    elif kind < 0.75:
        record |= {"settings": value(record.get("settings"), draw)}
    else:
        arrays = _other_arrays(arrays, draw)
    try:
        arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        return save(arrays, {"galton": json.dumps(record | {"sha256": checkpoint._digest(record, arrays)})})
    except Exception:  # what no file can hold
        return raw(data, draw)


def _other_arrays(arrays: dict[str, np.ndarray], draw: random.Random) -> dict[str, np.ndarray]:
    found = dict(arrays)
    if not found:
        return {"x": np.zeros(3, np.float32)}
    name = draw.choice(sorted(found))
    array = found[name]
    kind = draw.randrange(7)
    if kind == 0:
        del found[name]
    elif kind == 1:
        found[draw.choice([*sorted(found), "x", "environments/length", "run/learner/params/actor/9/kernel"])] = array
    elif kind == 2:
        found[name] = array[None] if draw.random() < 0.5 else array.ravel()
    elif kind == 3:
        found[name] = array[: draw.randrange(len(array) + 1)] if array.ndim else np.repeat(array, 2)
    elif kind == 4:
        with np.errstate(all="ignore"):
            found[name] = array.astype(draw.choice([np.float64, np.float16, np.int8, np.int64, np.uint8, np.bool_]))
    elif array.size:
        flat = array.copy().reshape(-1)
        with np.errstate(all="ignore"):
            odd = np.array([0, -1, 1e30, -1e30, 127, np.nan, np.inf]).astype(array.dtype)
        flat[draw.randrange(array.size)] = draw.choice(odd.tolist())
        found[name] = flat.reshape(array.shape)
    return found


def table(data: bytes, draw: random.Random) -> bytes:
    """A Parquet file with another record, another column or other numbers."""
    if draw.random() < 0.4:
        return raw(data, draw)
    try:
        found = from_bytes(data)
        kind = draw.random()
        if kind < 0.5:
            found = _other_record(found, draw)
        elif kind < 0.8:
            found = draw.choice(MUTATIONS)(found, np.random.default_rng(draw.randrange(2**32)))
        else:
            found = _other_number(found, draw)
        return to_bytes(found)
    except Exception:  # an earlier change spoilt it, or it has not what this change is of
        return raw(data, draw)


def planned(data: bytes, draw: random.Random) -> bytes:
    """What `table` makes of a plan, with the digest of what it then holds."""
    changed = table(data, draw)
    try:
        found = from_bytes(changed)
        whole = record_of(found)
        whole["digest"] = plan._digest(whole["plan"], found)
        return to_bytes(found.replace_schema_metadata({b"galton": json.dumps(whole)}))
    except Exception:  # it is no plan any more
        return changed


def _other_record(found: pa.Table, draw: random.Random) -> pa.Table:
    record = json.loads((found.schema.metadata or {}).get(b"galton", b"{}"))
    return found.replace_schema_metadata({b"galton": json.dumps(value(record, draw))})


def _other_number(found: pa.Table, draw: random.Random) -> pa.Table:
    name = draw.choice(found.column_names)
    column = found.column(name)
    values = column.to_pylist()
    row = draw.randrange(len(values))
    values[row] = draw.choice([0, -1, 1, 7, 2**31 - 1, -(2**31), None, values[0]])
    return replaced(found, name, pa.array(values, column.type))


def text(data: bytes, draw: random.Random) -> bytes:
    """Text with a line repeated or taken out, or a word put in the place of another."""
    if draw.random() < 0.4:
        return raw(data, draw)
    lines = data.split(b"\n")
    i = draw.randrange(len(lines))
    kind = draw.randrange(4)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(draw.randrange(len(lines) + 1), lines[i])
    else:
        name, equals, given = lines[i].partition(b"=" if b"=" in lines[i] else b":")
        odd = json.dumps(draw.choice(ODD)).encode()
        new = [odd, b"[" + b", ".join([given.strip() or odd] * draw.choice([2, 30])) + b"]", given + odd, b"1979-05-27"]
        lines[i] = name + equals + draw.choice(new)
    return b"\n".join(lines)


def documents(data: bytes, draw: random.Random) -> bytes:
    """Lines of JSON, one of them with something changed."""
    if draw.random() < 0.3:
        return text(data, draw)
    lines = data.split(b"\n")
    i = draw.randrange(len(lines))
    try:
        lines[i] = json.dumps(value(json.loads(lines[i]), draw)).encode()
    except (ValueError, RecursionError):
        return raw(data, draw)
    return b"\n".join(lines)
