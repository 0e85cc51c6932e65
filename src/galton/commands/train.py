"""galton train: one run, kept, and gone on with."""

import dataclasses
import json
import math
import shutil
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from galton import callbacks
from galton.agent import A2C, InexactResume
from galton.commands._options import (
    EnvName,
    LossName,
    Training,
    parse,
    short_name,
    write_settings,
)
from galton.commands._progress import live_progress
from galton.envs.base import Environment, HostTask
from galton.errors import BrokenEnvironmentError, DivergenceError, UsageError, require
from galton.losses import find_loss
from galton.training.devices import use_all_cores

MODEL, BEST, METRICS = "model.safetensors", "best_model.safetensors", "metrics.jsonl"


@dataclasses.dataclass(frozen=True)
class Options:
    """Train one policy in a run folder: its settings, its metrics and its model, saved as it goes."""

    env: EnvName
    training: Training
    loss: LossName = "hl-gauss"
    seed: int = 0
    out: Path | None = None
    """The run folder, by default runs/ENV-LOSS-SEED."""
    overwrite: bool = False
    """Replace a run that the folder holds."""
    resume: bool = False
    """Go on with the run that the folder holds, up to `steps` in all. The result is that of a run without a break
    where the environment can be put back into its state; else its episodes start anew, and you are told."""
    save_every: int = 50_000
    """Steps between saves of the model; it is also saved at the end and when you interrupt."""
    tensorboard: bool = False
    """Write logs for TensorBoard too."""


def main(arguments: Sequence[str]) -> None:
    """Train and write config.json, metrics.jsonl, model.safetensors and best_model.safetensors."""
    options = parse(Options, "train", arguments)
    training, label = options.training, find_loss(options.loss).label
    out = options.out or Path("runs", f"{short_name(options.env)}-{options.loss}-{options.seed}")
    training.check([options.seed])
    require(options.save_every >= 1, f"save_every is {options.save_every}; it must be at least 1")
    env = training.find(options.env)
    _check_folder(out, options)
    console = Console()
    use_all_cores()
    with live_progress(console) as follow:
        model = _resumed(out, options, env) if options.resume else _new(options, env)
        remaining = training.steps - model.num_timesteps
        require(
            remaining > 0,
            f"steps is {training.steps}, which the run in {out} has reached; name more to go on with it",
        )
        if not options.resume:
            _begin(out, options)
        progress = follow(f"{label} on {options.env}", training.steps, 1)
        evaluate = callbacks.Evaluate(1, max(1, training.eval_episodes), best_model=out / BEST)
        evaluate.best = _known(out / METRICS).get("eval/best_mean_reward", -math.inf)
        calls: list[callbacks.Callback] = [evaluate] if training.eval_episodes else []
        calls.append(callbacks.JSONLines(out / METRICS))
        if options.tensorboard:
            calls.append(callbacks.TensorBoard(out / "tensorboard"))
        calls.append(callbacks.Checkpoint(out / MODEL, options.save_every))
        calls.append(lambda model, _: progress(model.num_timesteps, None))
        try:
            model.learn(remaining, calls, progress_bar=False, log_interval=_interval(training, model))
        except BrokenEnvironmentError:
            model.save(out / MODEL)
            raise
        except KeyboardInterrupt:
            model.save(out / MODEL)
            print(
                f"galton: interrupted at step {model.num_timesteps:,}; the same command with --resume goes on",
                file=sys.stderr,
            )
            sys.exit(130)
        except DivergenceError as error:
            model.save(out / MODEL)
            raise UsageError(str(error)) from None
    model.save(out / MODEL)
    last = _known(out / METRICS)
    training_return, evaluation_return, speed = (
        f"{last[name]:,.2f}" if name in last else "not known"
        for name in ("rollout/ep_rew_mean", "eval/mean_reward", "time/fps")
    )
    console.print(
        f"training return {training_return}, evaluation return {evaluation_return}, {speed} steps/s\nrun folder: {out}",
        highlight=False,
        soft_wrap=True,
    )


def _new(options: Options, env: Environment | HostTask) -> A2C:
    config = dataclasses.asdict(options.training.config) | {"loss": options.loss}
    return A2C(env, **config, **options.training.hypers._asdict(), seed=options.seed)


def _resumed(out: Path, options: Options, env: Environment | HostTask) -> A2C:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", InexactResume)
        model = A2C.load(out / MODEL, env)
    for warning in told:
        print(f"galton: {warning.message}", file=sys.stderr)
    asked = dataclasses.replace(options.training.config, loss=options.loss)
    for what, own, other in (
        ("config", model.config, asked),
        ("hypers", model.hypers, options.training.hypers),
        ("seed", model.seed, options.seed),
    ):
        require(own == other, f"{what} is {other}, but the run in {out} has {own}; give the same options to resume it")
    lines = (out / METRICS).read_text().splitlines(keepends=True) if (out / METRICS).exists() else []
    kept = [line for line in lines if json.loads(line)["time/total_timesteps"] <= model.num_timesteps]
    (out / METRICS).write_text("".join(kept))  # what a killed process logged after its last save is trained again
    return model


def _interval(training: Training, model: A2C) -> int:
    """Updates between log points: as many as make the wanted number of points, or as the run had."""
    size = model.config.n_steps * model.config.n_envs
    if model.num_timesteps:
        return model.log_interval // size
    return math.ceil(math.ceil(training.steps / size) / training.logs)


def _check_folder(out: Path, options: Options) -> None:
    if options.resume:
        require((out / MODEL).exists(), f"out is {out}, which holds no {MODEL} to resume")
        return
    if not out.exists():
        return
    require(out.is_dir(), f"out is {out}, which is a file; name a folder")
    if any(out.iterdir()):
        require(
            options.overwrite,
            f"out is {out}, which is in use; name another folder or give --overwrite or --resume",
        )
        require(
            (out / "config.json").exists() and not Path.cwd().is_relative_to(out.resolve()),
            f"out is {out}, which is not a run folder and is not overwritten; name another",
        )


def _begin(out: Path, options: Options) -> None:
    try:
        if out.exists():
            shutil.rmtree(out)
        out.mkdir(parents=True)
        settings = {"env": options.env, "loss": options.loss, "seed": options.seed}
        write_settings(out, settings | options.training.record())
    except OSError as error:
        raise UsageError(f"out is {out}, which can't be written: {error.strerror}; name another folder") from None


def _known(path: Path) -> dict[str, float]:
    """The last number of each metric that was written down."""
    known: dict[str, float] = {}
    for line in path.read_text().splitlines() if path.exists() else []:
        known |= {name: value for name, value in json.loads(line).items() if value is not None}
    return known
