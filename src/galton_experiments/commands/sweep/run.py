"""galton sweep ENV: plan, train, and keep the results."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from galton.cli._options import AlgorithmName, EnvName, Training, folder_name
from galton.cli._parsing import TrainingOptions, parse
from galton.errors import require_integer
from galton_experiments.commands.sweep._folder import conclude
from galton_experiments.commands.sweep._workers import Workers, go_with
from galton_experiments.sweep import engine
from galton_experiments.sweep.grid import GRIDS, find_grid
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Setting, Study


@dataclasses.dataclass(frozen=True)
class Options:
    """Train every setting of a grid many times. Run it again to go on where it stopped.

    Also: `galton sweep status DIR`, `results DIR`, `rerun DIR --to DIR`, `shard DIR INDEX`.
    """

    env: EnvName
    algorithm: AlgorithmName = "a2c"
    """The algorithm that learns; the defaults of its settings are its own."""
    grid: Annotated[str, tyro.conf.arg(metavar="{" + ",".join(GRIDS) + "} or FILE.toml")] = "paper"
    """The settings: the paper's (App. C.2), random ones around them, or the [[grid]] tables of a file."""
    n_settings: int = 16
    """Settings per loss of the random grid."""
    trials: int = 20
    """Runs of each setting."""
    seed: int = 0
    """Of the study: another one gives every run a fresh seed."""
    common_seeds: bool = False
    """Give trial t of every setting the same seed, so that settings are compared in pairs."""
    eval_mean: bool = False
    """Evaluate once more by the mean of the policy's distribution, for the column mean_action_return."""
    out: str | None = None
    """The folder, by default runs/sweep-ENV or runs/sweep-ENV-ALGORITHM; or an address that fsspec opens, such as
    s3://bucket/folder."""
    shard_width: int | None = None
    """Runs that are trained side by side by one worker; by default 16 on Galton's own environments, 32 on others."""
    extend: bool = False
    """Add to the plan that the folder holds what it lacks of this grid."""
    plan_only: bool = False
    """Write the plan and stop: its shards are for `galton sweep shard`."""
    imports: tuple[str, ...] = ()
    """Modules that every worker imports first, where losses or environments of your own are registered."""
    workers: Workers = dataclasses.field(default_factory=Workers)
    training: TrainingOptions = dataclasses.field(default_factory=Training)

    @property
    def folder(self) -> str:
        """The folder or address of plan and results, by default one named after the sweep."""
        return self.out or str(Path("runs", f"sweep-{folder_name(self.env, self.algorithm)}"))


def main(arguments: Sequence[str]) -> None:
    """Plan the sweep, train what is not done yet, and write and show the results."""
    options = parse(Options, "sweep", arguments)
    training = options.training
    training.find(options.env)
    store = Store(options.folder)
    go_with(options, "n_settings", options.grid == "random", "grid 'random'")
    options.workers.check()
    if options.shard_width is not None:
        require_integer("shard_width", options.shard_width, 1)
    study = Study(
        options.env,
        find_grid(options.grid, options.env, Setting(training.words).record(), options.n_settings),
        options.trials,
        training.steps,
        training.logs,
        training.eval_episodes,
        training.env_kwargs,
        options.seed,
        options.imports,
        options.common_seeds,
        options.eval_mean,
    )
    if options.plan_only:
        with store.lock():
            plan = engine.prepare(store, study, options.shard_width, options.extend)
        print(f"{plan.n_runs:,} runs in {plan.n_shards:,} shards: {store.url}")
        return
    with store.lock():
        with options.workers.hired() as carry_out:  # before there is a plan, which the next call would meet
            plan = engine.prepare(store, study, options.shard_width, options.extend)
            carry_out(store, plan)
        conclude(store, plan)
