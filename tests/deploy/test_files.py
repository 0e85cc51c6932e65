"""The two files of an exported policy: what stands in them, and what they are refused for."""

import hashlib
import json
import re
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import onnx
import onnxruntime
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from gymnasium.wrappers import NormalizeObservation

import galton
from galton import UsageError, deploy
from galton.deploy.decision import bounds
from galton.envs.host.actions import Actions
from galton.policies import Gaussian

from ..envs.host.walks import kind
from .drifting import HIGH, LOW, Drifting, states, trained

TINY = {"n_bins": 5, "net_arch": (4,), "n_steps": 2}


def varied(observed=None, acted=None):
    """An environment with spaces of one's choice; nothing happens in it."""
    observed = Box(-1.0, 1.0, (3,)) if observed is None else observed
    acted = Box(-1.0, 1.0, (2,)) if acted is None else acted
    return kind("Varied", observation_space=observed, action_space=acted, observe=lambda self: observed.sample())


def model_on(loss="hl-gauss", observed=None, acted=None, **settings):
    return galton.A2C(varied(observed, acted), loss, **TINY | settings)


def run(path, observations):
    session = onnxruntime.InferenceSession(path)
    return session.run(["action"], {"observation": np.asarray(observations, np.float32)})[0]


@pytest.fixture(scope="module")
def small():
    """A model with statistics and parameters as if it had learnt."""
    model = galton.A2C(lambda: Drifting(LOW[:2], HIGH[:2]), "hl-gauss", seed=1, normalize_observation=True, **TINY)
    learnt, rng = model.get_parameters(), np.random.default_rng(0)
    learnt["actor"][-1]["kernel"] = rng.normal(size=learnt["actor"][-1]["kernel"].shape)
    seen = learnt["normalizer"]["observation"]
    seen |= {"mean": 0 * seen["mean"] + 1, "variance": 0 * seen["mean"] + 9, "n": 0 * seen["n"] + 99}
    model.set_parameters(learnt)
    return model


def test_the_contract_says_what_the_file_takes_and_gives(small, tmp_path, monkeypatch):
    monkeypatch.setattr(type(small), "num_timesteps", 640)
    path = deploy.export(small, tmp_path / "policy.onnx", {"command": "galton train"})
    contract = json.loads(path.with_suffix(".json").read_text())
    session = onnxruntime.InferenceSession(path)
    for place, there in (("input", session.get_inputs()), ("output", session.get_outputs())):
        assert [one.name for one in there] == [contract[place]["name"]]
        assert there[0].shape == contract[place]["shape"]
        assert there[0].type == f"tensor({contract[place]['dtype'].removesuffix('32')})"
    assert contract["contract"] == 1
    assert contract["file"] == "policy.onnx"
    assert contract["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert contract["observation_normalization"] == {"clip": 10.0}
    assert contract["rule"] == "mode"
    assert "most likely bin" in contract["rule_meaning"]
    assert contract["output"]["low"] == small.action_space.low.tolist()
    assert contract["output"]["high"] == small.action_space.high.tolist()
    assert contract["input"]["entries"][0]["low"] is None
    source = contract["source"]
    assert source["command"] == "galton train"
    assert (source["env"], source["loss"], source["policy"]) == ("Drifting", "hl-gauss", "histogram")
    assert (source["algorithm"], source["seed"], source["steps"]) == ("a2c", 1, 640)


@pytest.mark.slow
def test_an_old_runtime_knows_all_of_it(tmp_path):
    known = set()
    for rule in ("mode", "mean", "median"):
        model = trained("ordinal", "a2c", 1, 4, deterministic_action=rule, normalize_observation=True, **TINY)
        file = onnx.load(deploy.export(model, tmp_path / rule))
        assert file.ir_version == 7
        assert [(one.domain, one.version) for one in file.opset_import] == [("", 13)]
        known |= {node.op_type for node in file.graph.node}
        kinds = {tensor.data_type for tensor in file.graph.initializer}
        assert kinds <= {onnx.TensorProto.FLOAT, onnx.TensorProto.INT64}
    assert {"Clip", "CumSum", "ArgMax", "Softmax"} < known


@pytest.mark.slow
def test_the_same_model_gives_the_same_bytes_in_any_process(small, tmp_path):
    file = small.save(tmp_path / "model")
    code = "import sys, galton; galton.deploy.export(galton.Model.load(sys.argv[1]), sys.argv[2])"
    for seed in ("1", "2"):
        env = {"PYTHONHASHSEED": seed, "PATH": "", "PYTHONPATH": ":".join(sys.path)}
        subprocess.run([sys.executable, "-c", code, file, tmp_path / f"{seed}.onnx"], check=True, env=env, timeout=300)
    first, second = ((tmp_path / f"{seed}.onnx").read_bytes() for seed in ("1", "2"))
    assert first == second == deploy.export(small, tmp_path / "here").read_bytes()


def test_a_batch_may_have_any_size(small, tmp_path):
    path = deploy.export(small, tmp_path / "new" / "policy")
    assert sorted(file.name for file in path.parent.iterdir()) == ["policy.json", "policy.onnx"]
    for n in (0, 1, 7):
        assert run(path, states(n, 5)).shape == (n, 2)
        assert np.array_equal(run(path, states(n, 5)), small.predict(states(n, 5), deterministic=True)[0])


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["mode", "median"])
def test_of_bins_that_are_equally_likely_both_take_the_same(rule, tmp_path):
    model = model_on(deterministic_action=rule, n_bins=6)  # of zeros its logits are its biases, zeros
    nothing = np.zeros((3, 3), np.float32)
    expected = model.predict(nothing, deterministic=True)[0]
    assert np.array_equal(run(deploy.export(model, tmp_path / "policy"), nothing), expected)
    assert expected[0] == pytest.approx(-5 / 6 if rule == "mode" else 1 / 6)


OBSERVED = {
    "matrix": Box(-1.0, 1.0, (2, 3)),
    "scalar": Box(-1.0, 1.0, ()),
    "float64": Box(-1.0, 1.0, (3,), np.float64),
    "image": Box(0, 255, (2, 2, 1), np.uint8),
}


@pytest.mark.few
@pytest.mark.filterwarnings("ignore:.* observes Box.*an image is flattened")
@pytest.mark.parametrize("name", OBSERVED)
def test_a_box_is_observed_in_its_own_shape(name, tmp_path):
    space = OBSERVED[name]
    model = model_on("gaussian", space)
    observations = np.stack([space.sample() for _ in range(4)])
    expected = model.predict(observations, deterministic=True)[0]
    path = deploy.export(model, tmp_path / "policy")
    assert json.loads(path.with_suffix(".json").read_text())["input"]["shape"] == ["batch", *space.shape]
    assert run(path, observations) == pytest.approx(expected, abs=1e-6)


def test_the_contract_tells_the_parts_of_a_flat_observation_apart(tmp_path):
    parts = Tuple((MultiDiscrete([2, 3]), MultiBinary(2)))
    space = Dict({"b": Box(-1.0, np.inf, (2,)), "a": Discrete(3, start=5), "c": parts})
    model = model_on("gaussian", space)
    path = deploy.export(model, tmp_path / "policy")
    given = json.loads(path.with_suffix(".json").read_text())["input"]
    assert given["shape"] == ["batch", 12]
    spans = [(entry["part"], entry["from"], entry["to"], entry["encoding"]) for entry in given["entries"]]
    at, expected = 0, []
    for key in space.spaces:
        for part, size, encoding in {
            "a": [(["a"], 3, "one-hot")],
            "b": [(["b"], 2, "as it is")],
            "c": [(["c", 0], 5, "one-hot, one after the other"), (["c", 1], 2, "0 or 1")],
        }[key]:
            expected.append((part, at, at + size, encoding))
            at += size
    assert spans == expected
    sample = space.sample()
    flat = gymnasium.spaces.flatten(space, sample)
    assert run(path, flat[None])[0] == pytest.approx(model.predict(sample, deterministic=True)[0], abs=1e-6)


def test_an_action_has_the_environments_shape_and_bounds_of_more_digits_are_kept_by_actions_of_fewer(tmp_path):
    low, high = np.array([[-0.1, 0.7]]), np.array([[0.1, 2.3]])
    model = model_on("gaussian", acted=Box(low, high, dtype=np.float64), net_arch=())
    path, observations = deploy.export(model, tmp_path / "policy"), states(1000, 3)
    near = np.tanh(observations)
    assert run(path, near) == pytest.approx(model.predict(near, deterministic=True)[0], abs=1e-6)
    actions = run(path, 1e6 * observations).astype(np.float64)
    assert ((actions >= low) & (actions <= high)).all()
    assert (np.ptp(actions, 0) > 0.99 * (high - low)).all()


def test_a_policy_of_ones_own_says_how_its_action_is_computed(monkeypatch, tmp_path):
    class Own(galton.POLICIES["gaussian"]):
        pass

    monkeypatch.setitem(galton.POLICIES, "own", Own)
    model = model_on("gaussian", policy="own")
    with pytest.raises(UsageError, match=r"policy is 'own', of which nobody .* galton.deploy.ACTIONS\['own'\]"):
        deploy.export(model, tmp_path / "policy")
    assert not [*tmp_path.iterdir()]
    monkeypatch.setitem(deploy.ACTIONS, "own", lambda graph, outputs, *_: deploy.Chosen(outputs, "mean", "The mean."))
    observations = states(9, 3)
    found = run(deploy.export(model, tmp_path / "policy"), observations)
    assert found == pytest.approx(model.predict(observations, deterministic=True)[0], abs=1e-6)


class Own(galton.Policy):
    """A Gaussian whose parameter is called as those of Galton's are, and none of whose settings is."""

    @property
    def n_outputs(self):
        return len(self.low)

    def init(self):
        return jnp.zeros(self.n_outputs), {"log_std": jnp.zeros(self.n_outputs)}

    def noise(self, key, shape):
        return jax.random.normal(key, (*shape, self.n_outputs))

    def distribution(self, outputs, params):
        return Gaussian(outputs, params["log_std"], self.low, self.high)


def test_a_parameter_of_ones_own_may_have_any_name(monkeypatch, tmp_path):
    monkeypatch.setitem(galton.POLICIES, "own", Own)
    monkeypatch.setitem(deploy.ACTIONS, "own", lambda graph, outputs, *_: deploy.Chosen(outputs, "mean", "The mean."))
    model, observations = model_on("gaussian", policy="own"), states(9, 3)
    found = run(deploy.export(model, tmp_path / "policy"), observations)
    assert found == pytest.approx(model.predict(observations, deterministic=True)[0], abs=1e-6)


def test_the_contract_names_an_algorithm_of_ones_own(tmp_path):
    class Mine(galton.algorithms.A2C):
        label = "Mine"

    model = galton.Model("lqr", "gaussian", algorithm=Mine(), n_steps=4, net_arch=(), n_envs=1)
    file = deploy.export(model, tmp_path / "policy")
    assert json.loads(file.with_suffix(".json").read_text())["source"]["algorithm"] == "Mine"


ODD_STEPS = {
    "no operator": lambda graph, outputs: graph.add("Frobnicate", outputs),
    "no such name": lambda graph, outputs: graph.add("Neg", "inputs"),
    "a name twice": lambda graph, outputs: graph.add("Neg", outputs, name="outputs"),
    "sizes that differ": lambda graph, outputs: graph.add("Add", outputs, np.zeros(3)),
}


def test_steps_that_make_no_graph_are_refused_before_anything_is_written(monkeypatch, tmp_path):
    model = model_on("gaussian")
    for odd in ODD_STEPS.values():
        entry = lambda graph, outputs, *_, odd=odd: deploy.Chosen(odd(graph, outputs), "mean", "The mean.")  # noqa: E731
        monkeypatch.setitem(deploy.ACTIONS, "gaussian", entry)
        with pytest.raises(
            UsageError, match=r"the policy's function in galton\.deploy\.ACTIONS makes no graph of ONNX:"
        ):
            deploy.export(model, tmp_path / "policy")
        assert not [*tmp_path.iterdir()]


def test_observations_that_float32_can_not_tell_apart_are_warned_of(tmp_path):
    for dtype, far in ((np.float64, True), (np.float64, False), (np.float32, True)):
        model = model_on(observed=Box(-np.inf, np.inf, (3,), dtype), normalize_observation=True)
        learnt = model.get_parameters()
        learnt["normalizer"]["origin"][:] = 1.7e9 * far
        learnt["normalizer"]["observation"] |= {"variance": np.ones(3, np.float32), "n": np.float32(99)}
        model.set_parameters(learnt)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            deploy.export(model, tmp_path / "policy")
        lost = [str(each.message) for each in told if "float32, the file's input" in str(each.message)]
        assert bool(lost) == (far and dtype == np.float64)  # of float32 the model itself sees no more


def test_a_policy_that_learnt_from_what_a_wrapper_normalises_says_so(tmp_path):
    model = galton.A2C(lambda: NormalizeObservation(gymnasium.make("Pendulum-v1")), "gaussian", net_arch=(4,))
    for each in (model, galton.A2C.load(model.save(tmp_path / "model"))):
        with pytest.warns(UserWarning, match=r"that NormalizeObservation normalised .*, which are not in the file"):
            deploy.export(each, tmp_path / "policy.onnx")
        units = json.loads((tmp_path / "policy.json").read_text())["input"]["units"]
        assert units == "as NormalizeObservation normalised them; every number must be finite"


def test_a_path_that_can_not_be_written_and_an_extra_that_is_missing_are_named(small, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    for path, message in (
        ("..", "path is '.*', which names no file"),
        ("policy.pt", r"path is .*policy.pt; its name must end in .onnx"),
        ("file/policy.onnx", "path is .*, which can't be written: .*; name another"),
    ):
        with pytest.raises(UsageError, match=message):
            deploy.export(small, ".." if path == ".." else tmp_path / path)
    for content in ('{"env": "lqr"}', "no JSON"):
        (tmp_path / "config.json").write_text(content)
        with pytest.raises(UsageError, match=r"path is .*config.onnx, whose contract would replace .*config.json"):
            deploy.export(small, tmp_path / "config.onnx")
        assert (tmp_path / "config.json").read_text() == content
    assert not (tmp_path / "config.onnx").exists()
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(UsageError, match=r"needs onnx: pip install .*\[onnx\]'"):
        deploy.export(small, tmp_path / "policy")


def test_the_bounds_are_the_spaces_own_where_they_are_float32_and_every_policy_has_an_export():
    space = Box(np.array([-1.0, 0.3], np.float32), np.array([0.1, 7.7], np.float32))
    np.testing.assert_array_equal(bounds(Actions("here", space)), (space.low, space.high))
    constant = Box(np.array([-1.0, 0.3]), np.array([1.0, 0.3]), dtype=np.float64)  # float32 has no 0.3
    low, high = bounds(Actions("here", constant))
    assert (low <= high).all()
    assert set(deploy.ACTIONS) == set(galton.POLICIES)


EXAMPLE = Path(__file__).parents[2] / "examples" / "deploy.py"
FORBIDDEN = """
import runpy, sys

class Forbidden:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("galton", "jax", "jaxlib", "gymnasium", "onnx", "scipy"):
            raise ImportError(f"{name} is not there")

sys.meta_path.insert(0, Forbidden())
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a policy that turns a pendulum somehow."""
    folder = tmp_path_factory.mktemp("exported")
    model = galton.A2C("Pendulum-v1", "hl-gauss", n_bins=5, net_arch=(8,), normalize_observation=True)
    galton.deploy.export(model, folder / "policy.onnx")
    return folder


def run_example(folder):
    command = [sys.executable, "-c", FORBIDDEN, EXAMPLE, folder]
    return subprocess.run(command, capture_output=True, text=True, timeout=100)


@pytest.mark.slow
def test_the_example_runs_a_policy_without_galton_or_jax(folder):
    done = run_example(folder)
    assert done.returncode == 0, done.stderr
    assert "a2c with hl-gauss, 0 steps, rule: mode" in done.stdout
    assert re.search(r"return of 10 swings: -\d+ ± \d+", done.stdout)


def test_a_file_that_the_contract_does_not_describe_is_refused(folder, tmp_path):
    for name in ("policy.onnx", "policy.json"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    with (tmp_path / "policy.onnx").open("ab") as file:
        file.write(b"\0")
    done = run_example(tmp_path)
    assert done.returncode == 1
    assert "policy.onnx is not the file that policy.json describes" in done.stderr


def test_its_pendulum_is_gymnasiums(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLE.parent)
    import deploy

    def act(observations):
        return np.clip(2 * observations[:, 1:2] - observations[:, 2:], -2, 2)

    (found,) = deploy.swing_up(act, n_episodes=1, seed=3)
    env, rng, expected = gymnasium.make("Pendulum-v1"), np.random.default_rng(3), 0.0
    env.reset(seed=0)
    env.unwrapped.state = np.array([rng.uniform(-np.pi, np.pi, 1)[0], rng.uniform(-1, 1, 1)[0]])
    observation = env.unwrapped._get_obs()
    for _ in range(200):
        observation, reward, *_ = env.step(act(observation[None])[0])
        expected += reward
    assert found == pytest.approx(expected, rel=1e-3)
