"""The table of a sweep's best settings."""

from rich.table import Table

from galton.losses import find_loss
from galton_experiments.sweep.results import Best


def winners(best: dict[str, Best]) -> Table:
    """A table of the best settings, a row for each loss."""
    from galton_experiments.analysis.statistics import mean_interval  # scipy takes a second, which `status` needn't

    table = Table(title="best setting per loss, by mean final training return: mean and 95% CI")
    for heading in ("loss", "setting", "training return", "evaluation return", "of settings"):
        table.add_column(heading, justify="left" if heading in ("loss", "setting") else "right")
    for loss, winner in best.items():
        training, evaluation = (
            f"{mean_interval(values):,.2f}" for values in (winner.final_training_return, winner.final_evaluation_return)
        )
        table.add_row(find_loss(loss).label, winner.setting.brief(), training, evaluation, str(winner.n_settings))
    return table
