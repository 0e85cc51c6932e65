"""The file of a run's log points, as it may be found: a killed process or a full disk can have left half a line."""

import json
import math
import sys
from pathlib import Path

from galton.errors import UsageError
from galton.saving import files

STEP = "time/total_timesteps"


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
    except FileNotFoundError:
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
