"""Folders of results: filled by one process at a time, and whole or not there."""

import contextlib
import errno
import glob
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import filelock

from galton.errors import UsageError, require
from galton.saving import files
from galton.saving.provenance import machine, versions

CONFIG = "config.json"
"""The file that says what the results were made with; a folder of results is known by it."""

METRICS, MODEL, BEST = "metrics.jsonl", "model.safetensors", "best_model.safetensors"
"""The files of a run, beside its settings: its log points, the model, and the model of its best evaluation."""

POLICY, CONTRACT, CARD = "policy.onnx", "policy.json", "model_card.md"
"""The files that a run is exported to."""

SUMMARY, CURVES, FIGURE = "summary.json", "curves.parquet", "learning_curves"
"""The files of a comparison, beside its settings; the figure has a suffix for each of its forms."""

FILES = (
    *(CONFIG, METRICS, MODEL, BEST, "tensorboard", "video.mp4", "video.gif"),
    *(POLICY, CONTRACT, CARD),
    *(SUMMARY, CURVES, f"{FIGURE}.png", f"{FIGURE}.svg"),
)
"""The files that commands write into folders of results. A folder with any other is somebody's, and is not replaced."""


def check_free(path: Path, overwrite: bool, instead: str = "--overwrite") -> None:
    """Raise UsageError, with the options to give `instead`, if path holds something that may not be replaced."""
    files.check_text("out", path)
    path = path.resolve()
    with files.named("out", path):
        require(path.is_dir() or not path.exists(), f"out is {path}, which is a file; name a folder")
        require(not path.is_mount(), f"out is {path}, where a disk is mounted; name a folder in it")
        require(
            not (path.is_dir() and Path.cwd().is_relative_to(path)),
            f"out is {path}, which the current folder is in; name another, or go elsewhere first",
        )
        if not path.exists() or not any(path.iterdir()):
            return
    require(overwrite, f"out is {path}, which is there already; name another folder or give {instead}")
    ours = isinstance(read_settings(path).get("versions"), dict)
    require(ours, f"out is {path}, which is not a folder of results and is not overwritten; name another")
    with files.named("out", path):
        names = [file.name for file in path.iterdir() if file.name not in FILES]
    others = sorted(name for name in names if not name.startswith((files.SCRATCH, ".DS_Store", ".nfs")))
    require(not others, f"out is {path}, which also holds {', '.join(others[:5])}; move that away, or name another")


@contextlib.contextmanager
def claimed(path: Path) -> Iterator[None]:
    """A time in which no other process claims the folder, without what killed ones left; UsageError if one has it."""
    path = path.resolve()
    lock = filelock.FileLock(path.parent / f".{path.name}.lock", blocking=False)
    with files.named("out", path):
        path.parent.mkdir(parents=True, exist_ok=True)
        files.check_no_way_out("out", path.parent, Path(lock.lock_file).name)  # it would be emptied
        try:
            lock.acquire()
        except filelock.Timeout:
            if not Path(lock.lock_file).exists():  # it can't be made, as in /proc
                raise OSError(errno.EROFS, f"no file can be made in {path.parent}") from None
            raise UsageError(f"out is {path}, which another process is filling; name another folder") from None
    try:
        files.clear(path)
        for stale in path.parent.glob(f".{glob.escape(path.name)}.galton-*/"):
            _discard(stale, path)
        yield
    finally:
        with contextlib.suppress(OSError):  # Windows can't remove an open file
            Path(lock.lock_file).unlink()
        lock.release()


@contextlib.contextmanager
def replacing(path: Path, overwrite: bool) -> Iterator[Path]:
    """A folder to write into that takes the place of a claimed `path` at the end; UsageError if that can't be."""
    path = path.resolve()
    with files.named("out", path):
        scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.galton-", dir=path.parent))
    try:
        fresh = scratch / "new"
        fresh.mkdir()
        try:
            yield fresh
        except UsageError as error:  # it speaks of the folder that was asked for
            raise UsageError(str(error).replace(str(fresh), str(path))) from None
        if overwrite and path.exists():
            path.replace(scratch / "old")
        try:
            fresh.replace(path)
        except OSError:
            kept = fresh.replace(path.with_name(f"{path.name}-{os.getpid()}"))
            raise UsageError(f"out is {path}, which somebody filled meanwhile; the results are in {kept}") from None
    finally:
        _discard(scratch, path)


def write_settings(folder: Path, settings: dict[str, object]) -> None:
    """Write config.json: the settings, the versions and the machine."""
    record = settings | {"versions": versions(), "machine": machine()}
    files.write(folder / CONFIG, (json.dumps(record, indent=2, default=str) + "\n").encode())


def read_settings(folder: Path) -> dict[str, object]:
    """The settings that `write_settings` wrote, none without a config.json; UsageError for one that can't be read."""
    path = folder / CONFIG
    try:
        settings = json.loads(files.read(path, files.TEXT))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(f"{path} can't be read: {error}") from None
    require(isinstance(settings, dict), f"{path} holds no settings, which are a JSON object")
    return settings


def _discard(scratch: Path, path: Path) -> None:
    """Remove a scratch folder, but first put back what it took from `path`, should it hold the only copy."""
    if (scratch / "old").exists() and not path.exists():
        (scratch / "old").replace(path)
    shutil.rmtree(scratch, ignore_errors=True)
