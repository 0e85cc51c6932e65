"""galton train: one run, kept, and gone on with."""

import dataclasses
import json
import math
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

from galton import callbacks
from galton.agents import read, words_of
from galton.algorithms import Agent
from galton.cli._kept_model import KeptModel
from galton.cli._options import (
    AlgorithmName,
    EnvName,
    LossName,
    PresetName,
    Training,
    command_line,
    folder_name,
    plain_name,
    short_name,
)
from galton.cli._parsing import COMMON, TrainingOptions, parse
from galton.cli._progress import Show, live_progress, plain_console
from galton.cli._reading import Imports
from galton.cli._runs import forget_after, known
from galton.decimals import fitting
from galton.devices import use_all_cores
from galton.envs.find import find
from galton.envs.jax_task import JaxTask
from galton.envs.registry import is_known, read_constants
from galton.envs.task import Task
from galton.errors import DivergenceError, UsageError, require
from galton.losses import find_loss
from galton.models import InexactResume, Model
from galton.models.file import Taken
from galton.presets import PAPER
from galton.saving import files
from galton.saving.result_folder import (
    BEST,
    CONFIG,
    METRICS,
    MODEL,
    check_free,
    claimed,
    read_settings,
    replacing,
    write_settings,
)
from galton.training.size import check_size
from galton.training.yardsticks import N_EPISODES, logged


@dataclasses.dataclass(frozen=True)
class Options:
    """Train one policy in a run folder: its settings, its metrics and its model, saved as it goes."""

    env: EnvName
    training: TrainingOptions
    loss: LossName = ""
    preset: PresetName = ""
    algorithm: AlgorithmName = "ppo"
    """The algorithm that learns; the defaults of its settings are its own."""
    seed: int = 0
    """Of everything random; the same seed gives the same run."""
    out: Path | None = None
    """The run folder, by default runs/ENV-ppo-LOSS-SEED, or runs/ENV-LOSS-SEED under A2C; without a loss that is named
    it has the preset in its place, as in runs/ENV-ppo-gaussian-preset-SEED."""
    overwrite: bool = False
    """Replace a run that the folder holds, once the new one has come to its first log point."""
    resume: bool = False
    """Go on with the run that the folder holds, up to `steps` in all. The result is that of a run without a break
    where the environment can be put back into its state; else its episodes start anew, and you are told."""
    save_every: int = 50_000
    """Steps between saves of the model; it is also saved at the end and when you interrupt."""
    imports: Imports = ()
    tensorboard: bool = False
    """Write logs for TensorBoard too."""

    @property
    def folder(self) -> Path:
        """The run folder, named or by default."""
        kind = self.loss if self.preset == PAPER else f"{self.preset}-preset"
        name = f"{folder_name(self.env, self.algorithm)}-{plain_name(kind)}-{self.seed}"
        return self.out or Path("runs", name)


def main(arguments: Sequence[str]) -> None:
    """Train and write config.json, metrics.jsonl, model.safetensors and best_model.safetensors."""
    options = parse(Options, "train", arguments, eval_episodes=10, common=COMMON)  # they choose the best model
    out, steps, label = options.folder, options.training.steps, find_loss(options.loss).label
    options.training.check([options.seed])
    require(options.save_every >= 1, f"save_every is {options.save_every}; it must be at least 1")
    require(not (options.resume and options.overwrite), "--resume and --overwrite are both given; give one of them")
    use_all_cores(runs=1)  # before the environment's module computes something
    env = options.training.find(options.env)
    check_size(env, _agent(options), 1, options.training.eval_episodes)
    _check_folder(options)
    record = _Record(options)
    with claimed(out), live_progress(plain_console(), record.model.save_taken) as follow:
        _check_folder(options)  # nobody else can change it now
        model = _resumed(options, env) if options.resume else Model.of(env, _agent(options), options.seed)
        require(
            model.num_timesteps < steps,
            f"steps is {steps}, which the run in {out} has reached; name more to go on with it",
        )
        head = label if model.agent.box.numbers else "Softmax"
        record.start, record.show = model.num_timesteps, follow(f"{head} on {options.env}", steps, 1)
        _learn(model, options, record)
    last = known(out / METRICS) | ({} if options.training.eval_episodes else {"eval/mean_reward": math.nan})
    training_return, evaluation_return, speed = (
        f"{last[name]:{fitting(last[name])}}" if math.isfinite(last.get(name, math.nan)) else "not known"
        for name in ("rollout/ep_rew_mean", "eval/mean_reward", "time/fps")
    )
    print(f"training return {training_return}, evaluation return {evaluation_return}, {speed} steps/s")
    print(f"run folder: {out}")
    yardsticks = logged(last)
    if yardsticks and (below := yardsticks.not_reached_by(last.get("eval/mean_reward", math.nan))):
        print(f"{below}; train for longer, or see what `galton check {options.env}` says of it")


def _check_folder(options: Options) -> None:
    if options.resume:
        there = (options.folder / MODEL).exists()
        require(there, f"out is {options.folder}, which holds no {MODEL} to resume")
        files.check_no_way_out("out", options.folder, MODEL, BEST, METRICS, *["tensorboard"] * options.tensorboard)
        known(options.folder / METRICS)  # an error now, where it can't be read
    else:
        check_free(options.folder, options.overwrite, "--overwrite or --resume")


def _agent(options: Options) -> Agent:
    return read(options.training.words | {"loss": options.loss})


def _resumed(options: Options, env: Task) -> Model:
    out = options.folder
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", InexactResume)
        model = Model.load(out / MODEL, env)
    there, wanted = _environments(options, env)
    settings = read_settings(out)
    own = {"env": there, "seed": model.seed} | model.settings
    asked = {"env": wanted, "seed": options.seed, "algorithm": options.algorithm} | words_of(_agent(options))
    if "eval_episodes" in settings:  # the card counts on them
        own["eval_episodes"], asked["eval_episodes"] = settings["eval_episodes"], options.training.eval_episodes
    for name in (name for name in asked if name in own):  # with the same parts they have the same settings
        same = asked[name] == own[name]
        require(
            same, f"{name} is {asked[name]}, but the run in {out} has {own[name]}; give the same options to resume it"
        )
    for warning in told:
        if issubclass(warning.category, InexactResume):
            print(f"galton: {warning.message}", file=sys.stderr)
        else:
            warnings.showwarning(warning.message, warning.category, warning.filename, warning.lineno)
    other_logs = settings.get("logs", options.training.logs) != options.training.logs
    if other_logs and _interval_asked(options.training, model) != _interval(options.training, model):
        every = model.log_interval
        print(f"galton: the run keeps its log points, every {every:,} steps, whatever --logs is", file=sys.stderr)
    return model


def _environments(options: Options, env: Task) -> tuple[object, object]:
    """The environment of the run that is there, and the one that is asked for: equal, unless they are two."""
    settings = read_settings(options.folder)
    name, constants = settings.get("env"), settings.get("env_kwargs")
    if not isinstance(name, str) or not isinstance(constants, dict):
        return None, None  # nobody knows; the model itself tells of other spaces
    constants = read_constants(json.dumps(constants))
    if isinstance(env, JaxTask) and is_known(name):
        return find(name, **constants), env
    return _named(name, constants), _named(options.env, read_constants(options.training.env_kwargs))


def _named(env: str, constants: dict[str, object]) -> str:
    """An environment of an id or of module:Class, wherever its module lies, with its keyword arguments."""
    name = short_name(env.rpartition(":")[2])
    return f"{name} with {dict(sorted(constants.items()))}" if constants else name


def _learn(model: Model, options: Options, record: "_Record") -> None:
    """Train what is missing. However it ends, what was learnt is kept, or the earlier run that it has not replaced."""
    first, last = record.start, options.training.steps
    calls: list[callbacks.Callback] = [record]
    if last // options.save_every > first // options.save_every:
        calls.append(_Saving(record.model, options.save_every))
    try:
        interval, size = _interval(options.training, model), model.agent.rollout.size
        whole = math.ceil((last - first) / size) * size  # which learn would say in a warning
        model.learn(whole, calls, progress_bar=False, log_interval=interval, decay_from=0)
    except DivergenceError as error:
        raise UsageError(str(error)) from None
    except KeyboardInterrupt:
        step = model.num_timesteps
        if not (step and record.keeps):
            raise
        if step < last:
            how = "--resume" + " in the place of --overwrite" * options.overwrite
            print(f"galton: interrupted at step {step:,}; the same command with {how} goes on", file=sys.stderr)
            sys.exit(130)
    finally:
        if model.num_timesteps and record.keeps:
            record.model.save(model)
        record.model.end()


def _interval(training: Training, model: Model) -> int:
    """Updates between log points: as many as make the wanted number of points, or as the run had."""
    if model.num_timesteps:
        return model.log_interval // model.agent.rollout.size
    return _interval_asked(training, model)


def _interval_asked(training: Training, model: Model) -> int:
    size = model.agent.rollout.size
    return math.ceil(math.ceil(training.steps / size) / training.logs)


class _Record:
    """Keeps a run, shows how far training is, and raises what Ctrl-C asked for.

    The run's folder is begun at the first log point: until then an earlier run stays there.
    """

    def __init__(self, options: Options) -> None:
        self._options, self.start = options, 0
        self.show: Show = lambda _: None
        self.model = KeptModel(options.folder / MODEL, self._begin, lambda: self.keeps)
        self._calls: list[callbacks.Callback] = []

    def __call__(self, model: Model, log: callbacks.Log) -> None:
        """Write down what is due at a log point."""
        if not self.model.begun:
            self.model.save(model)
        self._calls = self._calls or list(self._due())
        for call in self._calls:
            call(model, log)
        if told := logged(log):  # by the first evaluation
            print(f"{told} ({N_EPISODES} episodes of each)", flush=True)
        self.show(model.num_timesteps)

    def meanwhile(self, model: Model, _: float) -> None:
        """Take what an interrupt would save."""
        self.model.take(model)
        self.show(model.num_timesteps)

    @property
    def keeps(self) -> bool:
        """True if there is a folder to keep the model in, or room for one: an earlier run has it until then."""
        return self.model.begun or not (self._options.overwrite and (self._options.folder / CONFIG).exists())

    def _begin(self, taken: Taken) -> None:
        """Put settings and model in the place of an earlier run, both or neither; or go on with that one."""
        options, out = self._options, self._options.folder
        if options.resume:
            forget_after(self.start, out / METRICS)
            with files.named("out", out):
                now = {"steps": options.training.steps, "command": command_line()}
                write_settings(out, read_settings(out) | now)
            taken.save(out / MODEL)
        else:
            given = {"env": options.env, "loss": options.loss, "preset": options.preset, "seed": options.seed}
            with replacing(out, options.overwrite) as folder, files.named("out", out):
                write_settings(folder, given | options.training.record() | {"command": command_line()})
                taken.save(folder / MODEL)

    def _due(self) -> Iterator[callbacks.Callback]:
        options, out = self._options, self._options.folder
        if options.training.eval_episodes:
            evaluate = callbacks.Evaluate(1, options.training.eval_episodes, best_model=out / BEST)
            before = known(out / METRICS)
            evaluate.best, evaluate.yardsticks = before.get("eval/best_mean_reward", -math.inf), logged(before)
            yield evaluate
        yield callbacks.JSONLines(out / METRICS)
        if options.tensorboard:
            yield callbacks.TensorBoard(out / "tensorboard")


@dataclasses.dataclass(frozen=True)
class _Saving:
    """Saves the model into the run folder as often as the user wants it."""

    kept: KeptModel
    every: int

    def __call__(self, model: Model, _: callbacks.Log) -> None:
        self.kept.save(model)
