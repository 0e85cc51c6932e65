"""The golden files, and how numbers are compared with them."""

import json
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np

from galton.words import idle

V1, V2, V3 = (Path(__file__).parent / version for version in ("v1", "v2", "v3"))
CLOSE = {"rtol": 1e-4, "atol": 1e-5}
"""What other compiler flags and other processors may change: a few roundings, added up over hundreds of updates."""


def record(name, folder=V1):
    return json.loads((folder / name).read_text())


def arrays(name, prefix, folder=V1):
    """Those of an npz file whose names begin so, by the rest of their names."""
    with np.load(folder / name) as file:
        return {key.removeprefix(prefix): file[key] for key in file.files if key.startswith(prefix)}


def by_path(tree):
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): np.asarray(leaf) for path, leaf in leaves}


def check_close(found, golden):
    """Everything golden is there; what a later version adds is its own affair."""
    assert golden
    assert golden.keys() <= found.keys()
    for name, values in golden.items():
        np.testing.assert_allclose(found[name], values, **CLOSE, err_msg=name)


def check_settings(found, known):
    """Check that all that a model was made with is set as it was, but for what its parts have no use for."""
    for name, value in known.items():
        if name not in found:
            assert name in idle(found)
        elif value is None:  # JSON has no infinity
            assert np.isinf(found[name])
        else:
            assert found[name] == (tuple(value) if name == "net_arch" else value), name


def command(*arguments, cwd):
    done = subprocess.run(
        [sys.executable, "-m", "galton", *arguments], cwd=cwd, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
