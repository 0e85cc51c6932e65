"""A model's file, rewritten with a right checksum: settings, sizes and numbers that `save` never wrote."""

import json
import os
import subprocess
import sys
import types

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple

import galton
from galton import A2C, CheckpointError, UsageError
from galton.networks import FlaxNetwork
from galton.saving import checkpoint

from ..envs.host.walks import Tall, kind

BOX = {"Box": [[-1.0], [1.0], [2], "<f4"]}


def config(**changes):
    return lambda settings, arrays: settings["config"].update(changes)


def hypers(**changes):
    return lambda settings, arrays: settings["hypers"].update(changes)


def settings(**changes):
    return lambda settings, arrays: settings.update(changes)


def nested(depth):
    space = json.loads(json.dumps(BOX))
    for _ in range(depth):
        space = {"Tuple": [space]}
    return space


def change(name, f):
    def attack(settings, arrays):
        arrays[name] = np.asarray(f(arrays[name]))

    return attack


def put(name, value):
    """One number of an array replaced."""

    def attack(settings, arrays):
        arrays[name] = arrays[name].copy()
        arrays[name].flat[-1] = value

    return attack


KERNEL = "run/learner/params/actor/0/kernel"
ADAM = "run/learner/optimizer"
ATTACKS = {
    "parameter NaN": put(KERNEL, np.nan),
    "moment NaN": put(f"{ADAM}/mu/actor/0/kernel", np.nan),
    "second moment negative": put(f"{ADAM}/nu/critic/0/bias", -1),
    "n_bins huge": config(n_bins=10**9),
    "n_bins negative": config(n_bins=-1),
    "n_bins of an entry huge": config(per_entry=["0.n_bins=1000000000"]),
    "per_entry is none": config(per_entry=["n_bins"]),
    "net_arch huge": config(net_arch=[10**9, 10**9]),
    "net_arch long": config(net_arch=[8] * 100_000),
    "n_steps huge": config(n_steps=10**18),
    "n_envs huge": config(n_envs=10**9),
    "config unknown key": config(extra=1),
    "config missing key": lambda settings, arrays: settings["config"].pop("n_bins"),
    "rate text": hypers(learning_rate="0.1"),
    "rate negative": hypers(learning_rate=-1.0),
    "hypers unknown key": hypers(extra=1.0),
    "hypers missing key": lambda settings, arrays: settings["hypers"].pop("gamma"),
    "seed negative": settings(seed=-1),
    "seed huge": settings(seed=2**32),
    "step text": settings(step="100"),
    "step another": settings(step=120),
    "step huge": settings(step=10**30),
    "log_interval zero": settings(log_interval=0),
    "n_predictions huge": settings(n_predictions=2**64),
    "class another": settings(**{"class": "os.system"}),
    "env a list": settings(env=["os:system"]),
    "unknown key": settings(extra=1),
    "missing key": lambda settings, arrays: settings.pop("action_space"),
    "nothing": lambda settings, arrays: settings.clear(),
    "actions huge": settings(action_space={"Box": [[-1.0], [1.0], [10**9], "<f4"]}),
    "actions many": settings(action_space={"Box": [[-1.0] * 100_000, [1.0] * 100_000, [100_000], "<f4"]}),
    "actions reversed": settings(action_space={"Box": [[1.0], [-1.0], [2], "<f4"]}),
    "actions unbounded": settings(action_space={"Box": [[-float("inf")], [float("inf")], [2], "<f4"]}),
    "actions discrete": settings(action_space={"Discrete": [2, 0]}),
    "actions of objects": settings(action_space={"Box": [[-1.0], [1.0], [2], "O"]}),
    "observations of long text": settings(observation_space={"Box": [[0.0], [1.0], [2], "S1000000000"]}),
    "observations huge": settings(observation_space={"Box": [[0.0], [1.0], [10**5, 10**5], "<f4"]}),
    "observations cancel": settings(
        observation_space={"Tuple": [{"Box": [[0.0], [1.0], [n], "<f4"]} for n in (10**9, -(10**9))]}
    ),
    "observations discrete": settings(observation_space={"Discrete": [10**12, 0]}),
    "observations multi": settings(observation_space={"MultiDiscrete": [2**62] * 4}),
    "observations deep": settings(observation_space=nested(400)),
    "observations unknown": settings(observation_space={"os:system": ["ls"]}),
    "observations two": settings(observation_space=BOX | {"Discrete": [2, 0]}),
    "observations text": settings(observation_space={"Box": "abcd"}),
    "array missing": lambda settings, arrays: arrays.pop(KERNEL),
    "array of another shape": change(KERNEL, lambda x: x[:, :1]),
    "array of another type": change(KERNEL, lambda x: x.astype(np.float64)),
    "array of no run": change(KERNEL, lambda x: x[:0]),
    "array step": change("run/step", lambda x: x + 20),
    "array step missing": lambda settings, arrays: arrays.pop("run/step"),
}

LOADER = """
import json, resource, sys, time
import galton
galton.use_all_cores()
galton.A2C.load(sys.argv[1])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
known = set(sys.modules)
for path in sys.argv[2:]:
    start = time.perf_counter()
    try:
        galton.A2C.load(path)
        seen = "loaded"
    except Exception as error:
        seen = type(error).__name__
    megabytes = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(json.dumps([seen, time.perf_counter() - start, megabytes, sorted(set(sys.modules) - known)]), flush=True)
"""


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model"
    return A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,)).save(path)


def rewritten(model, path, attack):
    settings, arrays = checkpoint.read(model)
    attack(settings, arrays)
    checkpoint.write(path, settings, arrays)
    return path


def load_elsewhere(model, paths):
    done = subprocess.run([sys.executable, "-c", LOADER, model, *paths], capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.slow
def test_hostile_settings_and_arrays_give_one_error_quickly_in_little_memory(model, tmp_path):
    paths = [rewritten(model, tmp_path / str(i), attack) for i, attack in enumerate(ATTACKS.values())]
    answers = load_elsewhere(model, paths)
    assert len(answers) == len(ATTACKS)
    newer = {"config unknown key", "hypers unknown key", "unknown key"}  # for all that this version can know
    wanted = {name: "NewerVersionError" if name in newer else "CheckpointError" for name in ATTACKS}
    assert {name: answer[0] for name, answer in zip(ATTACKS, answers, strict=True)} == wanted
    assert max(answer[1] for answer in answers) < 5
    assert answers[-1][2] < 200


@pytest.mark.slow
def test_loading_imports_nothing_whatever_the_file_names(model, tmp_path, monkeypatch):
    (tmp_path / "evilmodule.py").write_text("raise SystemExit('imported')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    names = ["os:system", "evilmodule:Env-v0", "this:Env-v0", "../../evil"]
    paths = [rewritten(model, tmp_path / str(i), settings(env=name)) for i, name in enumerate(names)]
    for seen, _, _, modules in load_elsewhere(model, paths):
        assert seen == "loaded"
        assert not {"evilmodule", "this"} & set(modules)


def test_the_error_names_the_file(model, tmp_path):
    for name in ("n_bins huge", "rate text", "array missing", "observations huge"):
        with pytest.raises(CheckpointError, match="hostile"):
            A2C.load(rewritten(model, tmp_path / "hostile", ATTACKS[name]))


SPACES = {
    "MultiBinary": MultiBinary(5),
    "MultiBinary of two axes": MultiBinary([2, 3]),
    "MultiDiscrete": MultiDiscrete([3, 4], start=[1, -2]),
    "MultiDiscrete of two axes": MultiDiscrete([[3, 4], [5, 6]]),
    "Dict of all": Dict(a=MultiBinary(2), b=Tuple([MultiDiscrete([2, 3]), Discrete(4, start=-1)]), c=Box(-1, 1, (2,))),
}


@pytest.mark.few
@pytest.mark.parametrize("space", SPACES.values(), ids=SPACES)
def test_a_model_comes_back_whatever_it_observes(tmp_path, space):
    observing = kind("Observing", Tall, observation_space=space, observe=lambda self: space.sample())
    made = A2C(observing, "hl-gauss", n_bins=5, net_arch=(4,))
    loaded = A2C.load(made.save(tmp_path / "model"))
    seen = space.sample()
    assert loaded.observation_space == space
    np.testing.assert_array_equal(*(each.predict(seen, deterministic=True)[0] for each in (made, loaded)))


@pytest.fixture(scope="module")
def normalised(tmp_path_factory):
    path = tmp_path_factory.mktemp("normalised") / "model"
    model = A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,), normalize_observation=True, normalize_reward=True)
    return model.save(path)


def test_statistics_that_mean_nothing_are_refused_by_name(normalised, tmp_path):
    A2C.load(normalised)
    for name, value, wanted in (
        ("observation/mean", np.nan, "finite"),
        ("observation/variance", np.inf, "finite, and 0 or more"),
        ("observation/variance", -1.0, "finite, and 0 or more"),
        ("observation/n", np.nan, "finite, and 0 or more"),
        ("discounted_return/variance", -0.5, "finite, and 0 or more"),
        ("running_return", np.inf, "finite"),
    ):
        path = rewritten(normalised, tmp_path / "hostile", put(f"run/learner/normalizer/{name}", value))
        with pytest.raises(
            CheckpointError, match=rf"hostile .*{name} in the checkpoint holds .*; it must be {wanted}$"
        ):
            A2C.load(path)


def test_a_training_that_no_memory_holds_is_refused_where_it_would_begin(model, tmp_path):
    def attack(settings, arrays):
        settings["config"].update(n_steps=10**8, n_envs=20)
        settings["step"] = 0
        arrays["run/step"] = np.zeros_like(arrays["run/step"])
        for name in [name for name in arrays if name.startswith("environments/")]:
            del arrays[name]

    path = rewritten(model, tmp_path / "hostile", attack)
    assert A2C.load(path).num_timesteps == 0
    with pytest.raises(UsageError, match=r"^n_envs or n_steps is 20 or 100000000, too many: this needs"):
        A2C.load(path, "lqr")


def test_a_damaged_run_is_refused_where_it_is_to_go_on(model, tmp_path):
    for attack in (
        change("run/key", lambda x: x[:, :1]),
        change("run/tally/n_episodes", lambda x: x.astype(np.int32)),
        lambda settings, arrays: arrays.pop("run/tally/length"),
    ):
        with pytest.raises(CheckpointError, match="hostile"):
            A2C.load(rewritten(model, tmp_path / "hostile", attack), env="lqr")


class Few(FlaxNetwork):
    """A network that looks at two of its inputs, so that it has far fewer numbers than there are."""

    module = types.SimpleNamespace(init=lambda key, x: {"w": np.ones(1)}, apply=lambda v, x: x[..., :2] * v["w"])


def test_a_space_may_have_more_entries_than_the_file_has_numbers(tmp_path, monkeypatch):
    monkeypatch.setitem(galton.NETWORKS, "few", Few)
    wide = kind("Wide", observation_space=Box(-1, 1, (3000,)), observe=lambda self: np.zeros(3000, np.float32))
    model = A2C(wide, "gaussian", network="few", n_steps=2)
    loaded = A2C.load(model.save(tmp_path / "model"))
    np.testing.assert_array_equal(loaded.predict(np.zeros(3000), deterministic=True)[0].shape, (1,))


def test_a_setting_may_be_longer_than_the_list_of_arrays(tmp_path):
    parts = Dict({f"motor {i}": Box(-1, 1, ()) for i in range(21)})
    many = kind("Many", action_space=parts, step=lambda self, action: Tall.step(self, np.zeros(4)))
    per_motor = {name: dict.fromkeys(parts, value) for name, value in (("n_bins", 5), ("eta", 1.0))}
    model = A2C(many, "hl-gauss", **per_motor, net_arch=(4,), n_steps=2)
    assert A2C.load(model.save(tmp_path / "model")).settings == model.settings


def test_a_part_of_ones_own_that_is_not_registered_is_named_with_what_to_do(tmp_path, monkeypatch):
    class Own(galton.LOSSES["hl-one-hot"]):
        pass

    monkeypatch.setitem(galton.LOSSES, "own", Own)
    path = A2C("lqr", "own", n_bins=5, net_arch=(4,)).save(tmp_path / "model")
    monkeypatch.undo()
    with pytest.raises(UsageError, match=r"the checkpoint's loss has own, .* import the module where the part is reg"):
        A2C.load(path)
