"""Settings and arrays in one file: safetensors, whose header carries the settings as JSON and a checksum of all.

Loading runs no code, imports nothing and makes no environment. Writing is atomic.
"""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import PyTree
from safetensors import SafetensorError
from safetensors.numpy import load, save

from galton.errors import CheckpointError, in_a_line, require
from galton.saving import files
from galton.saving.provenance import version

FORMAT = 1
"""The number of today's format; a file of a higher one is of a newer version."""
MAX_HEADER = 1 << 23
MAX_FILE = files.DATA
_LONGER = (("<f4", "<f8"), ("<i4", "<i8"))

Settings = dict[str, Any]
"""Values that JSON can hold, by name."""


def write(path: Path, settings: Settings, arrays: dict[str, np.ndarray]) -> None:
    """Put a checkpoint at path, all of it or none; UsageError if it can't be written or is more than `read` takes."""
    record = {"format": FORMAT, "galton": version(), "settings": settings}
    text = json.dumps(record | {"sha256": _digest(record, arrays)})
    content = save({name: np.asarray(array, order="C") for name, array in arrays.items()}, {"galton": text})
    require(
        len(content) <= MAX_FILE and int.from_bytes(content[:8], "little") <= MAX_HEADER,
        f"the checkpoint is too large: {len(content):,} bytes of at most {MAX_FILE:,}, "
        f"{len(text):,} of settings of about {MAX_HEADER:,}; make the networks or spaces smaller",
    )
    with files.named("path", path):
        files.write(path, content)


def read(path: Path) -> tuple[Settings, dict[str, np.ndarray]]:
    """The settings and the arrays that `write` put into a file.

    Raises:
        UsageError: no such file.
        CheckpointError: a file whose settings or arrays are not, bit for bit, what `write` wrote.
    """
    require(path.exists(), f"path is {path}, which does not exist")
    try:
        content = files.read(path, MAX_FILE)
        if content.startswith(b"PK"):
            raise CheckpointError("it is a zip, as Stable-Baselines3 writes, which holds no model of Galton's")
        length = int.from_bytes(content[:8], "little")
        if len(content) < 8 or length > min(MAX_HEADER, len(content) - 8):
            raise CheckpointError("its header is cut off or too long")
        record = json.loads(json.loads(content[8 : 8 + length])["__metadata__"]["galton"])
        _check_format(record)
        arrays = load(content)  # which are all that is behind the header
        digest = record.pop("sha256")
        if _digest(record, arrays) != digest:
            raise CheckpointError("its checksum is wrong: the file was damaged or changed")
        if not isinstance(record["settings"], dict):
            raise CheckpointError("its settings are missing")
    except CheckpointError as error:
        raise CheckpointError(f"{path} can't be loaded: {error}") from None
    except OSError as error:
        raise CheckpointError(f"{path} can't be loaded: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, SafetensorError) as error:
        raise CheckpointError(f"{path} is not a checkpoint of Galton's: {in_a_line(error)}") from None
    return record["settings"], arrays


def _check_format(record: Settings) -> None:
    """Raise unless this version reads files of the record's format.

    What a newer version wrote may have its checksum elsewhere, so this is asked first.
    """
    if not isinstance(record["format"], int) or record["format"] < FORMAT:
        raise CheckpointError(f"its format is {record['format']!r}; this version reads {FORMAT}")
    if record["format"] > FORMAT:
        writer = str(record.get("galton", "not known"))[:40]
        raise CheckpointError(
            f"it was written by a newer version of Galton ({writer}, format {record['format']}); this one is "
            f"{version()}, which reads format {FORMAT}: upgrade Galton to load it"
        )


def flatten(tree: PyTree) -> dict[str, np.ndarray]:
    """The arrays of a pytree by their place in it, such as actor/0/kernel.

    What numpy has no type for, bfloat16 and shorter ones, is in float32, which holds it exactly.
    """
    found = {_name(path): np.asarray(leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(tree)}
    return {name: leaf.astype(np.float32) if leaf.dtype.kind == "V" else leaf for name, leaf in found.items()}


def unflatten(arrays: dict[str, np.ndarray], like: PyTree) -> PyTree:
    """Undo `flatten`, into the structure, shapes and types of `like`; CheckpointError where an array differs.

    Where 64 bits are wanted 32 will do, which observations and counts of steps had in earlier files.
    """
    leaves, structure = jax.tree_util.tree_flatten_with_path(like)
    told = []
    for path, leaf in leaves:
        found = arrays.get(_name(path))
        wanted = (leaf.shape, np.dtype(leaf.dtype))
        if found is not None:
            is_short = found.dtype == np.float32 and wanted[1].kind == "V"
            found = found.astype(wanted[1]) if is_short or (found.dtype.str, wanted[1].str) in _LONGER else found
        if found is None or (found.shape, found.dtype) != wanted:
            there = "missing" if found is None else f"{found.shape} {found.dtype}"
            raise CheckpointError(f"{_name(path)} in the checkpoint is {there}; its settings call for {wanted}")
        told.append(found)
    return jax.tree.unflatten(structure, told)


_LEARNT = re.compile(r"run/learner/(params|optimizer|normalizer)/")
_NEVER_NEGATIVE = re.compile(r"run/learner/(optimizer/(\d+/)*(nu|count)(/.*)?|normalizer/.*/(variance|n))")


def check_numbers(arrays: dict[str, np.ndarray]) -> None:
    """Raise CheckpointError unless what was learnt is finite, and 0 or more where it counts or is a mean square.

    What parts of a user's own call their parameters, and what they remember, is theirs.
    """
    for name, array in arrays.items():
        if _LEARNT.match(name) and array.dtype.kind in "fiu":
            signed = not _NEVER_NEGATIVE.fullmatch(name)
            wrong = ~np.isfinite(array) if signed else ~(np.isfinite(array) & (array >= 0))
            if wrong.any():
                wanted = "finite" if signed else "finite, and 0 or more"
                raise CheckpointError(f"{name} in the checkpoint holds {array[wrong][0]}; it must be {wanted}")


def _name(path: tuple[object, ...]) -> str:
    return jax.tree_util.keystr(path, simple=True, separator="/")


def _digest(record: Settings, arrays: dict[str, np.ndarray]) -> str:
    digest = hashlib.sha256(json.dumps(record, sort_keys=True).encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(json.dumps([name, array.dtype.str, array.shape]).encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
