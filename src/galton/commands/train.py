"""galton train: one run, kept."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import jax
import pyarrow.parquet as pq
from rich.console import Console

from galton.analysis.comparison import curves
from galton.commands.common import (
    EnvName,
    LossName,
    Training,
    live_progress,
    parse,
    write_settings,
)
from galton.envs.registry import find_task, make
from galton.losses import find_loss
from galton.training.checkpoint import Checkpoint, save
from galton.training.devices import use_all_cores
from galton.training.folder import result_folder


@dataclasses.dataclass(frozen=True)
class Options:
    """Train one policy and keep it in a run folder: settings, metrics and a checkpoint."""

    env: EnvName
    training: Training
    loss: LossName = "hl-gauss"
    seed: int = 0
    out: Path | None = None
    """The run folder, by default runs/ENV-LOSS-SEED."""
    overwrite: bool = False
    """Replace what the folder holds once the run is done."""


def main(arguments: Sequence[str]) -> None:
    """Train and write config.json, metrics.parquet and the checkpoint."""
    options = parse(Options, "train", arguments)
    name, _ = find_task(options.env)
    label = find_loss(options.loss).label
    training, constants = options.training, options.training.constants()
    env = make(name, **constants)
    out = options.out or Path("runs", f"{name}-{options.loss}-{options.seed}")
    training.check([options.seed])
    console = Console()
    use_all_cores()
    with result_folder(out, options.overwrite) as folder:
        with live_progress(console) as follow:
            on_log = follow(f"{label} on {name}", training.steps, 1)
            result = training.run(env, options.loss, [options.seed], on_log)
        write_settings(folder, {"env": name, "loss": options.loss, "seed": options.seed} | training.record())
        pq.write_table(curves({options.loss: result}), folder / "metrics.parquet")
        learner = jax.tree.map(lambda x: x[0], result.learner)
        save(
            folder,
            Checkpoint(name, constants, result.config, training.hypers, options.seed, int(result.steps[-1]), learner),
        )
    console.print(
        f"training return {result.final('training_return')[0]:.2f}, "
        f"evaluation return {result.final('evaluation_return')[0]:.2f} (last 5%), "
        f"{result.steps_per_second:,.0f} steps/s after {result.compile_seconds:.1f} s of compiling"
    )
    if result.diverged_at[0] >= 0:
        console.print(f"[bold red]diverged at step {result.diverged_at[0]:,}[/]: the gradient was not finite")
    console.print(f"run folder: {out}")
