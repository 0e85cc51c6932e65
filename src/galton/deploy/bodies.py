"""ONNX computes each network's body by a function of its layers, a line in BODIES.

Each says in a graph what `features` of the network says in JAX.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from galton.deploy.graph import Graph
from galton.networks import MLP, Layers, SimBa
from galton.types import Params

Body = Callable[[Graph, Any, Layers, str], str]
"""A function of a graph, a network, its layers and the name of its inputs `[batch, n]`, to the name of its features."""

_ACTIVATIONS: dict[str, Callable[[Graph, str], str]] = {
    "tanh": lambda graph, x: graph.add("Tanh", x),
    "relu": lambda graph, x: graph.add("Relu", x),
    "elu": lambda graph, x: graph.add("Elu", x),
    "silu": lambda graph, x: graph.add("Mul", x, graph.add("Sigmoid", x)),
}


def linear(graph: Graph, layer: Params, x: str, name: str | None = None) -> str:
    """The outputs of a linear layer, without an activation."""
    return graph.add("Add", graph.add("MatMul", x, np.asarray(layer["kernel"])), np.asarray(layer["bias"]), name=name)


def mlp(graph: Graph, network: MLP, layers: Layers, x: str) -> str:
    """Hidden layers, each with its activation."""
    for layer in layers[:-1]:
        x = _ACTIVATIONS[network.activation](graph, linear(graph, layer, x))
    return x


def simba(graph: Graph, network: SimBa, layers: Layers, x: str) -> str:
    """The first layer, residual blocks and the last norm."""
    del network
    embedding, *blocks, norm, _ = layers
    x = linear(graph, embedding, x)
    for block in blocks:
        inside = graph.add("Relu", linear(graph, block["up"], _layer_norm(graph, block["norm"], x)))
        x = graph.add("Add", x, linear(graph, block["down"], inside))
    return _layer_norm(graph, norm, x)


def _layer_norm(graph: Graph, layer: Params, x: str) -> str:
    centered = graph.add("Sub", x, graph.add("ReduceMean", x, axes=[-1]))
    variance = graph.add("ReduceMean", graph.add("Mul", centered, centered), axes=[-1])
    normal = graph.add("Div", centered, graph.add("Sqrt", graph.add("Add", variance, 1e-6)))
    return graph.add("Add", graph.add("Mul", normal, np.asarray(layer["scale"])), np.asarray(layer["bias"]))


BODIES: dict[type, Body] = {MLP: mlp, SimBa: simba}
