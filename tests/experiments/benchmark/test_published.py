"""What is published fits the file that it was trained by, and documents quote it as it is."""

import functools
import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from galton_experiments.analysis.aggregates import improvement
from galton_experiments.analysis.statistics import Interval, mean_interval
from galton_experiments.benchmark import quoted, report, tables
from galton_experiments.benchmark.folder import FILE, load
from galton_experiments.benchmark.reading import read
from galton_experiments.page import quotes
from galton_experiments.sweep.store import Store

ROOT = Path(__file__).parents[3]
PUBLISHED = sorted(path.parent.name for path in (ROOT / "results").glob("*/report.json"))
"""The benchmarks that are done."""


def test_something_is_published():
    assert "winner-a2c" in PUBLISHED


@pytest.mark.few
@pytest.mark.parametrize("name", PUBLISHED)
def test_results_have_the_hash_of_the_committed_file_and_documents_their_numbers_or_their_page(name):
    file, folder = ROOT / "benchmarks" / f"{name}.toml", ROOT / "results" / name
    assert json.loads((folder / FILE).read_text())["benchmark"] == read(file).digest
    known = quoted.tables(file, str(folder))
    told = 0
    for path in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        text = path.read_text()
        told += f"<!-- table: {name}: " in text or f"results/{name}/index.html" in text
        assert quotes.filled(text, known) == text, (
            f"python -m galton_experiments.benchmark.quoted {file} {folder} {path}"
        )
    assert told


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLISHED)
def test_numbers_and_page_are_made_of_the_data_to_the_byte(name, tmp_path):
    file, folder = ROOT / "benchmarks" / f"{name}.toml", ROOT / "results" / name
    found = load(Store(str(folder)), read(file))
    report.write(Store(str(tmp_path)), found)
    for made in (report.NUMBERS, report.PAGE):
        assert (tmp_path / made).read_bytes() == (folder / made).read_bytes(), made
    assert (tmp_path / "figures" / "best-of-n.svg").exists() == (found.protocol.budget.settings > 1)


def git(*arguments):
    return subprocess.run(["git", "-C", ROOT, *arguments], capture_output=True)


@pytest.mark.skipif(
    git("rev-parse", "--is-shallow-repository").stdout.strip() != b"false",
    reason="only a clone with its history knows what was committed when",
)
@pytest.mark.parametrize("name", PUBLISHED)
def test_the_file_was_committed_before_its_runs(name, tmp_path):
    """The commits that trained the parts have it, with the settings that the results' hash is of."""
    folder = ROOT / "results" / name
    record = json.loads((folder / "provenance.json").read_text())
    commits = {version["commit"] for part in record.values() for made in part["sweeps"] for version in made["versions"]}
    assert commits
    for commit in commits:
        assert re.fullmatch("[0-9a-f]{7,40}", str(commit)), commit  # none from a checkout with changes
        for file in {f"{name}.toml", "winner.toml"}:
            done = git("show", f"{commit}:benchmarks/{file}")
            assert done.returncode == 0, done.stderr
            (tmp_path / file).write_bytes(done.stdout)
        assert read(tmp_path / f"{name}.toml").digest == json.loads((folder / FILE).read_text())["benchmark"]


def test_how_much_the_head_decides_is_that_of_the_reports():
    """The first table of docs/winner.md: P(above the Gaussian) with one setting, on both kinds of tasks, and tuned."""
    text = (ROOT / "docs" / "winner.md").read_text()
    for start, name, head in (
        ("| MuJoCo, PPO | centred HL-Gauss, edges |", "winner-mujoco", "edges"),
        ("| Small tasks, PPO | centred HL-Gauss, edges |", "winner", "edges"),
        ("| Small tasks, A2C | centred HL-Gauss, width and edges |", "winner-a2c", "width-edges"),
    ):
        fresh, held_out = json.loads((ROOT / "results" / name / "report.json").read_text())["stages"].values()
        found = fresh["above"][head]["gaussian"], held_out["above"][head]["gaussian"], fresh["above_per_task"][head]
        assert " | ".join([start[:-2], *(f"{Interval(**p):.2f}" for p in found)]) + " |" in text


def test_what_is_told_of_heads_with_the_same_draws_is_the_reports():
    """The first section of docs/winner.md, and README's first two facts."""
    report = json.loads((ROOT / "results" / "heads" / "report.json").read_text())
    page, readme = ((ROOT / name).read_text() for name in ("docs/winner.md", "README.md"))
    at_steps, at_time = (report["factorial"][way] for way in ("equal_steps", "equal_time"))
    of_draws = report["scores_of_draws"]
    names = ("gaussian", "discretised", "centred")
    scores = {name: np.mean([of[name] for of in of_draws.values()], 0) for name in names}

    def chance(of, way, i):
        return Interval(*(of[way][end][i] for end in ("mean", "low", "high")))

    told = []
    for i, label in ((1, "Discretised Gaussian"), (2, "Centred HL-Gauss, reflected")):
        own = at_time[names[i]]
        quarter, one, per_task, same = (
            chance(at_steps, way, i) for way in ("top_quarter", "one_setting", "per_task", "same_draw")
        )
        cells = [quarter, chance(own, "top_quarter", 1), one, per_task, same, chance(own, "same_draw", 1)]
        assert " | ".join([f"| {label}", *(f"{cell:.2f}" for cell in cells)]) + " |" in page
        assert quarter.low < 0.5 < quarter.high  # neither is clearly ahead
        ahead = scores[names[i]] - scores["gaussian"]
        told.append((quarter, cells[5], (ahead > 0).sum(), f"by {ahead.mean():.3f}"))
    (quarter, at_equal_time, ahead, by), (_, _, of_centred, by_centred) = told
    assert abs(at_equal_time.mean - 0.5) < 0.02  # level
    assert f"a chance of {quarter:.2f}, where 0.5 is level" in readme
    assert f"it scores higher on {ahead} of 16. " in readme
    assert f"A free softmax scores higher on {of_centred}." in readme
    on = {task: int((np.array(of["centred"]) > of["gaussian"]).sum()) for task, of in of_draws.items()}
    assert on["reacher"] == 0
    best = scores["discretised"][0]
    assert best == max(of.max() for of in scores.values())
    of_16 = [draws[-1] for draws in at_steps["best_of"]["mean"]]
    more = Interval(*(at_steps["best_of_gain"][end][1][-1] for end in ("mean", "low", "high")))
    for words in (
        f"the interval of the discretised one reaches {quarter.high:.2f}.",
        f"scores higher on {ahead} of 16, on average {by} of",
        f"scores higher on {of_centred} draws, on average {by_centred}.",
        f"ahead on Swimmer with {on['swimmer']}.",
        "scores {:.2f} with the Gaussian, {:.2f} with the discretised one and {:.2f} with centred".format(*of_16),
        f"The first two differ by {more:.2f}.",
        f"It scores {best:.2f}, the most of all 48, where the Gaussian of `galton.PPO(env)` scores "
        f"{scores['gaussian'][1]:.2f}.",
    ):
        assert words in page, words


def test_what_is_told_of_fresh_seeds_of_three_robots_is_the_reports():
    """The section on them in docs/winner.md; by the rule of their file no method is better."""
    report = json.loads((ROOT / "results" / "heads-winners" / "report.json").read_text())
    page, above = (ROOT / "docs" / "winner.md").read_text(), report["stages"]["fresh"]["above"]
    names = ("gaussian-selected", "discretised-selected", "truncated-as-discretised", "centred-selected")
    chances = [Interval(**above[name]["gaussian"]) for name in names]
    assert all(chance.high < 0.5 for chance in chances[:3])
    assert chances[3].low < 0.5 < chances[3].high
    told = (
        "P over the three tasks is {:.2f} for its selected draw, {:.2f} for the discretised Gaussian, {:.2f} for the "
    )
    assert (told + "truncated one and {:.2f} for centred HL-Gauss. The first three").format(*chances) in page
    on_ant = report["stages"]["fresh"]["versus"]["centred-selected"]["ant"]["above"]
    assert f"on Ant it is above the Gaussian with P = {on_ant:.2f}." in page
    between = Interval(**above["discretised-selected"]["truncated-as-discretised"])
    assert f"P of the discretised above the truncated one is {between:.2f}." in page


@pytest.mark.parametrize(
    ("name", "given"),
    [
        pytest.param("winner-a2c", ("16", "48,326,400", "20,136,000", "12,084,000"), marks=pytest.mark.slow),
        pytest.param("winner", ("16", "32,438,784", "20,274,240", "12,185,120"), marks=pytest.mark.slow),
        ("winner-mujoco", ("12", "36,421,632", "30,720,000", "23,009,280")),
    ],
)
def test_every_method_got_as_many_draws_and_steps(name, given):
    known = load(Store(str(ROOT / "results" / name)), read(ROOT / "benchmarks" / f"{name}.toml"))
    rows = tables.budget(known).rows
    assert len(rows) == len(known.protocol.methods)
    assert {tuple(row[1:2] + row[3:-1]) for row in rows} == {given}
    for of_stage in known.runs.values():
        for runs in of_stage:
            seeds = {(row["trial"], row["seed"]) for row in runs.table.select(["trial", "seed"]).to_pylist()}
            assert len(seeds) == len({trial for trial, _ in seeds})  # a trial has the same seed under all methods


@pytest.mark.parametrize(
    ("benchmark", "name"),
    [("a2c-collapse", "all"), ("a2c-collapse", "all-but-decay"), ("a2c-one-setting", "recommended")],
)
def test_what_a2c_begins_with_leaves_no_run_at_its_start(benchmark, name):
    """One setting for all tasks: means of 20 runs, of which the worst has come three quarters of the way there."""
    found = json.loads((ROOT / "results" / benchmark / "report.json").read_text())["stages"]["fresh"]["results"]
    for task, least, rest in (("lqr", -12.5, -26.0), ("acrobot", -90, -500), ("bandit-16", 24.3, 0)):
        result = found[task][name]["shared"]
        assert result["judged"]["mean"] > least
        assert result["worst"] > rest + 0.75 * (least - rest)
        assert result["diverged"] == 0


def test_the_runs_that_fail_without_a_floor_under_sigma_are_as_many_as_told():
    table = pq.read_table(ROOT / "results" / "sigma-floor" / "data" / "fresh-lqr.parquet")
    table = table.filter(pc.equal(table["role"], "shared"))
    fails = pc.less(table["final_training"], -40)
    counts = [pc.sum(pc.and_(fails, pc.equal(table["method"], name))).as_py() for name in pc.unique(table["method"])]
    told = (ROOT / "docs" / "why.md").read_text().partition("<!-- runs that fail: sigma-floor -->")[2].split("\n\n")[1]
    rows = [row.split("|")[2:4] for row in told.splitlines()[2:]]
    assert [int(cell) for column in zip(*rows, strict=True) for cell in column] == counts


def test_as_many_runs_stay_where_acrobot_begins_as_told():
    """The counts of docs/options.md."""
    table = pq.read_table(ROOT / "results" / "held-entropy" / "data" / "fresh-acrobot.parquet")
    stay = table.filter((pc.field("role") == "shared") & (pc.field("final_judged") < -499))["method"].to_pylist()
    told = {"bonus": (20, 20), "floor": (2, 2), "held": (11, 7)}
    for name, counts in told.items():
        assert (stay.count(f"one-hot-{name}"), stay.count(f"centred-{name}")) == counts
    assert (stay.count("one-hot"), stay.count("centred")) == (2, 2)


def test_a_crossed_table_has_each_methods_mean_at_its_row_and_column():
    table = pq.read_table(ROOT / "results" / "lqr-rate" / "data" / "fresh-lqr.parquet")
    table = table.filter(pc.equal(table["role"], "shared"))
    known = quoted.tables(ROOT / "benchmarks" / "lqr-rate.toml", str(ROOT / "results" / "lqr-rate"))
    lines = [line.strip("| ").split(" | ") for line in known("lqr-rate: crossed, lqr").splitlines()]
    rows = dict(zip(("gaussian", "centred", "width-edges"), lines[2:], strict=True))
    assert [row[0] for row in rows.values()] == ["Gaussian", "Centred HL-Gauss", "+ width, edges"]
    for column, rate in enumerate((5, 10, 20, 32), 1):
        for name, row in rows.items():
            mean = pc.mean(table.filter(pc.equal(table["method"], f"{name}-{rate}"))["final_judged"]).as_py()
            assert row[column].split(" ± ")[0] == f"{mean:.2f}".replace("-", "−")


def test_as_many_are_behind_the_gaussian_under_a2c_as_told():
    """Where each task has a setting of its own, and the head that A2C begins with is among them."""
    found = json.loads((ROOT / "results" / "winner-a2c" / "report.json").read_text())["stages"]["fresh"]
    above = found["above_per_task"]
    assert sum(interval["high"] < 0.5 for interval in above.values()) == 20
    assert not any(interval["low"] > 0.5 for interval in above.values())
    assert [round(above["width-edges"][of], 3) for of in ("mean", "low", "high")] == [0.417, 0.338, 0.498]


def finals(benchmark, part, method, role="shared"):
    """What a method's runs of one part are judged by, in the order of their seeds."""
    table = pq.read_table(ROOT / "results" / benchmark / "data" / f"{part}.parquet").sort_by("trial")
    return np.array(table.filter((pc.field("method") == method) & (pc.field("role") == role))["final_judged"])


def test_what_is_told_of_pairs_of_runs_on_mujoco():
    """What docs/winner.md and README say beyond their tables: of Ant's part, and of pairs on single tasks."""

    def above(ours, theirs):
        return int((ours[:, None] > theirs).sum())

    known = functools.partial(finals, "winner-mujoco")
    others = ("walker", "swimmer", "inverted-double-pendulum", "lunar-lander")
    ours, theirs = ([known(f"held-out-{task}", of) for task in others] for of in ("edges", "gaussian"))
    without_ant = improvement(ours, theirs, paired=True)
    assert without_ant.mean == pytest.approx(0.63)
    assert 0.45 < without_ant.low < 0.55
    assert above(theirs[0], ours[0]) == 22
    behind = mean_interval(theirs[0] - ours[0])
    assert (round(float(behind.mean)), round(float(behind.high - behind.mean))) == (520, 363)
    assert (theirs[0] > ours[0]).all()
    on_reacher = [known("fresh-reacher", of) for of in ("edges", "gaussian")]
    assert (on_reacher[0] > on_reacher[1]).all()
    for head in ("hl-one-hot", "edges", "edges-critic"):
        on_ant = known("held-out-ant", head)
        assert above(on_ant, known("held-out-ant", "gaussian")) == 25
        assert on_ant.min() > 994.1
    for task, pairs in (("half-cheetah", 0), ("hopper", 20)):
        assert above(*(known(f"fresh-{task}", of, "per-task") for of in ("edges", "gaussian"))) == pairs


def test_documents_say_on_how_many_draws_the_head_is_ahead_of_the_gaussian():
    report = json.loads((ROOT / "results" / "winner-mujoco" / "report.json").read_text())
    head, gaussian = (
        np.mean([of[name] for of in report["scores_of_draws"].values()], 0) for name in ("edges", "gaussian")
    )
    ahead, n, behind = (head > gaussian).sum(), len(head), (gaussian - head).mean()
    page = (ROOT / "docs" / "winner.md").read_text()
    assert f"bins are ahead on {ahead} of the {n} draws. Their score is lower by {behind:.3f} on average" in page
