"""Pictures of an environment, and the film that they make."""

import math
import subprocess
from pathlib import Path

import gymnasium
import numpy as np

from galton.errors import UsageError, require
from galton.extras import check_named, require_libraries
from galton.saving import files

Env = gymnasium.Env[object, object]


def frame(env: Env) -> np.ndarray:
    """The environment's picture; UsageError where there is none, with what to install."""
    try:
        picture = np.asarray(env.render())
    except Exception as error:
        check_named("the environment's picture", error)
        raise UsageError(
            f"the environment can't be rendered: {type(error).__name__}: {error}. For MuJoCo without a screen install "
            "EGL or OSMesa (on Debian: libegl1 or libosmesa6) and set MUJOCO_GL to egl or osmesa"
        ) from error
    require(
        picture.ndim == 3 and picture.shape[-1] == 3 and picture.dtype == np.uint8,
        f"the environment's picture is {picture.shape} {picture.dtype}; it must be [height, width, 3] uint8",
    )
    return picture


def check_libraries(what: str, out: Path) -> None:
    """Raise MissingExtraError, which begins with `what`, unless an .mp4 or .gif like `out` can be written here."""
    require_libraries(what, "imageio_ffmpeg" if out.suffix == ".mp4" else "PIL")


def write(out: Path, frames: list[np.ndarray], fps: int) -> None:
    """Write an .mp4 or a .gif; UsageError where that can't be."""
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
