"""`galton.torch` needs torch, and no JAX."""

import subprocess
import sys
from pathlib import Path

BLOCKED = """
import sys

for name in ("jax", "jaxlib", "optax", "scipy", "tyro", "rich"):
    sys.modules[name] = None  # importing it fails
"""


def test_it_trains_and_exports_without_jax():
    program = BLOCKED + (Path(__file__).parent / "alone.py").read_text()
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
