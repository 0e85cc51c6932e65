"""A policy's two files: the ONNX file, and the contract beside it."""

import json
from collections.abc import Mapping
from pathlib import Path

from galton.deploy.contract import contract
from galton.deploy.decision import decide
from galton.deploy.encoding import encode
from galton.errors import require
from galton.models import Model
from galton.saving import files


def export(model: Model, path: str | Path, origin: Mapping[str, object] | None = None) -> Path:
    """Write the whole decision of a model's policy as ONNX, and its contract as JSON beside it.

    The file does what `predict(observation, deterministic=True)` does: it normalises and clips the observation, asks
    the network, chooses by the policy's rule and keeps to the action space's bounds.

    Args:
        model: A2C, PPO or one that was loaded, with or without an environment.
        path: of the ONNX file; `.onnx` is added to a name without a suffix. The contract has the same name in `.json`.
        origin: more entries for the contract's `source`.

    Returns:
        The path of the ONNX file.

    Raises:
        UsageError: ONNX is not installed, a policy of your own without a line in ACTIONS, or a path that can't be
            written.
    """
    path = Path(path)
    files.check_name("path", path)
    path = path if path.suffix else path.with_suffix(".onnx")
    require(path.suffix == ".onnx", f"path is {path}; its name must end in .onnx")
    files.check_no_way_out("path", path.parent, path.with_suffix(".json").name)  # which nobody named
    decision = decide(model)
    content = encode(decision)
    terms = contract(model, decision, path.name, content, origin or {})
    text = json.dumps(terms, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    with files.named("path", path):
        files.write(path, content)
        files.write(path.with_suffix(".json"), text.encode(errors="backslashreplace"))  # which is how JSON writes them
    return path
