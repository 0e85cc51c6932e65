import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from galton_experiments.benchmark import stages
from galton_experiments.benchmark.draws import draws
from galton_experiments.benchmark.reading import read

ROOT = Path(__file__).parents[1]


LONG = ("quickstart", "a_sweep", "new_policy", "new_algorithm", "new_environment", "new_network", "new_study")
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


QUICK = ("README", "index", "quickstart", "own_environment")
"""The documents whose Python is run without being slow: what a new user tries first."""
BLOCKS = [
    pytest.param(i, block, id=f"{name}-{n}", marks=[pytest.mark.slow] * (name not in QUICK))
    for i, (name, n, block) in enumerate(
        (path.stem, n, block)
        for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
        if path.stem != "tutorial"  # it needs the run that its commands train
        for n, block in enumerate(re.findall(r"```python\n(.*?)```", path.read_text(), re.S))
    )
]
LONG_TRAINING = re.compile(r"(learn\(|every=)(10_000|40_000|100_000|1_000_000)\b")
"""Numbers of steps that a reader waits for and a test does not."""
RUN = """
import contextlib, json, os, pathlib, sys, traceback, warnings
import galton
warnings.filterwarnings("ignore", "os.fork")  # nothing of JAX has run yet

def run(block, folder):
    os.chdir(folder)
    with open("printed", "w") as file, contextlib.redirect_stdout(file):
        try:
            exec(compile(block, folder, "exec"), {"__name__": "__main__"})
        except BaseException:
            pathlib.Path("failed").write_text(traceback.format_exc())

for folder, block in json.load(sys.stdin):
    child = os.fork()
    if not child:
        run(block, folder)
        os._exit(0)
    os.waitpid(child, 0)
"""


@pytest.fixture(scope="module")
def folders(tmp_path_factory, request):
    """Where each chosen one of BLOCKS has run, in a process of its own, all from where Galton was imported once."""
    calls = [item.callspec.params for item in request.session.items if "folders" in item.fixturenames]
    made = {call["index"]: tmp_path_factory.mktemp("block") for call in calls}
    jobs = [(str(made[call["index"]]), LONG_TRAINING.sub(r"\g<1>4_096", call["block"])) for call in calls]
    subprocess.run([sys.executable, "-c", RUN], input=json.dumps(jobs), text=True, timeout=900, check=True)
    return made


@pytest.mark.slow
@pytest.mark.parametrize(("index", "block"), BLOCKS)
def test_python_in_a_document_runs_prints_its_numbers_and_leaves_the_files_it_names(index, block, folders):
    if "mujoco" in block or "-v5" in block:
        pytest.importorskip("mujoco")
    folder = folders[index]
    assert not (folder / "failed").exists(), (folder / "failed").read_text()
    printed = (folder / "printed").read_text()
    assert re.search(r"\d", printed) or "print" not in block
    for name in re.findall(r'(?:best_model=|save\()"([^"]+)"', block):
        assert (folder / f"{name}.safetensors").exists()


def test_the_documents_have_python():
    assert len(BLOCKS) >= 4
    assert any("best_model=" in block.values[1] for block in BLOCKS)
