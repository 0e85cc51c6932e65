"""Imports point down: the order of the layers is the order in which the code can be read."""

import ast
from pathlib import Path

import galton

RANKS = [
    {"errors", "cores"},
    {"types"},
    {"bins", "networks", "returns", "normalization"},
    {"targets", "theory"},
    {"policies", "envs"},
    {"losses", "tasks"},
    {"algorithms"},
    {"training"},
    {"callbacks", "sb3"},
    {"agent"},
    {"analysis", "sweep"},
    {"page"},
    {"paper"},
    {"commands"},
    {"cli"},
]
ROOT = Path(galton.__file__).parent


def rank(name):
    (found,) = [i for i, names in enumerate(RANKS) if name in names]
    return found


def imports(path):
    """The layers that a file imports."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "galton":
            parts = node.module.split(".")
            yield from [parts[1]] if len(parts) > 1 else [alias.name for alias in node.names]


def test_every_module_has_a_layer_and_imports_none_above_it():
    files = [
        path for path in ROOT.rglob("*.py") if path.name not in ("__init__.py", "__main__.py") or path.parent != ROOT
    ]
    assert len(files) > 25
    for path in files:
        own = path.relative_to(ROOT).parts[0].removesuffix(".py")
        for layer in imports(path):
            if own != layer:
                assert rank(layer) < rank(own), f"{path.relative_to(ROOT)} imports galton.{layer}"
