import re
import subprocess
import sys
from pathlib import Path

import pytest

from galton.benchmark import stages
from galton.benchmark.draws import draws
from galton.benchmark.reading import read

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


PROTOCOLS = [*sorted((ROOT / "examples").glob("*.toml")), *sorted((ROOT / "benchmarks").glob("**/*.toml"))]


@pytest.mark.parametrize("path", PROTOCOLS, ids=lambda path: path.stem)
def test_the_protocol_of_a_benchmark_can_be_trained(path):
    protocol = read(path)
    if any(task.env.endswith("-v5") for task in protocol.tasks):
        pytest.importorskip("mujoco")
    stages.check(protocol, draws(protocol))


@pytest.mark.slow
def test_the_example_of_a_benchmark_is_trained_and_told(tmp_path):
    command = [sys.executable, "-m", "galton", "benchmark", ROOT / "examples" / "benchmark.toml"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "On the held-out tasks, Centred HL-Gauss is above Gaussian with P = " in done.stdout.replace("\n", " ")
    folder = tmp_path / "runs" / "benchmark-benchmark"
    assert "A Gaussian and a histogram on a bandit" in (folder / "index.html").read_text()
    before = (folder / "report.json").read_bytes()
    assert subprocess.run(command, cwd=tmp_path, capture_output=True).returncode == 0
    assert (folder / "report.json").read_bytes() == before


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
