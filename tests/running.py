"""Python of documents and examples, in processes of their own, all forked from one that has imported Galton."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LONG_TRAINING = re.compile(r"(learn\(|every=|total_timesteps=)(10_000|40_000|100_000|1_000_000)\b")
"""Numbers of steps that a reader waits for and a test does not."""
RUN = """
import contextlib, json, os, pathlib, sys, traceback, warnings
import galton
warnings.filterwarnings("ignore", "os.fork")  # nothing of JAX has run yet

def run(text, folder):
    os.chdir(folder)
    with open("printed", "w") as file, contextlib.redirect_stdout(file):
        try:
            exec(compile(text, folder, "exec"), {"__name__": "__main__"})
        except BaseException:
            pathlib.Path("failed").write_text(traceback.format_exc())

for folder, text in json.load(sys.stdin):
    child = os.fork()
    if not child:
        run(text, folder)
        os._exit(0)
    os.waitpid(child, 0)
"""


def examples(*stems):
    """Cases of these examples: a name and its text."""
    return [pytest.param(stem, (ROOT / "examples" / f"{stem}.py").read_text(), id=stem) for stem in stems]


def run_chosen(request, tmp_path_factory):
    """Where each chosen case of a module's tests has run, by its name: what `@pytest.fixture`s named `folders` give."""
    items = (item for item in request.session.items if item.module is request.module)
    calls = [item.callspec.params for item in items if "folders" in item.fixturenames]
    chosen = {call["name"]: call["text"] for call in calls}
    made = {name: tmp_path_factory.mktemp("run") for name in chosen}
    jobs = [(str(made[name]), LONG_TRAINING.sub(r"\g<1>4_096", text)) for name, text in chosen.items()]
    subprocess.run([sys.executable, "-c", RUN], input=json.dumps(jobs), text=True, timeout=900, check=True)
    return made


def check(folder, text):
    """Fail unless a piece ran, printed a number if it prints, and left the models that it names."""
    if "mujoco" in text or "-v5" in text:
        pytest.importorskip("mujoco")
    assert not (folder / "failed").exists(), (folder / "failed").read_text()
    assert re.search(r"\d", (folder / "printed").read_text()) or "print" not in text
    for name in re.findall(r'(?:best_model=|save\()"([^"]+)"', text):
        assert (folder / f"{name}.safetensors").exists()
