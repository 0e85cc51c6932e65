"""The run that a command was given, a run folder of `galton train` or the file of a model, and its log points.

A killed process or a full disk can have left half a line in the file of log points.
"""

import json
import math
import sys
from pathlib import Path

from galton.cli._reading import search_here
from galton.envs.registry import module_of, read_constants
from galton.errors import UsageError, require
from galton.saving import files
from galton.saving.model_file import existing
from galton.saving.result_folder import CONFIG, MODEL, read_settings

STEP = "time/total_timesteps"


def model_of(run: Path) -> Path:
    """The model's file in a run folder, or the file that was named; UsageError where there is none."""
    try:
        if not run.is_dir():
            file = existing(run)
            require(file.exists(), f"run is {run}, which does not exist")
            return file
        there = (run / MODEL).exists()
    except OSError as error:
        raise UsageError(f"run is {run}, which can't be read: {error.strerror}") from None
    require(there, f"run is {run}, which holds no {MODEL}; name a run folder of `galton train`, or a saved model")
    return run / MODEL


def environment_of(file: Path, env: str | None, env_kwargs: str | None) -> tuple[str, dict[str, object]]:
    """The given id and keyword arguments, or those of the run beside a model; UsageError where they are not known."""
    beside, known = file.with_name(CONFIG), {} if None not in (env, env_kwargs) else _settings_beside(file)
    name = known.get("env") if env is None else env
    require(name is not None, f"env is not known: there is no {CONFIG} beside {file}; give --env")
    if not isinstance(name, str):
        raise UsageError(f"env is {name!r} in {beside}; it must be a name")
    require(
        env is not None or not module_of(name),
        f"env is {name} in {beside}, which imports a module; give it with --env if you trust it",
    )
    if module_of(name):
        search_here()
    return name, read_constants(json.dumps(known.get("env_kwargs", {})) if env_kwargs is None else env_kwargs)


def _settings_beside(file: Path) -> dict[str, object]:
    try:
        return read_settings(file.parent)
    except UsageError as error:
        raise UsageError(f"{error}; give --env and --env-kwargs (as '{{}}' where there are none)") from None


def known(path: Path) -> dict[str, float]:
    """The last number of each metric that was written down."""
    return {name: value for point in points(path) for name, value in point.items()}


def points(path: Path) -> list[dict[str, float]]:
    """The known numbers of each log point, in order; broken lines are passed over."""
    return [point for line in _lines(path) if (point := _point(line))]


def forget_after(step: int, path: Path) -> None:
    """Drop what was logged after this step, the last that was saved: it is trained again. So are broken lines."""
    lines = _lines(path)
    points = [(line, point) for line in lines if (point := _point(line))]
    if broken := len(lines) - len(points):
        print(f"galton: {broken:,} of {len(lines):,} lines in {path} are no log points, and left out", file=sys.stderr)
    files.write(path, b"".join(line + b"\n" for line, point in points if point[STEP] <= step))


def _lines(path: Path) -> list[bytes]:
    try:
        return files.read(path, files.DATA).splitlines()
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise UsageError(f"{path} can't be read: {error.strerror or error}") from None


def _point(line: bytes) -> dict[str, float]:
    """The numbers of a log point that are known; none where the line is something else."""
    try:
        found = {name: value for name, value in json.loads(line).items() if value is not None}
        right = all(type(value) in (int, float) and math.isfinite(value) for value in found.values())
    except (ValueError, AttributeError, OverflowError, RecursionError):
        return {}
    return {name: float(value) for name, value in found.items()} if right and STEP in found else {}
