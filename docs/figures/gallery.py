"""Trains the policies of docs/gallery.md, but for those in runs/gallery, and films them.

python docs/figures/gallery.py
"""

import subprocess
import sys
from pathlib import Path

from PIL import Image, ImageSequence

RUNS, HERE = Path("runs", "gallery"), Path(__file__).parent / "gallery"
NEAR = '{"default_camera_config": {"trackbodyid": 0, "distance": 3.3}, "width": 320, "height": 240}'
FOLLOWED = '{"camera_name": "track", "width": 320, "height": 240}'
TASKS = {  # a name, how it is trained, how many steps are filmed, which are shown, and how it is made for that
    "half-cheetah": (["HalfCheetah-v5", "--steps", "500000"], 100, 1, FOLLOWED),
    "hopper": (["Hopper-v5", "--steps", "300000", "--preset", "classification", "--logs", "10"], 400, 2, FOLLOWED),
    "double-pendulum": (["InvertedDoublePendulum-v5", "--steps", "100000", "--logs", "10"], 80, 1, NEAR),
    "pendulum": (["Pendulum-v1", "--steps", "100000", "--logs", "10"], 120, 2, "{}"),
}
HEIGHT, MILLISECONDS = 180, 50
"""The height of a film in pixels, and how long each of its pictures is shown."""


def galton(*words: object) -> None:
    """Run a command of galton."""
    subprocess.run([sys.executable, "-m", "galton", *map(str, words)], check=True)


def shrink(film: Path, every: int, out: Path) -> None:
    """Write every n-th picture of a film again, smaller; one that did not change lasts for several frames."""
    with Image.open(film) as pictures:
        pairs = [(each.convert("RGB"), each.info["duration"]) for each in ImageSequence.Iterator(pictures)]
    frame = min(duration for _, duration in pairs)
    shown = [picture for picture, duration in pairs for _ in range(round(duration / frame))]
    width = round(HEIGHT * shown[0].width / shown[0].height)
    first, *rest = [picture.resize((width, HEIGHT)).quantize(64) for picture in shown[::every]]
    first.save(out, save_all=True, append_images=rest, duration=MILLISECONDS, loop=0)


def main() -> None:
    """Train and film each policy."""
    HERE.mkdir(exist_ok=True)
    for name, (training, steps, every, made) in TASKS.items():
        run = RUNS / name
        if not run.exists():
            galton("train", *training, "--out", run)
        galton("watch", run, "--env-kwargs", made, "--max-steps", steps, "--out", run / "video.gif")
        shrink(run / "video.gif", every, HERE / f"{name}.gif")


if __name__ == "__main__":
    main()
