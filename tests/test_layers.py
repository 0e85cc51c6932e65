"""Imports point down: the order of the layers is the order in which the code can be read."""

import ast
from pathlib import Path

import galton

ROOT = Path(galton.__file__).parents[1]

# Folders and files of both packages, the lowest first; what shares a line may not import one another.
RANKS = """
    errors decimals devices version
    extras
    fields
    types
    records
    parts
    bins optimizers returns normalization schedules
    targets theory torch
    networks
    policies envs
    kernels
    losses critics
    tasks presets algorithms
    words
    agents
    saving
    training
    callbacks sb3
    models
    deploy
    cli
    analysis sweep
    runs
    page
    benchmark
    commands
"""


def modules():
    """Every module's file by its dotted name; a folder is its `__init__`."""
    found = {}
    for path in ROOT.rglob("*.py"):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


def imports(path):
    """The dotted names that a file imports, wherever in it; `from a import b` is a.b if that is a module, else a."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path} imports relatively"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in MODULES else node.module


GRAPH = {name: set(imports(path)) for name, path in MODULES.items()}


def layer(name):
    """The folder or top-level file that a module lies in; None for a package itself and `python -m galton`."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 and parts[1] != "__main__" else None


def rank(name):
    """The line of RANKS that a layer stands in."""
    (found,) = [i for i, line in enumerate(RANKS.strip().splitlines()) if name in line.split()]
    return found


def test_every_module_has_a_layer_and_imports_none_above_it():
    assert len(MODULES) > 100
    for name in MODULES:
        for other in GRAPH[name] & set(MODULES):
            if None not in (layer(name), layer(other)) and layer(name) != layer(other):
                assert rank(layer(other)) < rank(layer(name)), f"{name} imports {other}"
