"""What the documents name is there."""

import json
import pkgutil
import re
import runpy
import statistics
import subprocess
from pathlib import Path

import numpy as np
import pytest

import galton
from galton.cli._parsing import COMMON
from galton.cli.main import COMMANDS
from galton.envs.lqr import LQR

ROOT = Path(__file__).parents[1]
SOURCE = Path(galton.__file__).parents[1]
ROWS = [line.split("|")[1:4] for line in (ROOT / "docs" / "paper.md").read_text().splitlines() if line.count("|") == 4]
EQUATIONS = [row for row in ROWS if row[0].strip()[:2] in ("§2", "§4", "§5", "eq", "Ap")]
LINKS = [
    (document, target)
    for document in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)\s]*)?(?: \"[^\"]*\")?\)", document.read_text())
]


def check_is_there(name):
    """Find the module or function of a dotted name, or the file of a path."""
    if "/" in name:
        places = (SOURCE / "galton", SOURCE / "galton_experiments", ROOT)
        assert any((place / name).exists() for place in places), f"{name} does not exist"
    else:
        pkgutil.resolve_name(f"galton.{name.removeprefix('galton.')}")


@pytest.mark.parametrize(("equation", "functions", "tests"), EQUATIONS)
def test_an_equation_is_where_the_page_says(equation, functions, tests):
    names = re.findall(r"`([\w./]+)`", functions) + re.findall(r"`((?:studies/)?tests/[\w./]+)`", tests)
    assert len(names) >= 2
    for name in names:
        check_is_there(name)


def test_the_page_of_equations_is_read():
    assert len(EQUATIONS) > 15


@pytest.mark.few
@pytest.mark.parametrize(
    ("document", "target"), LINKS, ids=lambda value: value if isinstance(value, str) else value.stem
)
def test_a_link_between_documents_leads_somewhere(document, target):
    there = document.parent / target
    assert there.exists()
    # A file that git ignores is here and nowhere else. Git says 0 of such a file, and 128 where this is no checkout.
    assert subprocess.run(["git", "check-ignore", "-q", there], cwd=ROOT).returncode != 0


def test_the_page_of_the_command_line_has_each_command_and_the_options_that_help_shows():
    text = (ROOT / "docs" / "command_line.md").read_text()
    assert [name for name in COMMANDS if f"| `{name}` |" not in text or f"`galton {name} " not in text] == []
    options = ["--" + name.replace("_", "-") for name in COMMON if name not in ("env", "training")]
    assert [option for option in options if f"| `{option}` |" not in text] == []


LQRS = {
    "as above": LQR(),
    "R = 0.1 I": LQR(R=0.1 * np.eye(2)),
    "R = 0.01 I": LQR(R=0.01 * np.eye(2)),
    "spectral radius 1.02": LQR(A=np.array(LQR().A) * 1.02 / 0.98),
    "200 steps": LQR(max_episode_steps=200),
    "spectral radius 1 and 200 steps": LQR(A=np.array(LQR().A) / 0.98, max_episode_steps=200),
}


def at_rest(lqr):
    """The mean return of u = 0: x has the second moments S, S' = A S Aᵀ + noise."""
    second_moment, total = np.eye(2) / 3, 0.0
    for _ in range(lqr.max_episode_steps):
        total -= np.trace(np.array(lqr.Q) @ second_moment)
        second_moment = np.array(lqr.A) @ second_moment @ np.array(lqr.A).T + lqr.noise_std**2 * np.eye(2)
    return total


def test_the_page_has_the_returns_of_each_lqr():
    lines = (ROOT / "docs" / "paper.md").read_text().replace("−", "-").replace(",", "").splitlines()
    rows = {cells[1].strip(): cells[2:6] for line in lines if len(cells := line.split("|")) == 7}
    for name, lqr in LQRS.items():
        random, rest, best = lqr.random_return, at_rest(lqr), lqr.optimal_return
        expected = [f"{random:.2f}", f"{rest:.2f}", f"{best:.2f}", f"{(rest - random) / (best - random):.0%}"]
        assert [cell.strip() for cell in rows[name]] == expected


def test_the_comparison_in_two_units_is_quoted_as_it_was_run():
    lines = (ROOT / "docs" / "a2c.md").read_text().replace("**", "").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| A bandit with actions"))
    for line, folder in zip(lines[start:], ("bandit", "bandit-in-units-of-its-box", "lqr"), strict=False):
        rows = json.loads((ROOT / "results" / "demo" / folder / "summary.json").read_text())
        told = []
        for row in rows:
            of = row["evaluation_return"]
            told.append(f"{of['mean']:.2f} ± {(of['high'] - of['low']) / 2:.2f} ({row['rest_to_optimum']:.1%})")
        assert [cell.strip() for cell in line.split("|")[2:-1]] == [each.replace("-", "−") for each in told]


def test_readme_and_quickstart_quote_the_demo_as_it_was_run():
    lines = (ROOT / "README.md").read_text().splitlines()
    quickstart = (ROOT / "docs" / "quickstart.md").read_text()
    for task, folder in (("Pendulum", "pendulum"), ("LQR", "lqr-ppo")):
        rows = json.loads((ROOT / "results" / "demo" / folder / "summary.json").read_text())
        ends = [row["evaluation_return"] for row in rows]
        told = [f"{end['mean']:.2f} ± {(end['high'] - end['low']) / 2:.2f}".replace("-", "−") for end in ends]
        (line,) = [line for line in lines if line.startswith(f"| {task} (")]
        assert [cell.strip() for cell in line.split("|")[2:-1]] == told
        assert task != "Pendulum" or f"ends at {told[0]} (`results/demo/pendulum`" in quickstart


def test_what_standing_still_earns_is_quoted_as_it_was_measured():
    of = json.loads((ROOT / "results" / "benchmarks" / "doing_nothing.json").read_text())["rows"]["Ant"]
    told = f"less than the {of['mean']:.1f} ± {(of['high'] - of['low']) / 2:.1f} of standing still"
    assert told in (ROOT / "docs" / "winner.md").read_text()


def test_what_each_method_costs_is_quoted_as_it_was_measured(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    table = runpy.run_path(str(ROOT / "benchmarks" / "method_speed.py"))["table"]
    found = json.loads((ROOT / "results" / "benchmarks" / "method_speed.json").read_text())["steps_per_second"]
    text = (ROOT / "docs" / "winner.md").read_text()
    assert f"<!-- table: method_speed: mujoco -->\n\n{table(found['mujoco'])}\n" in text
    speeds = {label: statistics.median(of) for label, of in found["analytic"]["A2C, LQR"].items()}
    told = re.search(r"`galton\.A2C\(env\)`, with 50 bins, takes ([\d.]+) times as long as the Gaussian", text)
    assert f"{speeds['Gaussian'] / speeds['+ width, edges']:.1f}" == told[1]
