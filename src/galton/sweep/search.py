"""Settings that Optuna proposes, a round of them at a time; each round extends the plan of the sweep."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from galton.errors import require_integer
from galton.extras import needed
from galton.losses import LOSSES, find_loss
from galton.parts import settings
from galton.sweep.grid import MOST_SETTINGS, bases
from galton.sweep.study import Setting

with needed("grid is 'optuna', which", "optuna"):
    import optuna

FAILED = -1e30
"""What a setting with a diverged run is told to be worth."""


def search(
    means: Callable[[tuple[Setting, ...]], Mapping[Setting, float]],
    base: Mapping[str, Any],
    n: int,
    batch: int,
    seed: int = 0,
) -> None:
    """Ask Optuna for settings, train them and tell it their returns, until every loss has had n of them.

    Optuna's TPE sampler is seeded, and what it is told comes from the sweep. So, run again, it proposes what it
    proposed, the sweep knows the results, and the search goes on where it stopped.

    Args:
        means: trains all these settings, those of earlier rounds first; gives each one's mean final training return.
        base: fields of all settings; learning rates are searched around its own, as in `random_grid`.
        n: settings per loss.
        batch: settings per loss and round.
        seed: of the proposals.
    """
    require_integer("n_settings", n, 1, MOST_SETTINGS)
    require_integer("batch", batch, 1)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    searches = {loss: _begin(seed, loss) for loss in LOSSES}
    shared = dict(zip(LOSSES, bases([{"loss": loss} for loss in LOSSES], [base] * len(LOSSES)), strict=True))
    settings: dict[Setting, None] = {}
    for start in range(0, n, batch):
        asked: list[tuple[str, optuna.Trial, Setting]] = []
        for loss, study in searches.items():
            space = _space(loss, base["learning_rate"])
            for _ in range(min(batch, n - start)):
                trial = study.ask(space)
                asked.append((loss, trial, Setting({**shared[loss], "loss": loss, **trial.params})))
        settings |= {setting: None for _, _, setting in asked}
        found = means(tuple(settings))
        for loss, trial, setting in asked:
            searches[loss].tell(trial, found[setting] if np.isfinite(found[setting]) else FAILED)


def _begin(seed: int, loss: str) -> optuna.Study:
    entropy = np.random.SeedSequence((seed, *loss.encode())).generate_state(1)[0]
    sampler = optuna.samplers.TPESampler(seed=int(entropy), constant_liar=True)
    return optuna.create_study(direction="maximize", sampler=sampler)


def _space(loss: str, rate: float) -> dict[str, optuna.distributions.BaseDistribution]:
    rates = optuna.distributions.FloatDistribution(rate / 10, rate * 10, log=True)
    space: dict[str, optuna.distributions.BaseDistribution] = {"learning_rate": rates}
    if find_loss(loss).family == "histogram":
        space["n_bins"] = optuna.distributions.CategoricalDistribution([50, 100, 200])
    if "eta" in settings(find_loss(loss)):
        space["eta"] = optuna.distributions.FloatDistribution(0.1, 4.0, log=True)
    return space
