"""The examples of sweeps and studies, and the protocols of benchmarks."""

import subprocess
import sys

import pytest

from galton_experiments.benchmark import stages
from galton_experiments.benchmark.draws import draws
from galton_experiments.benchmark.reading import read

from ..running import ROOT, check, examples, run_chosen
from ..test_examples import OF_EXPERIMENTS


@pytest.fixture(scope="module")
def folders(request, tmp_path_factory):
    return run_chosen(request, tmp_path_factory)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "text"), examples(*OF_EXPERIMENTS))
def test_an_example_runs(name, text, folders):
    check(folders[name], text)


PROTOCOLS = [
    *sorted((ROOT / "examples").glob("*.toml")),
    *(pytest.param(path, marks=pytest.mark.slow) for path in sorted((ROOT / "benchmarks").glob("**/*.toml"))),
]


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
