"""What users import: every public name is there, and importing galton costs little."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import galton

ROOT = Path(galton.__file__).parent
STUBS = sorted(ROOT.parent.rglob("__init__.pyi"))
PACKAGES = ("galton", "galton_experiments")
CHEAP = "import sys, galton; print(*(name for name in ('jax', 'pyarrow', 'matplotlib', 'rich') if name in sys.modules))"


def names(stub):
    return [alias.asname for node in ast.parse(stub.read_text()).body for alias in node.names]


@pytest.mark.parametrize("stub", STUBS, ids=lambda stub: stub.parent.name)
def test_every_public_name_is_there(stub):
    module = importlib.import_module(".".join(stub.parent.relative_to(ROOT.parent).parts))
    assert len(STUBS) >= 4
    assert set(names(stub)) <= set(dir(module))
    for name in names(stub):
        assert getattr(module, name) is not None, name


def public_names(module):
    """The names of a public module: of its stub, of its `__all__`, or those that it defines or takes over by `as`."""
    path = ROOT.parent.joinpath(*module.split("."))
    if (path / "__init__.pyi").exists():
        return set(names(path / "__init__.pyi"))
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    found = getattr(importlib.import_module(module), "__all__", None)
    return set(found or filter(lambda name: not name.startswith("_"), defined(file)))


def defined(file):
    body = ast.parse(file.read_text()).body
    for node in [inner for outer in body for inner in (outer.body if isinstance(outer, ast.With) else [outer])]:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            stored = (each for each in ast.walk(node) if isinstance(each, ast.Name))
            yield from (each.id for each in stored if isinstance(each.ctx, ast.Store))
        elif isinstance(node, ast.ImportFrom):
            yield from (alias.name for alias in node.names if alias.asname == alias.name)


def is_public(module, name):
    """Whether a module is one that its package names, up to one of PACKAGES, and has that name itself."""
    package, _, last = module.rpartition(".")
    return name in public_names(module) and (not package or is_public(package, last))


def imported(file):
    """What a file imports of Galton: a module and a name in it, which is the module's own last one for `import`."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in PACKAGES:
            yield from ((node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            whole = [alias.name.rpartition(".") for alias in node.names]
            yield from ((module, name) for module, _, name in whole if module.partition(".")[0] in PACKAGES)


@pytest.mark.few
@pytest.mark.parametrize("folder", ["examples", "studies/paper"])
def test_studies_and_examples_import_public_names_alone(folder):
    files = [*(ROOT.parents[1] / folder).glob("*.py")]
    odd = [(file.name, *each) for file in files for each in imported(file) if not is_public(*each)]
    assert len(files) > 5
    assert not odd


def test_what_to_begin_with_is_few_names():
    assert set(galton.__all__) <= set(names(ROOT / "__init__.pyi"))
    assert len(galton.__all__) <= 25


def test_importing_galton_loads_no_heavy_library():
    done = subprocess.run([sys.executable, "-c", CHEAP], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize("name", ["losses", "policies", "critics", "algorithms", "presets", "returns"])
def test_the_parts_that_documents_name_are_attributes_of_the_package(name):
    assert getattr(galton, name) is importlib.import_module(f"galton.{name}")
    assert name in dir(galton)
