"""galton train: one run, kept, and gone on with."""

import dataclasses
import json
import math
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from galton import callbacks
from galton.cli._options import AlgorithmName, EnvName, LossName, Training, command_line, folder_name
from galton.cli._parsing import TrainingOptions, parse
from galton.cli._progress import OnLog, live_progress
from galton.devices import use_all_cores
from galton.envs.base import Environment
from galton.envs.host.base import HostTask
from galton.errors import DivergenceError, UsageError, require
from galton.losses import find_loss
from galton.models import InexactResume, Model
from galton.saving import files
from galton.saving.result_folder import check_free, claimed, replacing, write_settings

MODEL, BEST, METRICS = "model.safetensors", "best_model.safetensors", "metrics.jsonl"


@dataclasses.dataclass(frozen=True)
class Options:
    """Train one policy in a run folder: its settings, its metrics and its model, saved as it goes."""

    env: EnvName
    training: TrainingOptions
    loss: LossName = "hl-gauss"
    algorithm: AlgorithmName = "a2c"
    """What learns; the defaults of its settings are its own."""
    seed: int = 0
    """Of everything random; the same seed gives the same run."""
    out: Path | None = None
    """The run folder, by default runs/ENV-LOSS-SEED, or runs/ENV-ALGORITHM-LOSS-SEED."""
    overwrite: bool = False
    """Replace a run that the folder holds."""
    resume: bool = False
    """Go on with the run that the folder holds, up to `steps` in all. The result is that of a run without a break
    where the environment can be put back into its state; else its episodes start anew, and you are told."""
    save_every: int = 50_000
    """Steps between saves of the model; it is also saved at the end and when you interrupt."""
    tensorboard: bool = False
    """Write logs for TensorBoard too."""

    @property
    def folder(self) -> Path:
        """The run folder, named or by default."""
        return self.out or Path("runs", f"{folder_name(self.env, self.algorithm)}-{self.loss}-{self.seed}")


def main(arguments: Sequence[str]) -> None:
    """Train and write config.json, metrics.jsonl, model.safetensors and best_model.safetensors."""
    options = parse(Options, "train", arguments)
    out, steps, label = options.folder, options.training.steps, find_loss(options.loss).label
    options.training.check([options.seed])
    require(options.save_every >= 1, f"save_every is {options.save_every}; it must be at least 1")
    env = options.training.find(options.env)
    _check_folder(options)
    use_all_cores()
    with claimed(out), live_progress(Console()) as follow:
        _check_folder(options)  # nobody else can change it now
        model = _resumed(options, env) if options.resume else _new(options, env)
        require(
            model.num_timesteps < steps,
            f"steps is {steps}, which the run in {out} has reached; name more to go on with it",
        )
        _learn(model, options, follow(f"{label} on {options.env}", steps, 1))
    last = _known(out)
    training_return, evaluation_return, speed = (
        f"{last[name]:,.2f}" if name in last else "not known"
        for name in ("rollout/ep_rew_mean", "eval/mean_reward", "time/fps")
    )
    print(f"training return {training_return}, evaluation return {evaluation_return}, {speed} steps/s")
    print(f"run folder: {out}")


def _check_folder(options: Options) -> None:
    if options.resume:
        there = (options.folder / MODEL).exists()
        require(there, f"out is {options.folder}, which holds no {MODEL} to resume")
    else:
        check_free(options.folder, options.overwrite, "--overwrite or --resume")


def _new(options: Options, env: Environment | HostTask) -> Model:
    config = dataclasses.replace(options.training.config, loss=options.loss)
    return Model.of(env, config, options.training.hypers, options.seed)


def _resumed(options: Options, env: Environment | HostTask) -> Model:
    out = options.folder
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", InexactResume)
        model = Model.load(out / MODEL, env)
    for warning in told:
        print(f"galton: {warning.message}", file=sys.stderr)
    asked = dataclasses.replace(options.training.config, loss=options.loss)
    for what, own, other in (
        ("config", model.config, asked),
        ("hypers", model.hypers, options.training.hypers),
        ("seed", model.seed, options.seed),
    ):
        require(own == other, f"{what} is {other}, but the run in {out} has {own}; give the same options to resume it")
    return model


def _learn(model: Model, options: Options, progress: OnLog) -> None:
    """Train what is missing. However it ends, a model that has learnt something is kept."""
    record = _Record(options, model.num_timesteps)
    calls: list[callbacks.Callback] = [record, lambda model, _: progress(model.num_timesteps, None)]
    remaining = options.training.steps - model.num_timesteps
    try:
        model.learn(remaining, calls, progress_bar=False, log_interval=_interval(options.training, model))
    except DivergenceError as error:
        raise UsageError(str(error)) from None
    except KeyboardInterrupt:
        step = model.num_timesteps
        if not step:
            raise
        print(f"galton: interrupted at step {step:,}; the same command with --resume goes on", file=sys.stderr)
        sys.exit(130)
    finally:
        if model.num_timesteps:
            record.save(model)


def _interval(training: Training, model: Model) -> int:
    """Updates between log points: as many as make the wanted number of points, or as the run had."""
    size = model.config.n_steps * model.config.n_envs
    if model.num_timesteps:
        return model.log_interval // size
    return math.ceil(math.ceil(training.steps / size) / training.logs)


class _Record:
    """What is kept of a run. Its folder is begun at the first log point: until then an earlier run stays there."""

    def __init__(self, options: Options, start: int) -> None:
        self._options, self._start = options, start
        self._calls: list[callbacks.Callback] = []

    def __call__(self, model: Model, log: callbacks.Log) -> None:
        """Write down what is due at a log point."""
        self._begin()
        for call in self._calls:
            call(model, log)

    def save(self, model: Model) -> None:
        """Write the model, as it is now, into the run folder."""
        self._begin()
        model.save(self._options.folder / MODEL)

    def _begin(self) -> None:
        options, out = self._options, self._options.folder
        if self._calls:
            return
        if options.resume:
            _forget_after(self._start, out / METRICS)
        else:
            given = {"env": options.env, "loss": options.loss, "seed": options.seed}
            with replacing(out, options.overwrite) as folder:
                write_settings(folder, given | options.training.record() | {"command": command_line()})
        if options.training.eval_episodes:
            evaluate = callbacks.Evaluate(1, options.training.eval_episodes, best_model=out / BEST)
            evaluate.best = _known(out).get("eval/best_mean_reward", -math.inf)
            self._calls.append(evaluate)
        self._calls.append(callbacks.JSONLines(out / METRICS))
        if options.tensorboard:
            self._calls.append(callbacks.TensorBoard(out / "tensorboard"))
        self._calls.append(callbacks.Checkpoint(out / MODEL, options.save_every))


def _forget_after(step: int, path: Path) -> None:
    """Drop what a killed process logged after its last save, at this step: it is trained again."""
    lines = path.read_text().splitlines(keepends=True) if path.exists() else []
    kept = [line for line in lines if json.loads(line)["time/total_timesteps"] <= step]
    files.write(path, "".join(kept).encode())


def _known(folder: Path) -> dict[str, float]:
    """The last number of each metric that was written down."""
    path = folder / METRICS
    known: dict[str, float] = {}
    for line in path.read_text().splitlines() if path.exists() else []:
        known |= {name: value for name, value in json.loads(line).items() if value is not None}
    return known
