"""The second path, part 4: the claims on the bandits of Figure 3 (§5.2.2, §5.2.3, §7)."""

import numpy as np

from .claims import KINDS, paired
from .ranks import Found, against, compared, judged, marks_of
from .runs import CLASSIFIED, LABELS, PAPER, Task, begun, ends_of, null_of

CONTROLS = {"Init Gaussian": "bandit-init-gaussian", "Gaussian Exploration": "bandit-gaussian-exploration"}
METRICS = {"training_return": "training return", **KINDS}


def across(sweeps, constant, own):
    """The bandits by a constant, in its order; 'again' is the one with the bandit's own."""
    start = f"bandit-{constant}-"
    found = {float(name.removeprefix(start)): of for name, of in sweeps.items() if name.startswith(start)}
    found |= {own: sweeps["bandit-again"]} if "bandit-again" in sweeps else {}
    return dict(sorted(found.items()))


def in_pairs(one, other):
    return paired(one.runs[0], other.runs[0])


def costs(bandits):
    """Compare what the last of the bandits costs the Gaussian with what it costs each classification loss."""
    if len(bandits) < 2:
        return []
    first, last = bandits[min(bandits)], bandits[max(bandits)]
    drop = {x: first.final(x) - last.final(x) for x in PAPER}
    return [compared(LABELS[x], drop["gaussian"], drop[x], in_pairs(first, last)) for x in CLASSIFIED]


def noise(sweeps):
    return judged(costs(across(sweeps, "noise", 1.0)))


def gap_grows(sweeps):
    return judged(costs(across(sweeps, "d", 2.0)))


def degrades(sweeps):
    bandits = across(sweeps, "d", 2.0)
    if len(bandits) < 2:
        return judged([])
    few, many = bandits[min(bandits)], bandits[max(bandits)]
    return judged([compared(LABELS[x], few.final(x), many.final(x), in_pairs(few, many)) for x in PAPER])


def higher(sweeps):
    bandits = across(sweeps, "d", 2.0)
    return judged(
        [
            compared(f"{LABELS[x]} d = {d:g}", of.final(x), of.final("gaussian"), in_pairs(of, of))
            for x in CLASSIFIED
            for d, of in bandits.items()
            if len(bandits) > 1
        ]
    )


def pair_of(sweeps, control):
    """The winners under a control and without, where both were trained."""
    names = f"{CONTROLS[control]}-again", "bandit-again"
    return [sweeps[name] for name in names] if {*names} <= {*sweeps} else None


def starts_as_well(sweeps):
    both = pair_of(sweeps, "Init Gaussian")
    if not both:
        return judged([])
    scores = {"final": lambda of, x: of.final(x), "over training": lambda of, x: of.mean(x)}
    found = [
        compared(f"{LABELS[x]} {when}", *(score(of, x) for of in both), in_pairs(*both))
        for when, score in scores.items()
        for x in CLASSIFIED
    ]
    return judged(found, unless_contrary=True)


def equal_settings(sweeps, control, field, value):
    """The mean over training of every setting under a control, and of the same one without it, by loss."""
    under, plain = sweeps.get(CONTROLS[control]), sweeps.get("bandit")
    if under is None or plain is None:
        return {}
    means = []
    for sweep in (under, plain):
        curves = {
            id(runs): sweep.filled(begun(runs.curves["training_return"]), "training_return") for runs in sweep.runs
        }
        fields = ("loss", "learning_rate", "n_bins", "eta")
        means.append({tuple(r.setting[f] for f in fields): curves[id(r)].mean() for r in sweep.runs})
    assert all(runs.setting[field] == value for runs in under.runs)
    return {
        x: np.array([(mean, means[1][key]) for key, mean in means[0].items() if key[0] == x and key in means[1]]).T
        for x in CLASSIFIED
    }


def converges_faster(sweeps):
    pairs = equal_settings(sweeps, "Gaussian Exploration", "exploration", "gaussian")
    return judged([compared(LABELS[x], *pair, paired=True) for x, pair in pairs.items()])


def no_local_optimum(sweeps):
    both = pair_of(sweeps, "Gaussian Exploration")
    if not both:
        return judged([])
    left, missing = (25 - of.final("hl-one-hot") for of in both)
    names = {"less is missing": missing, "less than half is": missing / 2}
    return judged([compared(name, part, left, in_pairs(*both)) for name, part in names.items()])


def not_the_reason(sweeps):
    main = sweeps.get("bandit-again")
    if main is None:
        return judged([])

    def gain(of, x, metric, name=""):
        return compared(name, of.mean(x, metric), main.mean("gaussian", metric), in_pairs(of, main))

    known = [(x, metric) for metric in METRICS if main.has(metric) for x in CLASSIFIED]
    marks, _ = marks_of([gain(main, *key) for key in known])
    ahead = [key for key, mark in zip(known, marks, strict=True) if mark == "✓"]
    found: list[Found] = []
    for control in CONTROLS:
        both = pair_of(sweeps, control)
        those = [key for key in ahead if both and both[0].has(key[1])]
        found += [gain(both[0], *key, f"{LABELS[key[0]]} ({METRICS[key[1]]}), {control}") for key in those]
    return judged(found)


def next_bin(sweeps):
    bandits, grid = across(sweeps, "noise", 1.0), sweeps.get("bandit")
    task = grid and Task("bandit", grid, grid)
    if not bandits or task is None or null_of(task):
        return judged([])
    calm, (rest, best) = bandits[min(bandits)], ends_of(task)
    short = {x: best - calm.final(x, "evaluation_return") for x in CLASSIFIED}
    ours, width = short["hl-one-hot"], 20 / calm.of("hl-one-hot").setting["n_bins"]
    cost, shown = (1.5 * width) ** 2, (float(ours.mean()), float(np.median(ours)))
    near = against(f"at the next bin at most, which costs {cost:.2f}:", ours, cost, shown)
    share = (best - ours - rest) / (best - rest)
    return judged(
        [
            compared("shorter of the optimum than HL-Gauss:", ours, short["hl-gauss"], in_pairs(calm, calm)),
            near._replace(sign=-near.sign),
            against("by less than a tenth of the way from rest:", share, 0.9, shown),
        ]
    )


BANDITS = {
    "less_sensitive_to_noise": noise,
    "degrades_with_dimension": degrades,
    "higher_in_all_dimensions": higher,
    "gap_grows_with_dimension": gap_grows,
    "starts_as_well": starts_as_well,
    "converges_faster": converges_faster,
    "no_local_optimum": no_local_optimum,
    "exploration_is_not_the_reason": not_the_reason,
    "stops_at_the_next_bin": next_bin,
}
"""The functions that judge the bandits, by the name of the claim."""
