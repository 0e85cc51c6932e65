"""galton watch: a film of a policy."""

import contextlib
import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro

from galton.cli._reading import read_options
from galton.cli.train import MODEL
from galton.envs.registry import is_known, read_constants
from galton.errors import UsageError, require, require_integer
from galton.models import Model
from galton.saving import files
from galton.saving.result_folder import CONFIG, read_settings

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
    episodes: int = 1
    """How many to play, one after the other."""
    max_steps: int = 1_000
    """Steps of an episode after which it is cut."""
    seed: int = 0
    """The seed of the first episode; the others count on from it."""
    out: Path | None = None
    """An .mp4 or .gif, by default video.mp4 beside the model."""


def main(arguments: Sequence[str]) -> None:
    """Play the episodes and write the video."""
    options = read_options(Options, "watch", arguments)
    require_integer("episodes", options.episodes, 1)
    require_integer("max_steps", options.max_steps, 1)
    require_integer("seed", options.seed, 0)
    file = options.run / MODEL if options.run.is_dir() else options.run
    out = options.out or file.with_name("video.mp4")
    require(out.suffix in (".mp4", ".gif"), f"out is {out}; its name must end in .mp4 or .gif")
    model = Model.load(file)
    env = _make(*_environment(options, file))
    try:
        frames, returns = _play(env, model, options)
        fps = env.metadata.get("render_fps") or 30
    finally:
        with contextlib.suppress(Exception):  # a renderer that never came up can't be closed either
            env.close()
    _write(out, frames, fps)
    told = ", ".join(f"{value:,.2f}" for value in returns)
    print(f"return {told} in {len(frames)} frames\nvideo: {out}")


def _environment(options: Options, file: Path) -> tuple[str, dict[str, object]]:
    """The id and the keyword arguments: those given, or else those of the run."""
    beside, known = file.with_name(CONFIG), read_settings(file.parent)
    name = known.get("env") if options.env is None else options.env
    require(name is not None, f"env is not known: there is no {CONFIG} beside {file}; give --env")
    if not isinstance(name, str):
        raise UsageError(f"env is {name!r} in {beside}; it must be a name")
    require(
        options.env is not None or ":" not in name,
        f"env is {name} in {beside}, which imports a module; give it with --env if you trust it",
    )
    given = json.dumps(known.get("env_kwargs", {})) if options.env_kwargs is None else options.env_kwargs
    return name, read_constants(given)


def _make(name: str, kwargs: dict[str, Any]) -> Env:
    require(
        not is_known(name),
        f"env is {name}, one of Galton's own tasks, which have no picture; train on the Gymnasium id to watch it",
    )
    if sys.platform == "linux" and "DISPLAY" not in os.environ:  # without a screen
        for variable, value in (("MUJOCO_GL", "egl"), ("SDL_VIDEODRIVER", "dummy")):
            os.environ[variable] = os.environ.get(variable) or value
    try:
        return gymnasium.make(name, **kwargs | {"render_mode": "rgb_array"})
    except Exception as error:
        raise UsageError(f"env is {name}, which can't be made for watching: {error}") from error


def _play(env: Env, model: Model, options: Options) -> tuple[list[np.ndarray], list[float]]:
    frames, returns = [], []
    for episode in range(options.episodes):
        observation, _ = env.reset(seed=options.seed + episode)
        frames.append(_frame(env))
        returns.append(0.0)
        for _ in range(options.max_steps):
            action, _ = model.predict(observation, deterministic=True)
            observation, reward, terminated, truncated, _ = env.step(action)
            frames.append(_frame(env))
            returns[-1] += float(reward)
            if terminated or truncated:
                break
    require(
        any(np.ptp(frame) > 0 for frame in frames),
        "every frame came out in a single colour: rendering does not work here; "
        "for MuJoCo set MUJOCO_GL to egl or osmesa",
    )
    return frames, returns


def _frame(env: Env) -> np.ndarray:
    try:
        frame = np.asarray(env.render())
    except Exception as error:
        raise UsageError(
            f"the environment can't be rendered: {type(error).__name__}: {error}. For MuJoCo without a screen install "
            "EGL or OSMesa (on Debian: libegl1 or libosmesa6) and set MUJOCO_GL to egl or osmesa"
        ) from error
    require(
        frame.ndim == 3 and frame.shape[-1] == 3 and frame.dtype == np.uint8,
        f"the environment's picture is {frame.shape} {frame.dtype}; it must be [height, width, 3] uint8",
    )
    return frame


def _write(out: Path, frames: list[np.ndarray], fps: int) -> None:
    try:
        with files.replacing(out) as scratch:
            if out.suffix == ".gif":
                _write_gif(scratch, frames, fps)
            else:
                _write_mp4(scratch, frames, fps)
    except OSError as error:
        raise UsageError(f"out is {out}, which can't be written: {error.strerror or error}") from None


def _write_gif(path: Path, frames: list[np.ndarray], fps: int) -> None:
    from PIL import Image

    first, *rest = [Image.fromarray(frame) for frame in frames]
    first.save(path, save_all=True, append_images=rest, duration=round(1000 / fps), loop=0)


def _write_mp4(path: Path, frames: list[np.ndarray], fps: int) -> None:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise UsageError(
            "an .mp4 needs ffmpeg: pip install 'galton[video]', or name an --out that ends in .gif"
        ) from None
    height, width, _ = frames[0].shape
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(fps), "-i", "-"]
    even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-y", str(path)]
    done = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", *raw, *even],
        input=b"".join(frame.tobytes() for frame in frames),
        capture_output=True,
        check=False,
    )
    if done.returncode:
        raise OSError(done.stderr.decode(errors="replace").strip())
