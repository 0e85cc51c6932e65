"""A process that compiles more and more does not run into the number of pieces of memory that it may map."""

import pathlib
import subprocess
import sys

import jax
import pytest

from galton.devices import n_cores
from galton.training import programs


@pytest.fixture
def made(monkeypatch):
    """A cache of its own, the files that tell how many pieces are mapped, and what was made for it."""
    made = []
    monkeypatch.setattr(programs, "_KEPT", [])

    @programs.kept
    def make(name):
        made.append(name)
        return [name]

    return make, made


def test_what_jax_is_set_to_is_part_of_what_is_known(made):
    make, names = made
    first = make("a")
    with jax.default_matmul_precision("highest"):
        assert make("a") is not first
    with jax.enable_x64(not jax.config.jax_enable_x64):
        assert make("a") is not first
    assert make("a") is first
    assert names == ["a"] * 3


def mapped(monkeypatch, tmp_path, pieces, most=100):
    maps, limit = tmp_path / "maps", tmp_path / "max_map_count"
    maps.write_text("a piece\n" * pieces)
    limit.write_text(f"{most}\n")
    monkeypatch.setattr(programs, "_MAPS", maps)
    monkeypatch.setattr(programs, "_MOST", limit)


def test_what_is_new_makes_room_and_what_is_known_does_not(made, monkeypatch, tmp_path):
    make, names = made
    mapped(monkeypatch, tmp_path, 50)
    held = make("a")
    mapped(monkeypatch, tmp_path, 51)
    assert make("a") is held  # nothing is compiled, so nothing is forgotten
    make("b")
    assert make("a") == held  # made again; who holds the first keeps it
    assert names == ["a", "b", "a"]


def test_programs_are_kept_while_there_is_room_or_where_nothing_tells_how_much_is_mapped(made, monkeypatch, tmp_path):
    make, names = made
    mapped(monkeypatch, tmp_path, 50)
    first = make("a")
    make("b")
    monkeypatch.setattr(programs, "_MAPS", pathlib.Path("/nowhere"))
    assert make("a") is first
    assert names == ["a", "b"]


@pytest.mark.slow
@pytest.mark.skipif(not programs._MAPS.exists(), reason="this system does not tell what a process maps")
def test_forgetting_frees_what_compiled_programs_map():
    import jax
    import jax.numpy as jnp

    def pieces():
        return programs._MAPS.read_bytes().count(b"\n")

    programs.make_room(0.0)
    before = pieces()
    held = [jax.jit(lambda x, i=i: jnp.sin(x) @ x + i) for i in range(20)]
    for f in held:
        f(jnp.ones((4, 4)))
    compiled = pieces()
    assert compiled > before
    del held, f
    programs.make_room(0.0)
    assert pieces() < compiled


@pytest.mark.parametrize(("given", "devices"), [("", n_cores()), ("runs=1", 1), ("runs=10_000", n_cores())])
def test_no_more_devices_than_runs(given, devices):
    code = f"import galton, jax; galton.use_all_cores({given}); print(len(jax.devices('cpu')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=True)
    assert int(done.stdout) == devices
