"""The table that `galton compare` prints."""

from rich import box
from rich.table import Table

from galton.decimals import fitting
from galton.envs.base import Environment
from galton_experiments.analysis.comparison import Row, label_of, rest_of


def table(rows: list[Row], env: Environment | None, at_rest: float | None = None) -> Table:
    """A row per loss, with its share of the way to the optimum where that is known, and what the numbers mean."""
    shares = any(row.rest_to_optimum is not None for row in rows)
    view = Table(
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        caption="\n".join(_notes(rows, env if shares else None, at_rest)).replace("-", "−"),
        caption_justify="left",
    )
    view.add_column("loss")
    for heading in ("training\nreturn", "evaluation\nreturn", *["rest →\noptimum"] * shares, "steps/s", "diverged"):
        view.add_column(heading, justify="right", no_wrap=True)
    form = fitting(*(of.mean for row in rows for of in (row.training_return, row.evaluation_return)))
    for row in rows:
        share = f"{row.rest_to_optimum:.1%}".replace("-", "−") if row.rest_to_optimum is not None else "—"
        view.add_row(
            label_of(row.loss),
            f"{row.training_return:{form}}",
            f"{row.evaluation_return:{form}}",
            *[share] * shares,
            f"{row.steps_per_second:,.0f}",
            str(row.diverged),
        )
    return view


def _notes(rows: list[Row], env: Environment | None, at_rest: float | None) -> list[str]:
    """Return the notes below the table; one on the optimum only with an environment that knows it."""
    notes = ["final returns: mean over runs ± 95% CI, last 5% of training"]
    if any(row.diverged for row in rows):
        notes.append("diverged runs are left out of these means; in the verdicts they count as the worst of all")
    if env is not None:
        rest = rest_of(env, at_rest)
        what = "doing nothing" if rest == at_rest else "acting at random"
        notes.append(
            f"rest → optimum, by evaluation: {what}, {rest:.2f}, is 0%, the optimum {env.optimal_return:.2f} 100%"
        )
    seconds = ", ".join(f"{row.compile_seconds:.1f} s" for row in rows)
    return [*notes, f"steps/s: training and evaluation; compiling apart: {seconds}"]
