"""What is selected, and what the runs that judge it say."""

import dataclasses
import itertools

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from galton import UsageError
from galton_experiments.analysis.statistics import holm
from galton_experiments.benchmark import stages
from galton_experiments.benchmark.draws import draws
from galton_experiments.benchmark.runs import gather
from galton_experiments.benchmark.selection import best_of_draws, normalised, select
from galton_experiments.benchmark.standings import standings

from .files import protocol
from .made_up import KNOWN, made_up

NAN = np.nan


@pytest.mark.parametrize("diverged", [False, True])
def test_runs_in_which_no_episode_ended_are_refused_and_not_taken_for_diverged(diverged):
    known = protocol(selection__metric="training_return")
    part = stages.tuning(known, draws(known))[0]
    tables = []
    for study in part.studies:
        n = len(study.settings) * study.trials
        columns = {"setting": np.repeat(np.arange(len(study.settings)), study.trials), "seed": np.arange(n)}
        columns |= {"trial": np.tile(np.arange(study.trials), len(study.settings))}
        columns |= {"diverged_at": np.full(n, 50 if diverged else -1), "steps": [[50, 100]] * n}
        tables.append(pa.table(columns | {"training_return": [[NAN, NAN]] * n}))
    if diverged:
        assert np.isnan(gather(part, tables, known.selection).finals("gaussian", "draw")).all()
    else:
        with pytest.raises(UsageError, match=r"tasks.bandit has 18 runs in whose 100 steps no episode ended"):
            gather(part, tables, known.selection)


def test_one_draw_is_selected_by_its_mean_percentile_and_one_for_each_task():
    judged = {
        "small": {"a": np.array([[0.1, 0.2], [0.3, 0.4]]), "b": np.array([[0.0, 0.05], [0.5, 0.6]])},
        "large": {"a": np.array([[900.0, 800.0], [100.0, 200.0]]), "b": np.array([[50.0, 60.0], [70.0, NAN]])},
    }
    scores = normalised(judged)
    assert scores["small"]["a"].tolist() == [[0.3125, 0.4375], [0.5625, 0.6875]]
    assert scores["large"]["b"].tolist() == [[0.1875, 0.3125], [0.4375, 0.0625]]
    selected = select(scores)
    assert selected.shared == {"a": 0, "b": 1}  # by mean returns "large" alone would decide
    assert selected.per_task == {"small": {"a": 1, "b": 1}, "large": {"a": 0, "b": 0}}


def test_a_rescaled_task_selects_the_same():
    rng = np.random.default_rng(0)
    judged = {task: {m: rng.normal(size=(8, 3)) for m in "abc"} for task in "xyz"}
    scaled = {task: {m: np.exp(1e-2 * runs) - 5 for m, runs in of.items()} for task, of in judged.items()}
    assert select(normalised(judged)) == select(normalised(scaled))


def test_of_equal_draws_the_first_is_selected_whatever_their_sums_round_to():
    of_task = (0.1, 0.2, 0.3)
    assert sum(of_task) != sum(reversed(of_task))
    scores = {
        str(i): {"a": np.array([[low], [high]])}
        for i, (low, high) in enumerate(zip(of_task[::-1], of_task, strict=True))
    }
    assert select(scores).shared == {"a": 0}


def test_the_best_of_n_draws_is_judged_by_seeds_that_did_not_choose_it():
    runs = np.random.default_rng(1).normal(size=(2, 4, 3))
    scores = {task: {"a": of} for task, of in zip("xy", runs, strict=True)}
    found = best_of_draws(scores, "a")
    for n in range(1, 5):
        shared, per_task = [], []
        for trial, subset in itertools.product(range(3), itertools.combinations(range(4), n)):
            others = [t for t in range(3) if t != trial]
            by = runs[:, :, others].mean(2)
            best = subset[int(np.argmax(by.mean(0)[[*subset]]))]
            shared.append(runs[:, best, trial].mean())
            of_task = [subset[int(np.argmax(by[task, [*subset]]))] for task in range(2)]
            per_task.append(np.mean([runs[task, best, trial] for task, best in enumerate(of_task)]))
        assert found.shared[n - 1] == pytest.approx(np.mean(shared))
        assert found.per_task[n - 1] == pytest.approx(np.mean(per_task))


def test_one_seed_chooses_and_judges():
    scores = {"x": {"a": np.array([[0.1], [0.5], [0.3]])}}
    assert best_of_draws(scores, "a").shared[-1] == 0.5


@pytest.mark.slow
def test_standings_are_what_plain_counting_finds():
    runs, finals = made_up()
    found = standings(KNOWN, runs)
    assert found.tasks == ("bandit", "noisy")
    scores = {}
    for of_task in finals.values():
        pool = np.concatenate([*of_task.values()])
        ranked = stats.rankdata(np.where(np.isnan(pool), -np.inf, pool)) - 0.5
        for i, key in enumerate(of_task):
            scores.setdefault(key, []).append(ranked[8 * i : 8 * i + 8] / pool.size)
    for (method, role), of in scores.items():
        assert found.scores[method][role].judged.mean == pytest.approx(np.mean(of))
        assert found.scores[method][role].middle.mean == pytest.approx(stats.trim_mean(np.ravel(of), 0.25))

    def share(ours, theirs, role):
        pairs = zip(scores[ours, role], scores[theirs, role], strict=True)
        return pytest.approx(np.mean([(x > y) + 0.5 * (x == y) for p, q in pairs for x in p for y in q]))

    for ours, theirs in (("bins", "gaussian"), ("gaussian", "ppo")):
        assert found.above[ours][theirs].mean == share(ours, theirs, "shared")
    for method in ("bins", "ppo"):
        assert found.above_per_task[method].mean == share(method, "gaussian", "per-task")
    assert found.above_per_task["bins"] != found.above["bins"]["gaussian"]
    gain = np.mean([y - x for x, y in zip(scores["gaussian", "shared"], scores["gaussian", "per-task"], strict=True)])
    assert found.sensitivity["gaussian"].mean == pytest.approx(gain)
    assert found.sensitivity["bins"] == (0, 0, 0)  # one setting in both roles: no luck in it
    assert found.above_in_training["bins"].mean == pytest.approx(1 - found.above["bins"]["gaussian"].mean)


def test_a_run_without_a_training_return_is_no_diverged_one():
    runs, _ = made_up()
    first = runs[0].table
    training = first["final_training"].to_numpy().copy()
    training[0] = np.nan
    changed = dataclasses.replace(runs[0], table=first.set_column(1, "final_training", [training]))
    before, found = standings(KNOWN, runs), standings(KNOWN, [changed, *runs[1:]])
    assert np.isnan([found.scores["bins"]["shared"].training.mean, found.above_in_training["bins"].mean]).all()
    for task, is_known in (("bandit", False), ("noisy", True)):
        assert np.isfinite(found.results[task]["bins"]["shared"].training.mean) == is_known
    assert found.above == before.above


def test_a_diverged_run_counts_as_the_worst_and_is_counted():
    runs, finals = made_up()
    found = standings(KNOWN, runs)
    pairs = []
    for task, of_task in finals.items():
        worst = np.nanmin([*of_task.values()])
        result = found.results[task]["ppo"]["shared"]
        assert (result.diverged, result.worst) == (1, worst)
        filled = np.where(np.isnan(of_task["ppo", "shared"]), worst, of_task["ppo", "shared"])
        assert result.judged.mean == pytest.approx(filled.mean())
        assert found.versus["ppo"][task].difference.mean == pytest.approx(
            (filled - of_task["gaussian", "shared"]).mean()
        )
        lowest, base = np.where(np.isnan(of_task["ppo", "shared"]), -1e9, filled), of_task["gaussian", "shared"]
        pairs.append((lowest, base))
        share = ((lowest[:, None] > base) + 0.5 * (lowest[:, None] == base)).mean()
        assert found.versus["ppo"][task].above == share
    wins = lambda a, b: np.sign(a[:, None] - b).sum()  # noqa: E731
    p = holm([stats.permutation_test(each, wins, permutation_type="samples").pvalue for each in pairs])
    np.testing.assert_allclose([of.p for of in found.versus["ppo"].values()], p)


def test_held_out_tasks_have_no_setting_of_their_own():
    found = standings(KNOWN, made_up("held-out")[0])
    assert found.tasks == ("four",)
    assert found.sensitivity == found.above_per_task == {}
    assert [*found.scores["bins"]] == ["shared"]
