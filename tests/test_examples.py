import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def run(code, folder):
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=True, cwd=folder).stdout


LONG = ("quickstart",)
ELSEWHERE = ("deploy",)
"""It needs a policy: tests/deploy/test_example.py has one."""
EXAMPLES = [
    pytest.param(path, id=path.stem, marks=pytest.mark.slow if path.stem in LONG else [])
    for path in sorted((ROOT / "examples").glob("*.py"))
    if path.stem not in ELSEWHERE
]


@pytest.mark.parametrize("path", EXAMPLES)
def test_an_example_runs(path, tmp_path):
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=300, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(r"\d", done.stdout)


BLOCKS = [
    pytest.param(block, id=f"{path.stem}-{i}")
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    for i, block in enumerate(re.findall(r"```python\n(.*?)```", path.read_text(), re.S))
]


@pytest.mark.parametrize("block", BLOCKS)
def test_python_in_a_document_runs_prints_its_numbers_and_leaves_the_files_it_names(block, tmp_path):
    if "mujoco" in block or "HalfCheetah" in block:
        pytest.importorskip("mujoco")
    printed = run(block.replace("learn(1_000_000", "learn(4_096"), tmp_path)
    assert re.search(r"\d", printed) or "print" not in block
    for name in re.findall(r'(?:best_model=|save\()"([^"]+)"', block):
        assert (tmp_path / f"{name}.safetensors").exists()


def test_the_documents_have_python():
    assert len(BLOCKS) >= 4
    assert any("best_model=" in block.values[0] for block in BLOCKS)
