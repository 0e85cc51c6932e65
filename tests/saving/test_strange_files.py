"""A file that somebody else made is a pipe, a device, a folder or enormous, or a link that leads out of its folder."""

import contextlib
import json
import os
import shutil
import signal
from pathlib import Path

import pyarrow as pa
import pytest

from galton import A2C, UsageError, deploy
from galton.cli import export, watch
from galton.cli._runs import points
from galton.errors import CheckpointError
from galton.models import Model
from galton.saving.result_folder import claimed, read_settings
from galton_experiments.benchmark import folder as benchmark
from galton_experiments.benchmark import reading
from galton_experiments.sweep import results
from galton_experiments.sweep.grid import read_grid
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import finished, read
from galton_experiments.sweep.store import Store

from ..cli.test_train_keeps import galton_train

resource = pytest.importorskip("resource", reason="pipes and limits are POSIX's")

HERE = Path(__file__).parents[1]
GOLDEN, EXAMPLES = HERE / "golden" / "v1", HERE.parent / "examples"
SECONDS, BYTES = 10, 1 << 30


@contextlib.contextmanager
def limits():
    """A time in which it is an error to wait for a pipe or to take much memory, which would end the tests."""

    def late(*_):
        raise TimeoutError("it waited for a file")

    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before, most = resource.getrlimit(resource.RLIMIT_AS)
    handler = signal.signal(signal.SIGALRM, late)
    signal.alarm(SECONDS)
    resource.setrlimit(resource.RLIMIT_AS, (now + BYTES, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (before, most))
        signal.alarm(0)
        signal.signal(signal.SIGALRM, handler)


def sparse(path):
    path.touch()
    os.truncate(path, 10 << 30)


ODD = {
    "a pipe": os.mkfifo,
    "a device": lambda path: path.symlink_to("/dev/zero"),
    "a folder": Path.mkdir,
    "10,737,418,240 bytes": sparse,
}
"""What takes the place of a file, by what is said of it."""


def shard_of(folder):
    store = Store(str(folder))
    return read(store, finished(store, Plan.load(store))[0])


def benchmark_of(folder):
    """Begin a benchmark in a folder where one was begun."""
    protocol = reading.read(EXAMPLES / "benchmark.toml")
    return benchmark.begin(Store(str(folder)), protocol)


def extending(folder):
    (folder / "other.toml").write_text('extends = "benchmark.toml"')
    return reading.load(folder / "other.toml")


def results_of(folder):
    """Write a sweep's table to where it may be."""
    results.save(Store(str(folder)), pa.table({"final_training_return": [1.0]}))


SHARD = min((GOLDEN / "sweep" / "shards").glob("0000000-*"))
KINDS = {
    "model": (GOLDEN / "run" / "model.safetensors", "", lambda folder: Model.load(folder / "model.safetensors")),
    "settings": (GOLDEN / "run" / "config.json", "", read_settings),
    "metrics": (GOLDEN / "run" / "metrics.jsonl", "", lambda folder: points(folder / "metrics.jsonl")),
    "grid": (GOLDEN / "grid.toml", "", lambda folder: read_grid(folder / "grid.toml", {})),
    "benchmark": (EXAMPLES / "benchmark.toml", "", lambda folder: reading.read(folder / "benchmark.toml")),
    "extended": (EXAMPLES / "benchmark.toml", "", extending),
    "plan": (GOLDEN / "sweep" / "plan.parquet", "", lambda folder: Plan.load(Store(str(folder)))),
    "shard": (SHARD, "shards", shard_of),
    "results": ("results.parquet", "", results_of),
    "begun": ("benchmark.json", "", benchmark_of),
    "provenance": ("provenance.json", "", lambda folder: benchmark.made(Store(str(folder)))),
}
"""Each kind of file: one that is right, the folder that it lies in, and its reader."""


def placed(kind, folder):
    """A right file of that kind in a folder."""
    original, below, _ = KINDS[kind]
    path = folder / below / Path(original).name
    path.parent.mkdir(exist_ok=True)
    if kind == "shard":
        shutil.copy(GOLDEN / "sweep" / "plan.parquet", folder)
    if kind in ("begun", "results"):
        KINDS[kind][2](folder)
    elif kind == "provenance":
        path.write_text("{}")
    else:
        shutil.copy(original, path)
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_or_too_large_is_refused_before_it_is_read(kind, tmp_path):
    folder, reader = tmp_path / "theirs", KINDS[kind][2]
    folder.mkdir()
    path = placed(kind, folder)
    right = path.rename(tmp_path / "right")
    path.symlink_to(right)
    reader(folder)  # a link to a right file is one
    there = sorted(tmp_path.rglob("*"))
    for said, make in ODD.items():
        path.rmdir() if make is sparse else path.unlink()
        make(path)
        told = rf"{path.name}\b.*(it|its size) is {said}"
        with limits(), pytest.raises((UsageError, CheckpointError), match=told) as caught:
            reader(folder)
        assert "\n" not in str(caught.value)
        assert {*tmp_path.rglob("*")} == {*there, *([folder / "other.toml"] if kind == "extended" else [])}


@pytest.mark.parametrize("kind", KINDS)
def test_a_link_to_nothing_is_no_file_and_is_not_written_through(kind, tmp_path):
    path = placed(kind, tmp_path)
    path.unlink()
    path.symlink_to("/proc/nowhere")
    with contextlib.suppress(UsageError, FileNotFoundError):
        assert not KINDS[kind][2](tmp_path)
    assert path.is_symlink()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run folder."""
    folder = tmp_path_factory.mktemp("made") / "run"
    model = A2C("bandit", n_bins=5, net_arch=(4,), n_steps=2, n_envs=1)
    model.save(folder / "model.safetensors")
    (folder / "config.json").write_text(json.dumps({"env": "bandit", "env_kwargs": {}}))
    return folder


def export_again(run, *formats):
    export.main([str(run), "--format", *formats])


def resume(run, **options):
    galton_train(run, resume=True, **options)


WRITERS = {
    "model_card.md": lambda run: export_again(run, "card"),
    "policy.onnx": lambda run: export_again(run, "onnx"),
    "policy.json": lambda run: export_again(run, "onnx"),
    "policy.json of export": lambda run: deploy.export(Model.load(run / "model.safetensors"), run / "policy"),
    "metrics.jsonl": resume,
    "best_model.safetensors": resume,
    "model.safetensors": resume,
    "tensorboard": lambda run: resume(run, tensorboard=True),
    "video.mp4": lambda run: watch.main([str(run)]),
    "plan.parquet": lambda run: Store(str(run)).write("plan.parquet", b"ours"),
    "shards": lambda run: Store(str(run)).write("shards/one", b"ours"),
    "figures": lambda run: Store(str(run)).remove("figures/theirs"),
    "sweeps": lambda run: enter(Store(str(run)).below("sweeps/one").lock()),
    "data": lambda run: Store(str(run)).below("data").write("one", b"ours"),
    ".lock": lambda run: enter(Store(str(run)).lock()),
    ".new.lock": lambda run: enter(claimed(run / "new")),
}
FOLDERS = ("tensorboard", "shards", "figures", "sweeps", "data")
"""What of these is a folder."""


def enter(context):
    with context:
        pass


@pytest.mark.few
@pytest.mark.parametrize("written", WRITERS)
def test_no_link_leads_what_is_written_out_of_a_folder(written, made, tmp_path):
    name, run, outside = written.partition(" ")[0], shutil.copytree(made, tmp_path / "run"), tmp_path / "outside"
    if name in FOLDERS:
        outside.mkdir()
        (outside / "theirs").write_bytes(b"theirs")
    else:
        shutil.copy(made / "model.safetensors", outside)
    (run / name).unlink(missing_ok=True)
    (run / name).symlink_to(outside)
    there = {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")}
    with pytest.raises(
        UsageError, match=rf"whose {name}\S* leads out of it by a link, to {outside}.*; remove the link"
    ):
        WRITERS[written](run)
    assert {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")} == there


def test_a_folder_may_be_a_link_and_hold_links_that_stay_inside(made, tmp_path):
    run, link = shutil.copytree(made, tmp_path / "run"), tmp_path / "link"
    link.symlink_to(run)
    (run / "cards").mkdir()
    (run / "model_card.md").symlink_to(run / "cards" / "card.md")
    export_again(link, "card")
    Store(str(link)).below("cards").write("other", b"ours")
    assert (run / "model_card.md").is_symlink()
    assert sorted(path.name for path in (run / "cards").iterdir()) == ["card.md", "other"]
