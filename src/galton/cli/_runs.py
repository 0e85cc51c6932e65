"""The run that a command was given: a run folder of `galton train`, or the file of a model."""

from pathlib import Path

from galton.errors import UsageError, require
from galton.saving.result_folder import MODEL


def model_of(run: Path) -> Path:
    """The model's file in a run folder, or the file that was named.

    Raises:
        UsageError: a folder without a model, or one that can't be read.
    """
    try:
        if not run.is_dir():
            return run
        there = (run / MODEL).exists()
    except OSError as error:
        raise UsageError(f"run is {run}, which can't be read: {error.strerror}") from None
    require(there, f"run is {run}, which holds no {MODEL}; name a run folder of `galton train`, or a saved model")
    return run / MODEL
