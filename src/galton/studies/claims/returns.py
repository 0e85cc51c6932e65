"""What the paper says of returns on its seven tasks (abstract, §1, §5.2.1, §7)."""

from collections.abc import Iterable

from galton.analysis.page import Claim
from galton.analysis.statistics import Interval, difference_interval
from galton.studies.base import Data, present
from galton.studies.claims.verdicts import NOT_TRAINED, UNKNOWN, listed, sorted_out, verdict
from galton.studies.measures import better_classification, final_return, winner
from galton.studies.sweeps import TASKS


def _against_regression(data: Data, score: str, tasks: Iterable[str]) -> dict[str, Interval]:
    return {TASKS[task].title: better_classification(data, task, score)[1] for task in tasks}


def ends_higher(data: Data) -> Claim:
    """§5.2.1, the main result."""
    gaps = _against_regression(data, "final", [task for task in present(data) if task != "acrobot"])
    return Claim(
        "Abstract, §5.2.1",
        "Classification reaches a higher return at the end of training, in almost all instances but Acrobot.",
        "final training return on fresh seeds: better of HL-1-Hot and HL-Gauss − Gaussian",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-2",
    )


def learns_faster(data: Data) -> Claim:
    """§5.2.1, data efficiency."""
    gaps = _against_regression(data, "speed", [task for task in present(data) if task != "acrobot"])
    return Claim(
        "Abstract, §5.2.1",
        "Classification learns faster, in almost all instances but Acrobot.",
        "training return averaged over all of training, on fresh seeds: better of the two − Gaussian",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-2",
    )


def acrobot(data: Data) -> Claim:
    """§5.2.1, the exception."""
    gains = _against_regression(data, "final", present(data, ("acrobot",)))
    gaps = {name: Interval(-gain.mean, -gain.high, -gain.low) for name, gain in gains.items()}
    return Claim(
        "§5.2.1",
        "On Acrobot regression outperforms classification.",
        "final training return on fresh seeds: Gaussian − better of HL-1-Hot and HL-Gauss",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-9",
    )


def more_stable(data: Data) -> Claim:
    """§1, contribution 4."""
    ratios = {}
    for task in present(data):
        summary = winner(data, task)
        gaussian = final_return(summary, "gaussian").std(ddof=1)
        best, _ = better_classification(data, task)
        ratios[TASKS[task].title] = float(final_return(summary, best).std(ddof=1) / gaussian)
    less = [name for name, ratio in ratios.items() if ratio < 1]
    holds = "holds" if len(less) == len(ratios) else "holds in part" if less else "does not hold"
    return Claim(
        "§1",
        "Classification learns more stably.",
        "standard deviation of the final training return between seeds: better classification ÷ Gaussian",
        "; ".join(f"{name} {ratio:.2f}" for name, ratio in ratios.items()),
        holds if ratios else UNKNOWN,
        f"Seeds differ less on {', '.join(less) or 'no task'}." if ratios else NOT_TRAINED,
        "figure-2",
    )


def order_changes(data: Data) -> Claim:
    """§7."""
    gaps = {
        TASKS[task].title: difference_interval(
            final_return(winner(data, task), "hl-gauss"),
            final_return(winner(data, task), "hl-one-hot"),
        )
        for task in present(data)
    }
    signs = {bool(gap.mean > 0) for gap in gaps.values() if gap.low > 0 or gap.high < 0}
    return Claim(
        "§7",
        "HL-1-Hot and HL-Gauss often differ little, and which is better changes across tasks.",
        "final training return on fresh seeds: HL-Gauss − HL-1-Hot",
        listed(gaps),
        UNKNOWN if len(gaps) < 2 else "holds" if len(signs) != 1 else "holds in part",
        sorted_out(gaps),
        "figure-2",
    )
