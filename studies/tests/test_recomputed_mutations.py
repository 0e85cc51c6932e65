"""Published results with changed numbers: a verdict turns where it should, by both paths, and else stays."""

import dataclasses

import numpy as np
import pyarrow as pa
import pytest

from studies.paper.standings import ahead
from studies.paper.trained import Trained

from .agreement import NAMES, agreed
from .recomputed.runs import CLASSIFIED, CURVES, TITLES, matrix, null_of, record_of, settings_of, sweep_of, tasks_of

GAUSSIAN, CENTRED = ("gaussian",), ("hl-gauss-centred",)
AGAIN, WHOLE = "{}-again", "{}"
HOLDS, FAILS, OPEN = "holds", "does not hold", "not decidable here"


def rows_of(table, keep):
    """Mark the runs of settings that are to be changed."""
    chosen = np.array([keep(setting) for setting in settings_of(record_of(table))])
    return chosen[table.column("setting").to_numpy()]


def put(table, name, values):
    """The table with other values in a column."""
    values = values.astype(np.float32)
    if values.ndim == 2:
        column = pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), type=table.schema.field(name).type)
    else:
        column = pa.array(values)
    return table.set_column(table.column_names.index(name), name, column)


def far(values):
    """Three times the way from the worst of all values to the best."""
    return 3 * (np.nanmax(values) - np.nanmin(values)) + 1


def moved(table, keep, sign, metrics=CURVES):
    """Some settings' returns so much higher, or lower, that no run of the others comes near."""
    rows = rows_of(table, keep)
    for metric in (name for name in metrics if name in table.column_names):
        curves, finals = matrix(table, metric).astype(float), table.column(f"final_{metric}").to_numpy().astype(float)
        by = sign * far([*curves.ravel(), *finals]) * rows
        table = put(put(table, metric, curves + by[:, None]), f"final_{metric}", finals + by)
    return table


def peaked(table, keep, sign):
    """A log point on the way far above all others."""
    curves = matrix(table, "training_return").astype(float)
    curves[rows_of(table, keep), curves.shape[1] // 2] += far(curves)
    return put(table, "training_return", curves)


def spread(table, keep, sign):
    """Finals a thousand times as far from their setting's mean, or as near."""
    finals, setting = (table.column(name).to_numpy().astype(float) for name in ("final_training_return", "setting"))
    rows = rows_of(table, keep)
    for i in np.unique(setting[rows]):
        own = setting == i
        finals[own] = finals[own].mean() + 1000.0**sign * (finals[own] - finals[own].mean())
    return put(table, "final_training_return", finals)


def lowered(table, keep, sign):
    """Final returns alone, as if the last log points of some settings had been far worse."""
    finals = table.column("final_training_return").to_numpy().astype(float)
    return put(table, "final_training_return", finals + sign * far(finals) * rows_of(table, keep))


def told_apart(table, keep, sign):
    """The table, or None where runs are so few that the one in the middle of them leaves nothing clear."""
    return table if table.num_rows >= 8 * len(settings_of(record_of(table))) else None


def of(losses, **fields):
    """Settings of these losses; `n_bins=min` are those with the smallest."""
    return losses, fields


def keeper(losses, fields, settings):
    """Return a function that says whether a setting is one of those that `of` describes."""
    own = [setting for setting in settings if setting["loss"] in losses]
    ends = {field: end(setting[field] for setting in own) for field, end in fields.items()} if own else {}
    return lambda setting: setting["loss"] in losses and all(setting[field] == end for field, end in ends.items())


def changed(tables, edits):
    """The tables with edits: (files, what to do, which settings, sign), on each task where files has braces."""
    found = {}
    for files, edit, (losses, fields), sign in edits:
        names = [files] if "{}" not in files else [files.format(task) for task in TITLES]
        for name in names:
            table = found.get(name, tables[name])
            if table is not None:
                found[name] = edit(table, keeper(losses, fields, settings_of(record_of(table))), sign)
    return found


def both_paths(trained, sweeps, new):
    """Either path's view of the results with new tables, and without those that are None."""
    old = (
        {name: of for name, of in trained.sweeps.items() if name not in new},
        {name: of for name, of in sweeps.items() if name not in new},
    )
    tables = {name: table for name, table in new.items() if table is not None}
    ours = {
        name: dataclasses.replace(trained.sweeps[name], table=table.replace_schema_metadata(None))
        for name, table in tables.items()
    }
    return Trained(old[0] | ours), old[1] | {name: sweep_of(table) for name, table in tables.items()}


UP, DOWN = (AGAIN, moved, of(GAUSSIAN), 1), (AGAIN, moved, of(GAUSSIAN), -1)
THEIRS_UP, THEIRS_DOWN = (AGAIN, moved, of(CLASSIFIED), 1), (AGAIN, moved, of(CLASSIFIED), -1)
MANY = (AGAIN, told_apart, of(()), 0)
LOW_RATE = {"learning_rate": min}
EXPLORES = "bandit-gaussian-exploration"


def either_way(files, edit, losses, sign=1, **fields):
    """A change after which a claim holds, and the same the other way round after which it does not."""
    return [([(files, edit, of(losses, **fields), way * sign)], verdict) for way, verdict in ((1, HOLDS), (-1, FAILS))]


CASES = {
    **{
        name: [([DOWN], HOLDS), ([UP], FAILS)] for name in ("ends_higher", "ends_higher_without_noise", "learns_faster")
    },
    "learns_sooner": [([DOWN, THEIRS_UP], HOLDS), ([UP, THEIRS_DOWN], FAILS)],
    "acrobot": [([UP], HOLDS), ([DOWN], FAILS)],
    "alike_between_seeds": [
        ([MANY, (AGAIN, spread, of(GAUSSIAN), sign), (AGAIN, spread, of(CLASSIFIED), -sign)], verdict)
        for sign, verdict in ((1, HOLDS), (-1, FAILS))
    ],
    "keeps_what_it_learns": [
        ([(AGAIN, peaked, of(GAUSSIAN), 1)], HOLDS),
        ([(AGAIN, peaked, of(CLASSIFIED), 1)], FAILS),
    ],
    # Only the bandit can be decided, and one task tells nothing of an order that changes.
    "order_changes": [([(AGAIN, moved, of(("hl-gauss",)), 1)], OPEN)],
    "less_sensitive_to_noise": [
        ([("bandit-noise-10", moved, of(GAUSSIAN), -1)], HOLDS),
        ([("bandit-noise-10", moved, of(CLASSIFIED), -1)], FAILS),
    ],
    "degrades_with_dimension": either_way("bandit-d-16", moved, (*GAUSSIAN, *CLASSIFIED), -1),
    "higher_in_all_dimensions": [
        (
            [(name, moved, of(GAUSSIAN), sign) for name in ("bandit-again", *(f"bandit-d-{d}" for d in (1, 4, 8, 16)))],
            verdict,
        )
        for sign, verdict in ((-1, HOLDS), (1, FAILS))
    ],
    "gap_grows_with_dimension": either_way("bandit-d-16", moved, GAUSSIAN, -1),
    "starts_as_well": either_way("bandit-init-gaussian-again", moved, CLASSIFIED),
    "converges_faster": either_way(EXPLORES, moved, CLASSIFIED),
    "no_local_optimum": either_way(f"{EXPLORES}-again", moved, CLASSIFIED),
    "exploration_is_not_the_reason": [
        (
            [
                ("bandit-again", moved, of(GAUSSIAN), -1),
                *((f"{name}-again", moved, of(CLASSIFIED), 4 * sign) for name in ("bandit-init-gaussian", EXPLORES)),
            ],
            verdict,
        )
        for sign, verdict in ((1, HOLDS), (-1, FAILS))
    ],
    "stops_at_the_next_bin": [([("bandit-noise-0", moved, of(("hl-one-hot",)), -1)], FAILS)],
    **{
        f"{label} is sensitive to {field}.": [([(WHOLE, lowered, of((loss,), **{name: min}), -1)], HOLDS)]
        for label, loss, field, name in (
            ("HL-Gauss", "hl-gauss", "the learning rate", "learning_rate"),
            ("HL-Gauss", "hl-gauss", "η", "eta"),
            ("HL-1-Hot", "hl-one-hot", "the learning rate", "learning_rate"),
            ("The Gaussian", "gaussian", "the learning rate", "learning_rate"),
        )
    },
    "With η too large HL-Gauss degrades.": [
        ([(WHOLE, lowered, of(("hl-gauss",), eta=end), -1)], verdict) for end, verdict in ((max, HOLDS), (min, FAILS))
    ],
    **{
        words: [([(WHOLE, lowered, of((loss,), n_bins=min), -1)], FAILS)]
        for words, loss in (
            ("HL-Gauss is robust to the number of bins.", "hl-gauss"),
            ("HL-1-Hot is robust to the number of bins.", "hl-one-hot"),
            ("HL-1-Hot is similarly robust to the number of bins as HL-Gauss.", "hl-one-hot"),
        )
    },
    "The Gaussian and HL-1-Hot are also sensitive to the learning rate, as HL-Gauss is.": [
        ([(WHOLE, lowered, of(losses, **LOW_RATE), -1)], verdict)
        for losses, verdict in (((*GAUSSIAN, "hl-one-hot"), HOLDS), (("hl-gauss",), FAILS))
    ],
    "Classification is more robust to hyperparameters.": [
        ([(WHOLE, lowered, of(losses, **LOW_RATE), -1)], verdict)
        for losses, verdict in ((GAUSSIAN, HOLDS), (CLASSIFIED, FAILS))
    ],
    "Over all settings, a higher fraction of classification's runs reaches a high return.": [
        ([(WHOLE, lowered, of((*CLASSIFIED, *CENTRED)), -1)], FAILS)
    ],
}


def test_every_claim_has_a_change_that_turns_it():
    assert {*CASES} == {*NAMES}


@pytest.mark.parametrize(
    ("name", "edits", "verdict"),
    [
        pytest.param(name, *case, id=f"{name} {case[1]}", marks=() if case is cases[0] else pytest.mark.slow)
        for name, cases in CASES.items()
        for case in cases
    ],
)
def test_a_change_turns_the_verdict(name, edits, verdict, tables, trained, sweeps):
    claim = agreed(name, *both_paths(trained, sweeps, changed(tables, edits)))
    assert claim.verdict == verdict, claim.number


def turned(table, keep, sign):
    """The same runs, the last setting first."""
    return table.take(np.argsort(-table.column("setting").to_numpy(), kind="stable"))


@pytest.mark.slow
def test_other_losses_and_another_order_turn_nothing(tables, trained, sweeps):
    edits = [(AGAIN, moved, of(CENTRED), 1), (AGAIN, turned, of(()), 0), (WHOLE, turned, of(()), 0)]
    changed_trained, changed_sweeps = both_paths(trained, sweeps, changed(tables, edits))
    assert changed_trained.sweeps["lqr-again"].table != trained.sweeps["lqr-again"].table
    for name in NAMES:
        known, found = agreed(name, trained, sweeps), agreed(name, changed_trained, changed_sweeps)
        assert (known.verdict, known.count, known.number) == (found.verdict, found.count, found.number)


@pytest.mark.parametrize("task", [task for task in TITLES if task != "acrobot"])
def test_a_gaussian_far_ahead_on_one_task_turns_that_alone(task, tables, trained, sweeps):
    edits = [(f"{task}-again", moved, of(GAUSSIAN), 1)]
    known = agreed("ends_higher", trained, sweeps)
    new = both_paths(trained, sweeps, changed(tables, edits))
    found = agreed("ends_higher", *new)
    judged = tasks_of(sweeps)[task]
    for before, after in zip(known.number.splitlines(), found.number.splitlines(), strict=True):
        if not before[2:].startswith(TITLES[task]):
            assert before[2:].split(", p")[0] == after[2:].split(", p")[0]
        elif judged.again.trials > 3 and not null_of(judged):
            assert after[0] == "✗"
            if judged.again.trials >= 8:  # with fewer nothing is clear beside all other decisions of the table
                assert (task, "gaussian") in ahead(new[0])
                assert not {(task, loss) for loss in CLASSIFIED} & ahead(new[0])


def lost(table, keep, sign):
    """The first trial of some settings diverges half way."""
    rows = rows_of(table, keep) & (table.column("trial").to_numpy() == 0)
    half = matrix(table, "steps")[:, matrix(table, "steps").shape[1] // 2]
    gone = pa.array(np.where(rows, half, table.column("diverged_at").to_numpy()).astype(np.int32))
    table = table.set_column(table.column_names.index("diverged_at"), "diverged_at", gone)
    for name in (name for name in table.column_names if name.startswith("final_")):
        table = put(table, name, np.where(rows, np.nan, table.column(name).to_numpy()))
    return table


@pytest.mark.slow
@pytest.mark.parametrize("losses", [GAUSSIAN, CLASSIFIED])
def test_runs_that_diverge_are_the_worst_of_all_by_both_paths(losses, tables, trained, sweeps):
    edits = [(AGAIN, lost, of(losses), 0), (WHOLE, lost, of(losses, learning_rate=max), 0)]
    new = both_paths(trained, sweeps, changed(tables, edits))
    for name in NAMES:
        agreed(name, *new)
