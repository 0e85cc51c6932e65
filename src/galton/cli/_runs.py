"""The run that a command was given: a run folder of `galton train`, or the file of a model."""

import json
from pathlib import Path

from galton.cli._modules import search_here
from galton.envs.registry import read_constants
from galton.errors import UsageError, require
from galton.saving.model_file import existing
from galton.saving.result_folder import CONFIG, MODEL, read_settings


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
        env is not None or ":" not in name,
        f"env is {name} in {beside}, which imports a module; give it with --env if you trust it",
    )
    if ":" in name:
        search_here()
    return name, read_constants(json.dumps(known.get("env_kwargs", {})) if env_kwargs is None else env_kwargs)


def _settings_beside(file: Path) -> dict[str, object]:
    try:
        return read_settings(file.parent)
    except UsageError as error:
        raise UsageError(f"{error}; give --env and --env-kwargs (as '{{}}' where there are none)") from None
