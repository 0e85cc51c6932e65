"""What users import: every public name is there, and importing galton costs little."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import galton

ROOT = Path(galton.__file__).parent
STUBS = sorted(ROOT.rglob("__init__.pyi"))
CHEAP = "import sys, galton; print(*(name for name in ('jax', 'pyarrow', 'matplotlib', 'rich') if name in sys.modules))"


def names(stub):
    return [alias.asname for node in ast.parse(stub.read_text()).body for alias in node.names]


@pytest.mark.parametrize("stub", STUBS, ids=lambda stub: stub.parent.name)
def test_every_public_name_is_there(stub):
    module = importlib.import_module(".".join(("galton", *stub.parent.relative_to(ROOT).parts)))
    assert len(STUBS) >= 4
    assert set(names(stub)) <= set(dir(module))
    for name in names(stub):
        assert getattr(module, name) is not None, name


def test_importing_galton_loads_no_heavy_library():
    done = subprocess.run([sys.executable, "-c", CHEAP], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize("name", ["losses", "policies", "critics", "algorithms", "presets", "returns"])
def test_the_parts_that_documents_name_are_attributes_of_the_package(name):
    assert getattr(galton, name) is importlib.import_module(f"galton.{name}")
    assert name in dir(galton)
