"""galton compare: does classification beat regression on this task?"""

import contextlib
import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import tyro

from galton.agents import written
from galton.cli._options import AlgorithmName, EnvName, Training, command_line, folder_name
from galton.cli._parsing import COMMON, TrainingOptions, parse
from galton.cli._progress import live_progress, plain_console
from galton.cli._reading import Imports
from galton.cli._words import Fills
from galton.devices import use_all_cores
from galton.envs.base import Environment
from galton.envs.jax_task import JaxTask
from galton.envs.registry import read_constants
from galton.errors import require, require_integer, require_word
from galton.losses import LOSSES
from galton.presets import PRESETS, find_preset, present
from galton.saving import files
from galton.saving.result_folder import CURVES, FIGURE, SUMMARY, check_free, claimed, replacing, write_settings
from galton.tasks import task_of
from galton.training.size import check_size
from galton.training.train import Result, train
from galton_experiments.analysis.comparison import Row, curves, label_of, learning_curves, named, summarise, verdicts
from galton_experiments.analysis.plain import plain
from galton_experiments.analysis.plots import save
from galton_experiments.commands._compare_view import table
from galton_experiments.sweep.grid import bases
from galton_experiments.sweep.study import Setting

LossNames = Annotated[
    tuple[str, ...],
    Fills("loss"),
    tyro.conf.arg(
        metavar="{" + ",".join(LOSSES) + "} ...",
        help=f"The losses, each named once, or presets ({', '.join(PRESETS)}), each with its loss and the settings "
        "that were tuned for it. What is both a loss and a preset is the preset if another one is, so that both are "
        "tuned. What you set beside them goes for all.",
    ),
]


@dataclasses.dataclass(frozen=True)
class Options:
    """Train several losses over the same seeds; print a table and keep figure and numbers in a folder."""

    env: EnvName
    training: TrainingOptions
    algorithm: AlgorithmName = "a2c"
    """The algorithm that learns; the defaults of its settings are its own."""
    losses: LossNames = tuple(name for name, loss in LOSSES.items() if loss.in_paper)
    seeds: int = 20
    """The number of runs of each loss, each with a seed of its own."""
    out: Path | None = None
    """The folder for the figure and the numbers, by default runs/compare-ENV, or runs/compare-ENV-ALGORITHM."""
    imports: Imports = ()
    overwrite: bool = False
    """Replace what the folder holds once the comparison is done."""

    @property
    def at_rest(self) -> float | None:
        """Return what doing nothing earns, where it is known: with the environment's own constants."""
        return None if read_constants(self.training.env_kwargs) else task_of(self.env).at_rest


def main(arguments: Sequence[str]) -> None:
    """Train all losses, print the table and write figure, curves and settings."""
    options = parse(Options, "compare", arguments, common=COMMON)
    require(
        len({present(word) for word in options.losses}) == len(options.losses) > 0,
        f"losses is {options.losses}; name each loss once, and at least one",
    )
    require_integer("seeds", options.seeds, 1)
    compared = dict(_compared(options, arguments))
    training, seeds = options.training, range(options.seeds)
    use_all_cores()  # before the environment's module computes something
    env = training.find(options.env)
    known = env.record if isinstance(env, JaxTask) else None
    out = options.out or Path("runs", f"compare-{folder_name(options.env, options.algorithm)}")
    settings = _settings(compared)
    agents = [setting.agent.on(env.actions.box) for setting in settings.values()]
    for agent in agents:  # before so many seeds are counted
        check_size(env, agent, len(seeds), training.eval_episodes)
    training.check(seeds)
    console = plain_console()
    results: dict[str, Result] = {}
    rows: list[Row] = []
    try:
        with result_folder(out, options.overwrite) as folder:
            with live_progress(console) as follow:
                for name, setting in settings.items():
                    show = follow(name if name not in LOSSES else label_of(name), training.steps, len(seeds))
                    results[name] = train(
                        env,
                        setting.agent,
                        seeds,
                        training.steps,
                        n_logs=training.logs,
                        n_eval_episodes=training.eval_episodes,
                        meanwhile=show,
                    )
            rows = summarise(results, known, options.at_rest)
            with files.named("out", out):
                _keep(folder, options, settings, results, rows, known)
    finally:
        if rows:  # a disk that is full takes the files, but not the numbers
            console.print(table(rows, known, options.at_rest))
            print(*verdicts(results), sep="\n")
    print(f"figure and numbers: {out}")


@contextlib.contextmanager
def result_folder(path: Path, overwrite: bool) -> Iterator[Path]:
    """A hidden folder beside `path` to write into; it becomes `path` at the end, or vanishes if that is never reached.

    Raises:
        UsageError: at once, if path holds something and may not be overwritten, or another process is about to fill it.
    """
    check_free(path, overwrite)
    with claimed(path):
        check_free(path, overwrite)  # nobody else can fill it now
        with replacing(path, overwrite) as fresh:
            yield fresh


def _compared(options: Options, arguments: Sequence[str]) -> Iterator[tuple[str, tuple[str, Training]]]:
    """Each of the words under its full name, with its loss and what that is trained with.

    A preset brings its settings, and what was typed goes before them. A word that is both a loss and a preset is the
    latter where another one is a preset alone, if there is one for this algorithm: then both sides are tuned.
    """
    words = [present(word) for word in options.losses]
    tuned = any(word in PRESETS and word not in LOSSES for word in words)
    for word in words:
        require_word("losses", word, [*LOSSES, *(preset for preset in PRESETS if preset not in LOSSES)])
        if word not in LOSSES or (tuned and options.algorithm in PRESETS.get(word, {})):
            preset = find_preset(word, None, options.algorithm)
            own = parse(Options, "compare", arguments, preset=preset, common=COMMON).training
            yield named(preset.loss, word), (preset.loss, own)
        else:
            yield named(word), (word, options.training)


def _settings(compared: Mapping[str, tuple[str, Training]]) -> dict[str, Setting]:
    """The setting of each, without what its loss has no use for and another's has."""
    points = [{"loss": loss} for loss, _ in compared.values()]
    given = [written(training.words) for _, training in compared.values()]
    of_points = zip(bases(points, given), points, strict=True)
    return {name: Setting(base | point) for name, (base, point) in zip(compared, of_points, strict=True)}


def _keep(
    folder: Path,
    options: Options,
    settings: Mapping[str, Setting],
    results: Mapping[str, Result],
    rows: list[Row],
    known: Environment | None,
) -> None:
    """Write settings, summary, curves and figure into a folder."""
    import pyarrow.parquet as pq  # galton_experiments.analysis says how to install it

    given = {"env": options.env, "losses": options.losses, "seeds": options.seeds}
    own = {"settings": {name: setting.record() for name, setting in settings.items()}, "command": command_line()}
    write_settings(folder, given | options.training.record() | own)
    files.write(folder / SUMMARY, (json.dumps(plain(rows), indent=2) + "\n").encode())
    with files.replacing(folder / CURVES) as scratch:
        pq.write_table(curves(results), scratch)
    title = f"{task_of(options.env).title}: mean of {options.seeds} runs and 95% CI"
    save(learning_curves(results, known, title), folder / FIGURE)
