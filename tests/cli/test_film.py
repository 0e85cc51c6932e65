"""A film lasts as long as what it shows."""

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image, ImageSequence

from galton.cli import watch


@pytest.mark.parametrize("fps", [20, 50, 125])
def test_a_gif_plays_in_real_time_and_no_picture_is_too_short_for_browsers(tmp_path, fps):
    frames = [np.full((4, 6, 3), 7 * i, np.uint8) for i in range(30)]
    watch.write(tmp_path / "film.gif", frames, fps)
    with Image.open(tmp_path / "film.gif") as film:
        lasting = [picture.info["duration"] for picture in ImageSequence.Iterator(film)]
    assert min(lasting) >= 20
    assert sum(lasting) == pytest.approx(1000 * 30 / fps, rel=0.2)  # a GIF counts in hundredths of seconds


def test_an_mp4_of_an_odd_size_lasts_as_long(tmp_path):
    watch.write(tmp_path / "film.mp4", [np.full((33, 47, 3), 7 * i, np.uint8) for i in range(30)], 20)
    assert imageio_ffmpeg.count_frames_and_secs(tmp_path / "film.mp4") == (30, pytest.approx(1.5, abs=0.1))
