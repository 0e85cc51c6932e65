"""A computation in ONNX's operators, as it is put together. Nothing here needs ONNX."""

from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from galton.types import Params

Attribute = int | float | list[int]


class Node(NamedTuple):
    """One step of a computation."""

    operator: str
    """The name of one of ONNX's operators."""
    inputs: tuple[str, ...]
    output: str
    attributes: dict[str, Attribute]


class Graph:
    """Steps and constants, in the order in which they were added. Each has a name, by which later steps call it."""

    def __init__(self, params: Params | None = None) -> None:
        self.params = params or {}
        """The parameters that the policy has beside its network, for what needs them."""
        self.nodes: list[Node] = []
        self.constants: dict[str, np.ndarray] = {}

    def add(self, operator: str, *inputs: str | ArrayLike, name: str | None = None, **attributes: Attribute) -> str:
        """Add one step, and return the name of its output.

        Args:
            operator: the name of one of ONNX's operators, in opset 13.
            inputs: names of earlier outputs, or arrays, which become constants: integers int64, all others float32.
            name: of the output; by default the operator's with a number.
            attributes: the operator's own.
        """
        name = name or f"{operator.lower()}_{len(self.nodes)}"
        names = [
            given if isinstance(given, str) else self._constant(f"{name}.{i}", given) for i, given in enumerate(inputs)
        ]
        self.nodes.append(Node(operator, tuple(names), name, attributes))
        return name

    def _constant(self, name: str, value: ArrayLike) -> str:
        array = np.asarray(value)
        self.constants[name] = array.astype(np.int64 if array.dtype.kind in "iu" else np.float32)
        return name
