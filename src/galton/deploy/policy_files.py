"""A policy's two files: the ONNX file, and the contract beside it, which says as plain JSON how to call it.

ONNX is imported here and nowhere else.
"""

import hashlib
import json
import math
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from gymnasium.spaces.utils import flatdim

from galton import normalization
from galton.agents import policy_name
from galton.deploy.decision import ACTION, MASK, OBSERVATION, Decision, decide
from galton.envs.host.actions import entries, leaves
from galton.envs.host.base import Space
from galton.envs.host.statistics import wrappers_at
from galton.errors import UsageError, require
from galton.extras import needed
from galton.models import Model
from galton.saving import files
from galton.saving.provenance import version

OPSET, IR_VERSION = 13, 7
"""Of December 2020: ONNX 1.8, and ONNX Runtime from 1.6 on."""
BATCH = "batch"
"""The name of the first dimension of input and output, which may have any size."""
LOST = 1e-3
"""Of a deviation: larger steps between neighbours in float32 are warned of."""
VERSION = 1
"""Of the contract's form; a higher one may have other entries."""


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
            written, or whose `.json` holds something else than a contract.

    Warns:
        UserWarning: float32, the file's input, has too few digits for the observations.
    """
    path = Path(path)
    files.check_name("path", path)
    path = path if path.suffix else path.with_suffix(".onnx")
    require(path.suffix == ".onnx", f"path is {path}; its name must end in .onnx")
    files.check_no_way_out("path", path.parent, path.with_suffix(".json").name)  # which nobody named
    _check_beside(path.with_suffix(".json"))
    decision = decide(model)
    _tell_of_lost_digits(model)
    _tell_of_wrappers(model)
    content = encode(decision)
    terms = contract(model, decision, path.name, content, origin or {})
    text = json.dumps(terms, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    with files.named("path", path):
        files.write(path, content)
        files.write(path.with_suffix(".json"), text.encode(errors="backslashreplace"))  # which is how JSON writes them
    return path


def _check_beside(path: Path) -> None:
    """Raise UsageError unless a contract may be written here: where nothing is, or another contract."""
    try:
        there = json.loads(files.read(path, files.TEXT))
    except (FileNotFoundError, NotADirectoryError):
        return
    except (OSError, ValueError, RecursionError):
        there = None
    told = f"path is {path.with_suffix('.onnx')}, whose contract would replace {path}, which is none; take another name"
    require(isinstance(there, dict) and "contract" in there, told)


def _tell_of_lost_digits(model: Model) -> None:
    """Warn where observations in float64 vary less than float32 can tell at their size: `predict` has these digits."""
    normalizer = model.learner.normalizer
    if normalizer.observation and model.observations.dtype == np.float64:
        center = np.abs(normalizer.origin + normalizer.observation.mean)
        steps = np.finfo(np.float32).eps * center / normalization.deviation(normalizer)
        if steps.max() > LOST:
            warnings.warn(
                f"an entry of the observations is about {center[steps.argmax()]:.3g}, and float32, the file's input, "
                f"tells it in steps of {steps.max():.2g} of its deviations: train on observations that are moved "
                "towards 0 (gymnasium.wrappers.TransformObservation), or the file acts otherwise than predict",
                stacklevel=3,
            )


def _tell_of_wrappers(model: Model) -> None:
    """Warn where wrappers normalised the observations that the policy learnt from: the file has none of that."""
    if wrappers := _wrappers(model):
        warnings.warn(
            f"the policy learnt from observations that {wrappers} normalised by running statistics, which are not in "
            "the file: give it such observations, or train with normalize_observation=True in the wrapper's place",
            stacklevel=3,
        )


def _wrappers(model: Model) -> str:
    return wrappers_at(place for own in model.wrapper_statistics for place in own)


def encode(decision: Decision) -> bytes:
    """A decision's ONNX file, always of the same bytes; UsageError without ONNX, or for steps unknown to it."""
    onnx = _onnx()
    helper, float32 = onnx.helper, onnx.TensorProto.FLOAT
    graph = decision.graph
    inputs = {OBSERVATION: decision.observation_shape} | ({MASK: (decision.n_mask,)} if decision.n_mask else {})
    described = helper.make_graph(
        [helper.make_node(node.operator, node.inputs, [node.output], **node.attributes) for node in graph.nodes],
        "policy",
        [helper.make_tensor_value_info(name, float32, [BATCH, *shape]) for name, shape in inputs.items()],
        [helper.make_tensor_value_info(ACTION, float32, [BATCH, *decision.low.shape])],
        [_tensor(onnx, name, array) for name, array in graph.constants.items()],
    )
    opset = helper.make_operatorsetid("", OPSET)
    model = helper.make_model(described, opset_imports=[opset], ir_version=IR_VERSION, producer_name="galton")
    try:
        onnx.checker.check_model(model, full_check=True)
    except (onnx.checker.ValidationError, onnx.shape_inference.InferenceError) as error:
        told = " ".join(str(error).split())
        raise UsageError(f"the policy's function in galton.deploy.ACTIONS makes no graph of ONNX: {told}") from None
    content: bytes = model.SerializeToString(deterministic=True)
    return content


def _tensor(onnx: ModuleType, name: str, array: np.ndarray) -> object:
    """A constant, in little-endian bytes whatever the machine."""
    kind = onnx.TensorProto.INT64 if array.dtype.kind == "i" else onnx.TensorProto.FLOAT
    content = array.astype(array.dtype.newbyteorder("<")).tobytes()
    return onnx.helper.make_tensor(name, kind, array.shape, content, raw=True)


def _onnx() -> ModuleType:
    with needed("the format onnx", "onnx"):
        import onnx
        import onnx.checker
        import onnx.helper
        import onnx.shape_inference
    return onnx


def contract(
    model: Model, decision: Decision, file: str, content: bytes, origin: Mapping[str, object]
) -> dict[str, object]:
    """The contract of the file with these bytes: its input, its output and its source, to which `origin` is added."""
    normalizes = bool(model.learner.normalizer.observation)
    return {
        "contract": VERSION,
        "file": file,
        "sha256": hashlib.sha256(content).hexdigest(),
        "opset": OPSET,
        "ir_version": IR_VERSION,
        "input": {
            "name": OBSERVATION,
            "dtype": "float32",
            "shape": [BATCH, *decision.observation_shape],
            "units": f"{_units(model)}; every number must be finite",
            "entries": list(_entries(model.observations.space)),
        },
        "observation_normalization": {"clip": normalization.CLIP} if normalizes else None,
        "rule": decision.chosen.rule,
        "rule_meaning": decision.chosen.meaning,
        "output": {
            "name": ACTION,
            "dtype": "float32",
            "shape": [BATCH, *decision.low.shape],
            "units": "the environment's own",
            "low": decision.low.tolist(),
            "high": decision.high.tolist(),
            **(
                {"environment_dtype": str(model.action_space.dtype)}
                if isinstance(model.action_space, Box)
                else {"entries": list(_acted(model.action_space))}
            ),
        },
        **({"mask": _mask(decision.n_mask)} if decision.n_mask else {}),
        "source": _source(model) | dict(origin),
    }


def _units(model: Model) -> str:
    wrappers = _wrappers(model)
    return f"as {wrappers} normalised them" if wrappers else "the environment's own, not normalised"


def _mask(n: int) -> dict[str, object]:
    return {
        "name": MASK,
        "dtype": "float32",
        "shape": [BATCH, n],
        "meaning": "1 for each value that is allowed, 0 for others; the environment's own mask, flat",
    }


def _acted(space: Space) -> Iterator[dict[str, object]]:
    """The entries of the flat action that each part of the environment's is made of; `to` is left out."""
    first = 0
    for keys, leaf in leaves(space):
        n = len(entries(leaf)[0])
        entry: dict[str, object] = {"part": list(keys), "from": first, "to": first + n, "dtype": str(leaf.dtype)}
        first += n
        if isinstance(leaf, Box):
            yield entry | {"encoding": "as it is"}
        else:
            start = np.asarray(getattr(leaf, "start", 0)).tolist()
            yield entry | {"encoding": "index of the value, counted from `first`", "first": start}


def _source(model: Model) -> dict[str, object]:
    parts = {kind: model.settings[kind] for kind in ("algorithm", "loss")}
    return {
        "env": model.env_name,
        **{kind: part if isinstance(part, str) else type(part).__name__ for kind, part in parts.items()},
        "policy": policy_name(model.agent),
        "seed": int(model.seed),
        "steps": int(model.num_timesteps),
        "galton": version(),
    }


def _entries(space: Space) -> Iterator[dict[str, object]]:
    """The entries of the flat observation that each part of the environment's is, in order; `to` is left out."""
    first = 0
    for keys, leaf in leaves(space):
        entry: dict[str, object] = {"part": list(keys), "from": first, "to": first + flatdim(leaf)}
        first += flatdim(leaf)
        if isinstance(leaf, Box):
            yield entry | {"encoding": "as it is", "low": _finite(leaf.low), "high": _finite(leaf.high)}
        elif isinstance(leaf, Discrete):
            yield entry | {"encoding": "one-hot", "first": int(leaf.start), "sizes": [int(leaf.n)]}
        elif isinstance(leaf, MultiDiscrete):
            sizes, starts = (np.ravel(of).tolist() for of in (leaf.nvec, leaf.start))
            yield entry | {"encoding": "one-hot, one after the other", "first": starts, "sizes": sizes}
        else:
            yield entry | {"encoding": "0 or 1"}


def _finite(bound: np.ndarray) -> list[float | None] | float | None:
    """Bounds, row by row, or one number where all are equal; None for one that is not there: JSON knows no infinity."""
    values = [value if math.isfinite(value) else None for value in bound.astype(np.float64).ravel().tolist()]
    return values[0] if len(set(values)) == 1 else values
