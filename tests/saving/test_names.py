"""Whatever a thing is called, nothing is written outside of the folder that is meant for it."""

from pathlib import Path, PureWindowsPath

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from galton import A2C, LOSSES, UsageError
from galton.algorithms import ALGORITHMS
from galton.callbacks import Checkpoint, Evaluate, JSONLines, TensorBoard
from galton.cli._options import plain_name
from galton.cli.train import Options as Train
from galton.deploy import export
from galton.envs.registry import ENVS
from galton_experiments.commands.compare import Options as Compare
from galton_experiments.commands.compare import result_folder
from galton_experiments.commands.sweep.run import Options as Sweeping
from galton_experiments.sweep import Study, engine, expand
from galton_experiments.sweep.store import Store, check_inside

from ..cli.test_train_keeps import small

LEADING_AWAY = [
    *("..", "../x", "../../x", "a/../../x", "/x", "//x", "", "a//b", ".", "a\0b", "..\\x", "\\x", "C:\\x", "C:x")
]
"""What is no name of a file inside of a folder, on one system or another."""
PLAIN = ["CON", "nul.v0", "Com1.-v0", "aux.", "~", "-rf", "x.", "a\nb", "é" * 300, "\udcff", "\ud800" * 200]
ODD = [*LEADING_AWAY, *PLAIN]
NAMES = st.text() | st.text(st.sampled_from("./\\:~ \0.conaux1")) | st.sampled_from(ODD)


def everything(folder):
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{port}{i}" for port in ("COM", "LPT") for i in "123456789¹²³")}
"""Names that Windows keeps for devices, whatever their suffix."""


def check_part(folder):
    """Raise unless a folder lies in runs/ and any system can make it."""
    folder = Path(folder)
    assert folder.parent == Path("runs")
    assert folder.name == PureWindowsPath(folder.name).name
    assert not {*'<>:"/\\|?*\0'} & {*folder.name}
    assert folder.name.partition(".")[0].upper() not in RESERVED
    assert not folder.name.endswith((".", " "))
    assert len(folder.name.encode()) <= 230  # with what a lock and a scratch folder add


@pytest.mark.slow
@given(NAMES, NAMES, NAMES)
@example("..", "..", "../x")
def test_the_folder_of_a_run_lies_in_runs_whatever_environment_loss_and_algorithm_are_called(env, loss, algorithm):
    check_part(Train(env, small(), loss, algorithm).folder)
    check_part(Sweeping(env, algorithm).folder)
    check_part(Path("runs", f"compare-{plain_name(env)}"))


def test_registered_names_are_as_they_are_and_odd_ones_are_made_plain():
    for name in (
        *LOSSES,
        *ALGORITHMS,
        *ENVS,
        "Pendulum-v1",
        "HalfCheetah-v5",
        "galton_x.y-v0",
        "conic",
        "nullable.x",
        "Falcon",
    ):
        assert plain_name(name) == name
    assert Compare("lqr", small()).out is None
    for name in ODD:
        check_part(Path("runs", f"compare-{plain_name(name)}"))


def test_a_store_writes_reads_and_removes_nothing_elsewhere(tmp_path):
    (tmp_path / "x").write_bytes(b"mine")
    store = Store(str(tmp_path / "deep" / "folder"))
    store.write("kept", b"1")
    before = everything(tmp_path)
    for name in LEADING_AWAY:
        for act, more in ((store.write, (b"2",)), (store.read, ()), (store.remove, ())):
            with pytest.raises(UsageError, match=r"name is .*, which is no name of a file in a folder; leave out"):
                act(name, *more)
    assert everything(tmp_path) == before


@given(NAMES)
def test_what_a_store_takes_lies_below_it(name):
    try:
        check_inside("name", name)
    except UsageError:
        return
    for root in (Path("/root"), PureWindowsPath("C:\\root")):
        below = root / name
        assert below.parts[: len(root.parts)] == root.parts
        assert ".." not in below.parts
        assert below != root


@pytest.fixture(scope="module")
def model():
    return A2C("bandit", "hl-gauss", n_bins=4, net_arch=())


UNUSABLE = ["a\0b", "x" * 300, "d/" * 3000 + "x"]
WRITERS = {
    "save": lambda model, path: model.save(path),
    "export": export,
    "a log": lambda model, path: JSONLines(path),
    "TensorBoard": lambda model, path: TensorBoard(path),
    "a checkpoint": lambda model, path: Checkpoint(path, every=5).check(model),
    "the best model": lambda model, path: Evaluate(best_model=path).check(model),
    "a run": lambda model, path: result_folder(Path(path), False).__enter__(),
    "a sweep": lambda model, path: engine.sweep(Study("bandit", SETTINGS, 1, 20, 1, 0), path, workers=1),
}
SETTINGS = expand([{"n_steps": 5, "net_arch": ()}], {})


@pytest.mark.parametrize("path", UNUSABLE, ids=["NUL", "long", "deep"])
@pytest.mark.parametrize("what", WRITERS)
def test_a_path_that_no_disk_has_is_refused_by_name(what, path, model, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"^(path|folder|out|best_model) is "):
        WRITERS[what](model, path)
    assert not [found for found in tmp_path.rglob("*") if found.is_file()]
