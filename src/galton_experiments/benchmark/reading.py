"""A benchmark's TOML file, table by table, into its protocol."""

import dataclasses
import json
import re
import tomllib
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, TypeVar

from galton.errors import UsageError, is_number, require, require_integer, require_word
from galton.fields import annotations, checked
from galton.saving import files
from galton.words import vocabulary
from galton_experiments.benchmark.priors import MOST, Priors, Record, check_names, read_table
from galton_experiments.benchmark.protocol import Budget, Method, Protocol, Selection, Task, check

TABLES = ("budget", "selection", "fixed", "prior", "anchors", "methods", "tasks")
"""The tables of a file."""
WORDS = ("title", "seed", "design", "baseline", "imports", "extends")
"""The words that stand above them."""
_OF_TASK = ("steps", "fresh_steps", "logs", "eval_episodes")
"""The fields of a budget that a task may have of its own."""
_RecordT = TypeVar("_RecordT", Budget, Selection)
Importing = Callable[[Sequence[str]], None]
"""A function that imports the modules of these names."""


def read(path: Path, importing: Importing = lambda _: None) -> Protocol:
    """The protocol in a file.

    Args:
        path: the file.
        importing: imports the modules that the file names, which may register algorithms, losses or environments; by
            default nothing, for modules are there already, or not needed to read the results.

    Raises:
        UsageError: no such file, no TOML, or what it says can't be done; the message names the place in the file.
    """
    record = load(path)
    try:
        return of_record(record, path.stem, importing)
    except UsageError as error:
        raise UsageError(f"file is {str(path)!r}: {error}") from None


def load(path: Path, before: Collection[Path] = ()) -> dict[str, Any]:
    """A file as a record; what it says at its top level stands in the place of what the file that it extends says.

    Raises:
        UsageError: it can't be read, or extends itself.
    """
    try:
        record = tomllib.loads(files.read(path, files.TEXT).decode())
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(f"file is {str(path)!r}, which can't be read as TOML: {error}") from None
    if "extends" not in record:
        return record
    other = record.pop("extends")
    require(isinstance(other, str), f"file is {str(path)!r}: extends is {other!r}; give the name of a file")
    require("\0" not in other, f"file is {str(path)!r}: extends is {other!r}; give the name of a file")
    base = path.parent / other
    require(base.resolve() not in (path.resolve(), *before), f"file is {str(path)!r}: extends leads back to itself")
    return load(base, (path.resolve(), *before)) | record


def of_record(record: Record, title: str = "benchmark", importing: Importing = lambda _: None) -> Protocol:
    """The protocol that a record describes.

    Args:
        record: the content of a file.
        title: where the record has none.
        importing: as `read` has it.

    Raises:
        UsageError: what it says can't be done.
    """
    title, seed, imports = _top_level(record, title)
    importing(imports)
    budget = _record("budget", record.get("budget", {}), Budget())
    methods = {name: _method(name, given) for name, given in _tables(record, "methods").items()}
    baseline, design = record.get("baseline", next(iter(methods))), record.get("design", "stages")
    require_word("baseline", baseline, [*methods])
    require_word("design", design, ("stages", "factorial"))
    protocol = Protocol(
        record,
        title,
        seed,
        design,
        methods[baseline],
        imports,
        budget,
        _record("selection", record.get("selection", {}), Selection()),
        read_table("fixed", record.get("fixed", {}), drawn=False),
        read_table("prior", record.get("prior", {}), drawn=True),
        _anchors("anchors", record.get("anchors", {})),
        tuple(methods.values()),
        tuple(_task(name, given, budget) for name, given in _tables(record, "tasks").items()),
    )
    check(protocol)
    return protocol


def _top_level(record: Record, title: str) -> tuple[str, int, tuple[str, ...]]:
    """Read what stands above the tables: title, seed and imports."""
    check_names("the file", record, (*WORDS, *TABLES))
    try:
        json.dumps(record)
    except TypeError as error:
        raise UsageError(f"it holds a date or a time ({error}); write words or numbers") from None
    title, seed, imports = record.get("title", title), record.get("seed", 0), record.get("imports", [])
    require(isinstance(title, str) and bool(title), f"title is {title!r}; it must be words")
    require_integer("seed", seed, 0)
    require(seed < 2**62, f"seed is {seed}; it must be less than 2⁶²")
    right = isinstance(imports, list) and all(isinstance(module, str) for module in imports)
    require(right, f"imports is {imports!r}; it must be a list of names of modules")
    return title, seed, tuple(imports)


def _tables(record: Record, name: str) -> Record:
    tables = record.get(name, {})
    require(isinstance(tables, dict) and bool(tables), f"{name} is missing; add a [{name}.NAME] table for each")
    for key in tables:
        fits = re.fullmatch(r"\w[\w.+-]*", key) is not None
        require(fits, f"{name} has {key!r}, which no file can be called; write letters, digits and hyphens alone")
    return tables


def _record(where: str, given: object, default: _RecordT) -> _RecordT:
    """A record with what a table gives of its fields."""
    kind: Any = type(default)
    known = annotations(kind)
    table = check_names(where, given, known)
    fields: dict[str, Any] = {name: checked(f"{where}.{name}", value, known[name]) for name, value in table.items()}
    return dataclasses.replace(default, **fields)


def _method(name: str, given: object) -> Method:
    where = f"methods.{name}"
    table = check_names(where, given, ("label", "fixed", "search", "anchors", "time"))
    fixed = read_table(f"{where}.fixed", table.get("fixed", {}), drawn=False)
    search = read_table(f"{where}.search", table.get("search", {}), drawn=True)
    anchors = _anchors(f"{where}.anchors", table.get("anchors", {}))
    time = None if "time" not in table else _positive(f"{where}.time", table["time"])
    return Method(name, _label(where, name, table), fixed, search, anchors, time)


def _anchors(where: str, given: object) -> dict[str, Priors]:
    """The fields of each anchor, by its name."""
    if not isinstance(given, dict):
        raise UsageError(f"{where} is {given!r}; add a [{where}.NAME] table for each")
    return {name: read_table(f"{where}.{name}", fields, drawn=False) for name, fields in given.items()}


def _positive(where: str, given: Any) -> float:
    require(is_number(given) and 0 < given < MOST, f"{where} is {given!r}; it must be a finite number above 0")
    return float(given)


def _task(name: str, given: object, budget: Budget) -> Task:
    where = f"tasks.{name}"
    table = check_names(where, given, ("label", "env", "env_kwargs", "held_out", "fixed", "scale", *_OF_TASK))
    env, kwargs, held_out = table.get("env", name), table.get("env_kwargs", {}), table.get("held_out", False)
    require(isinstance(env, str), f"{where}.env is {env!r}; it must be the name of an environment")
    require(isinstance(kwargs, dict), f"{where}.env_kwargs is {kwargs!r}; it must be a table")
    require(isinstance(held_out, bool), f"{where}.held_out is {held_out!r}; it must be true or false")
    own = {name: value for name, value in table.items() if name in _OF_TASK}
    if "steps" in own:
        own = {"fresh_steps": 0} | own
    fixed = read_table(f"{where}.fixed", table.get("fixed", {}), drawn=False)
    scale = _scale(f"{where}.scale", table.get("scale", {}))
    return Task(name, _label(where, name, table), env, kwargs, held_out, fixed, scale, _record(where, own, budget))


def _scale(where: str, given: object) -> dict[str, float]:
    """Read the factors of numbers, by field."""
    known = vocabulary()
    table = check_names(where, given, [name for name in known.usual if known.is_number(name)])
    return {name: _positive(f"{where}.{name}", value) for name, value in table.items()}


def _label(where: str, name: str, table: Record) -> str:
    label = table.get("label", name)
    right = isinstance(label, str) and len(label.splitlines()) == 1
    # between dollars figures would show formulas, and legends leave out what begins with _
    right = right and "$" not in label and not label.startswith("_")
    require(right, f"{where}.label is {label!r}; it must be words on one line, without dollar signs or a _ before them")
    return label
