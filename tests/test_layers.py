"""Imports point down: the order of the layers is the order in which the code can be read."""

import ast
import graphlib
import sys
from pathlib import Path

import pytest

import galton

ROOT = Path(galton.__file__).parents[1]

# Folders and files of both packages, the lowest first; what shares a line may not import one another.
RANKS = """
    errors devices version
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

# The core computes: beside the standard library it needs no more than these.
CORE = """
    fields types records parts bins networks optimizers returns normalization targets theory policies kernels losses
    critics schedules algorithms words agents
"""
CORE_LIBRARIES = "jax numpy optax jaxtyping"

# Libraries of the command line and of many runs, and the folders and files outside it that may import them too.
COMMAND_LINE = "cli commands"
COMMAND_LINE_LIBRARIES = {
    "matplotlib": ["analysis", "page", "benchmark"],  # which draw
    "pyarrow": ["analysis", "sweep", "runs", "benchmark"],  # which keep what thousands of runs told
    "rich": ["models/learning.py", "sweep/view.py"],  # which show progress
    "tyro": [],
}

# Libraries of an extra, each of which one file alone imports.
EXTRAS = {"onnx": "deploy/policy_files.py"}


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


PACKAGES = {"galton", "galton_experiments"}
GRAPH = {name: set(imports(path)) for name, path in MODULES.items()}
LIBRARIES = {
    Path(*path.relative_to(ROOT).parts[1:]): {name.split(".")[0] for name in GRAPH[module]} - PACKAGES
    for module, path in MODULES.items()
}


def layer(name):
    """The folder or top-level file that a module lies in; None for a package itself and `python -m galton`."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 and parts[1] != "__main__" else None


def rank(name):
    """The line of RANKS that a layer stands in."""
    (found,) = [i for i, line in enumerate(RANKS.strip().splitlines()) if name in line.split()]
    return found


def lies_in(path, places):
    """Whether a file is one of these folders and files, or inside one."""
    own = path.parts[0].removesuffix(".py")
    return any(path == Path(place) or own == place or Path(place) in path.parents for place in places)


def test_every_module_has_a_layer_and_imports_none_above_it():
    assert len(MODULES) > 100
    for name in MODULES:
        for other in GRAPH[name] & set(MODULES):
            if None not in (layer(name), layer(other)) and layer(name) != layer(other):
                assert rank(layer(other)) < rank(layer(name)), f"{name} imports {other}"


def test_one_run_needs_nothing_of_many():
    for name in MODULES:
        if name.split(".")[0] == "galton":
            assert not [other for other in GRAPH[name] if other.split(".")[0] == "galton_experiments"], name


def test_no_module_imports_itself_by_a_detour():
    graph = {name: GRAPH[name] & set(MODULES) for name in MODULES}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


def test_the_core_needs_no_library_but_those_that_compute():
    excused = {path: name for name, places in COMMAND_LINE_LIBRARIES.items() for path in places}
    core = {path: names for path, names in LIBRARIES.items() if lies_in(path, CORE.split())}
    assert len(core) > 10
    for path, names in core.items():
        odd = names - set(CORE_LIBRARIES.split()) - sys.stdlib_module_names - {excused.get(str(path))}
        assert not odd, f"{path} imports {odd}"


@pytest.mark.parametrize("library", COMMAND_LINE_LIBRARIES)
def test_a_library_of_the_command_line_stays_there(library):
    places = COMMAND_LINE_LIBRARIES[library]
    for path, names in LIBRARIES.items():
        allowed = lies_in(path, [*COMMAND_LINE.split(), *places])
        assert allowed or library not in names, f"{path} imports {library}"
    for place in places:
        used = any(library in names for path, names in LIBRARIES.items() if lies_in(path, [place]))
        assert used, f"{place} no longer imports {library}: take it out of COMMAND_LINE_LIBRARIES"


@pytest.mark.parametrize("library", EXTRAS)
def test_a_library_of_an_extra_is_imported_in_one_file(library):
    assert [str(path) for path, names in LIBRARIES.items() if library in names] == [EXTRAS[library]]
    (tree,) = [ast.parse(path.read_text()) for path in MODULES.values() if path == ROOT / "galton" / EXTRAS[library]]
    at_once = {alias.name for node in tree.body if isinstance(node, ast.Import) for alias in node.names}
    assert library not in at_once | {node.module for node in tree.body if isinstance(node, ast.ImportFrom)}
