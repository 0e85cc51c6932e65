import json

import pytest

from galton.cli._runs import forget_after, known

POINTS = [{"time/total_timesteps": step, "eval/mean_reward": step / 2, "a": None} for step in (100, 200, 300)]
LINES = [json.dumps(point).encode() for point in POINTS]

STEP = b'{"time/total_timesteps": '
ODD_STEPS = [b"null}", b'"100"}', b"true}", b"1" + b"0" * 400 + b"}", b'100, "eval/mean_reward": "high"}']
BROKEN = [b'{"rollout/ep_rew', b"{}", b"null", b"\xff\xfe\x00", b"[" * 100_000, *(STEP + odd for odd in ODD_STEPS)]


@pytest.mark.parametrize("broken", BROKEN, ids=lambda line: line[:40].decode(errors="replace"))
@pytest.mark.parametrize("place", [0, 1, 3])
def test_a_broken_line_is_left_out_and_told(broken, place, tmp_path, capsys):
    path = tmp_path / "metrics.jsonl"
    path.write_bytes(b"\n".join([*LINES[:place], broken, *LINES[place:]]))
    assert known(path) == {"time/total_timesteps": 300, "eval/mean_reward": 150}
    forget_after(200, path)
    assert path.read_bytes() == b"".join(line + b"\n" for line in LINES[:2])
    assert "1 of 4 lines" in capsys.readouterr().err


def test_whole_files_are_not_talked_about_and_a_missing_one_is_empty(tmp_path, capsys):
    path = tmp_path / "metrics.jsonl"
    assert known(path) == {}
    forget_after(200, path)
    assert path.read_bytes() == b""
    path.write_bytes(b"".join(line + b"\n" for line in LINES))
    forget_after(300, path)
    assert path.read_bytes() == b"".join(line + b"\n" for line in LINES)
    assert capsys.readouterr().err == ""
