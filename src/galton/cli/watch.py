"""galton watch: a film of a policy."""

import dataclasses
import math
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro

from galton.cli._reading import Imports, import_typed, read_options
from galton.cli._runs import environment_of, model_of
from galton.decimals import fitting
from galton.envs.host import masks
from galton.envs.host.answers import blame, one_flag, one_number, parts
from galton.envs.host.gymnasium import GymnasiumTask
from galton.envs.host.statistics import frozen, statistics_in, take_statistics
from galton.envs.registry import is_known
from galton.envs.task import check_same_spaces
from galton.errors import UsageError, require, require_integer
from galton.extras import check_named, require_libraries
from galton.models import Model
from galton.saving import files
from galton.training.train import check_seed

Env = gymnasium.Env[object, object]


@dataclasses.dataclass(frozen=True)
class Options:
    """Play episodes of a trained policy without exploration and write them as a video."""

    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """A run folder of `galton train`, or a file that `Model.save` wrote."""
    env: str | None = None
    """The Gymnasium id to play on; by default the run's. An id with a module must be given, for it runs code."""
    env_kwargs: Annotated[str | None, tyro.conf.arg(metavar="JSON")] = None
    """Keyword arguments of the environment; by default the run's."""
    imports: Imports = ()
    episodes: int = 1
    """The number of episodes to play, one after the other."""
    max_steps: int = 1_000
    """Steps of an episode after which it is cut."""
    seed: int = 0
    """The seed of the first episode; the others count on from it."""
    out: Path | None = None
    """An .mp4 or .gif, by default video.mp4 beside the model."""


def main(arguments: Sequence[str]) -> None:
    """Play the episodes and write the video."""
    options = read_options(Options, "watch", arguments)
    import_typed(options.imports)
    require_integer("episodes", options.episodes, 1)
    require_integer("max_steps", options.max_steps, 1)
    for seed in (options.seed, options.seed + options.episodes - 1):
        check_seed(seed)
    file = model_of(options.run)
    out = options.out or file.with_name("video.mp4")
    require(out.suffix in (".mp4", ".gif"), f"out is {out}; its name must end in .mp4 or .gif")
    if options.out is None:
        files.check_no_way_out("out", out.parent, out.name)
    model = Model.load(file)
    library = "imageio_ffmpeg" if out.suffix == ".mp4" else "PIL"
    require_libraries("watch" if options.out is None else f"out is {out}, which", library)
    name, kwargs = environment_of(file, options.env, options.env_kwargs)
    task = _make(name, kwargs)
    envs = task.make(1)
    env = envs.layers[0][0]
    try:
        check_same_spaces(task, model.actions, model.observations)
        (layers,), known = envs.layers, statistics_in(model.take().arrays)
        take_statistics(task.name, layers, known[0] if known else None)
        with frozen([layers]):
            frames, returns = _play(env, task, model, options)
        fps = env.metadata.get("render_fps") or 30
    finally:
        envs.close()
    write(out, frames, fps)
    told = ", ".join(f"{value:{fitting(*returns)}}" for value in returns)
    print(f"return {told} in {len(frames)} frames\nvideo: {out}")


def _make(name: str, kwargs: dict[str, Any]) -> GymnasiumTask:
    require(
        not is_known(name),
        f"env is {name}, one of Galton's own tasks, which have no picture; train on the Gymnasium id to watch it",
    )
    if sys.platform == "linux" and "DISPLAY" not in os.environ:  # without a screen
        for variable, value in (("MUJOCO_GL", "egl"), ("SDL_VIDEODRIVER", "dummy")):
            os.environ[variable] = os.environ.get(variable) or value
    try:
        return GymnasiumTask(name, **kwargs | {"render_mode": "rgb_array"})
    except UsageError as error:
        check_named(f"env is {name}, which", error)
        if "render_mode" not in str(error):
            raise
        remedy = "a film needs an environment that takes render_mode='rgb_array', and then renders, as Gymnasium's do"
        raise UsageError(f"{error}; {remedy}") from error


def _play(env: Env, task: GymnasiumTask, model: Model, options: Options) -> tuple[list[np.ndarray], list[float]]:
    """The frames of all episodes and the return of each; what the environment answers is checked as in training."""
    frames, returns = [], []
    for episode in range(options.episodes):
        where = f"{task.name}, episode {episode}"
        with blame(f"{where}: reset"):
            begun = env.reset(seed=options.seed + episode)
        observation, info = parts(begun, "observation, info", "reset", where)
        frames.append(picture(env))
        returns.append(0.0)
        for step in range(1, options.max_steps + 1):
            model.observations.flatten(observation, where)
            box = task.actions.box
            allowed = masks.checked(masks.of_one(env, info, where), box, where) if box.n_mask else None
            action, _ = model.predict(observation, deterministic=True, action_masks=allowed)
            where = f"{task.name}, episode {episode}, step {step}"
            with blame(f"{where}: step"):
                answer = env.step(action if task.actions.scale == 1 else task.actions.to_env(np.ravel(action)))
            names = "observation, reward, terminated, truncated, info"
            observation, reward, terminated, truncated, info = parts(answer, names, "step", where)
            frames.append(picture(env))
            returns[-1] += one_number(reward, "the reward", where)
            if one_flag(terminated, "terminated", where) or one_flag(truncated, "truncated", where):
                break
    require(
        any(np.ptp(frame) > 0 for frame in frames),
        "every frame came out in a single colour: rendering does not work here; "
        "for MuJoCo set MUJOCO_GL to egl or osmesa",
    )
    return frames, returns


def picture(env: Env) -> np.ndarray:
    """The environment's picture; UsageError where there is none, with what to install."""
    try:
        pixels = np.asarray(env.render())
    except Exception as error:
        check_named("the environment's picture", error)
        raise UsageError(
            f"the environment can't be rendered: {type(error).__name__}: {error}. For MuJoCo without a screen install "
            "EGL or OSMesa (on Debian: libegl1 or libosmesa6) and set MUJOCO_GL to egl or osmesa"
        ) from error
    require(
        pixels.ndim == 3 and pixels.shape[-1] == 3 and pixels.dtype == np.uint8,
        f"the environment's picture is {pixels.shape} {pixels.dtype}; it must be [height, width, 3] uint8",
    )
    return pixels


def write(out: Path, frames: list[np.ndarray], fps: int) -> None:
    """Write an .mp4 or a .gif; UsageError where that can't be."""
    with files.named("out", out), files.replacing(out) as scratch:
        if out.suffix == ".gif":
            _write_gif(scratch, frames, fps)
        else:
            _write_mp4(scratch, frames, fps)


def _write_gif(path: Path, frames: list[np.ndarray], fps: int) -> None:
    from PIL import Image

    every = math.ceil(fps / 50)  # what lasts less than 20 ms is shown for longer by browsers
    first, *rest = [Image.fromarray(frame) for frame in frames[::every]]
    first.save(path, save_all=True, append_images=rest, duration=round(1000 * every / fps), loop=0)


def _write_mp4(path: Path, frames: list[np.ndarray], fps: int) -> None:
    import imageio_ffmpeg

    height, width, _ = frames[0].shape
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(fps), "-i", "-"]
    even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-y", str(path)]
    done = subprocess.run(  # noqa: S603  no shell; the path comes last, as a word of its own
        [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", *raw, *even],
        input=b"".join(frame.tobytes() for frame in frames),
        capture_output=True,
        check=False,
    )
    if done.returncode:
        raise OSError(done.stderr.decode(errors="replace").strip())
