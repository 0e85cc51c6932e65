"""Networks against torch's: outputs and gradients; and what becomes of them in models, files and ONNX."""

import functools

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import onnxruntime
import pytest
import torch

from galton import A2C, NETWORKS, UsageError
from galton.deploy import export
from galton.networks import ACTIVATIONS, MLP, FlaxNetwork, SimBa, mlp
from galton.types import Count

N_IN, OUT, B = 5, 3, 16
THEIRS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU, "silu": torch.nn.SiLU}


class Width(FlaxNetwork):
    """A Flax module of a width of one's own."""

    label = "flax"
    flax_width: Count = 7

    @property
    def module(self):
        return nn.Sequential([nn.Dense(self.flax_width), nn.gelu])


@pytest.fixture
def flax_network(monkeypatch):
    monkeypatch.setitem(NETWORKS, "flax", Width)


def moved(layers):
    """The layers with all numbers moved at random, biases and norms included."""
    leaves, structure = jax.tree.flatten(layers)
    keys = jax.random.split(jax.random.key(1), len(leaves))
    return jax.tree.unflatten(
        structure, [x + 0.1 * jax.random.normal(key, x.shape) for key, x in zip(keys, leaves, strict=True)]
    )


def torch_linear(layer):
    made = torch.nn.Linear(*layer["kernel"].shape).double()
    made.weight.data, made.bias.data = (
        torch.tensor(np.array(layer["kernel"]).T).double(),
        torch.tensor(np.array(layer["bias"])).double(),
    )
    return made


def torch_norm(layer):
    made = torch.nn.LayerNorm(len(layer["scale"]), eps=1e-6).double()
    made.weight.data, made.bias.data = (torch.tensor(np.array(layer[name])).double() for name in ("scale", "bias"))
    return made


class TorchSimBa(torch.nn.Module):
    """SimBa as its paper draws it: embedding, x + MLP(norm(x)), a last norm, and the output layer."""

    def __init__(self, layers):
        super().__init__()
        embedding, *blocks, norm, last = layers
        self.embedding = torch_linear(embedding)
        self.blocks = torch.nn.ModuleList(
            torch.nn.Sequential(
                torch_norm(block["norm"]), torch_linear(block["up"]), torch.nn.ReLU(), torch_linear(block["down"])
            )
            for block in blocks
        )
        self.norm, self.last = torch_norm(norm), torch_linear(last)

    def forward(self, x):
        x = self.embedding(x)
        for block in self.blocks:
            x = x + block(x)
        return self.last(self.norm(x))


def torch_mlp(layers, activation):
    hidden = [step for layer in layers[:-1] for step in (torch_linear(layer), THEIRS[activation]())]
    return torch.nn.Sequential(*hidden, torch_linear(layers[-1]))


def gradients_of(model):
    """Theirs, in our shapes: a kernel is a matrix the other way round."""
    return [(p.grad.T if p.ndim == 2 else p.grad).numpy() for p in model.parameters()]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("network", "theirs"),
    [
        (SimBa(simba_width=8, simba_blocks=2), TorchSimBa),
        *[(MLP((8, 6), activation=name), lambda layers, name=name: torch_mlp(layers, name)) for name in ACTIVATIONS],
    ],
)
def test_outputs_and_gradients_are_torchs(network, theirs):
    layers = moved(network.init(jax.random.key(0), N_IN, OUT, 1.0, of_critic=False))
    x = np.random.default_rng(0).normal(size=(B, N_IN)).astype(np.float32)
    other = theirs(layers)
    outputs = other(torch.tensor(x).double())
    np.testing.assert_allclose(network(layers, jnp.asarray(x)), outputs.detach(), atol=1e-5)
    (outputs**2).sum().backward()
    ours = jax.grad(lambda layers: (network(layers, jnp.asarray(x)) ** 2).sum())(layers)
    flat = [leaf for layer in ours for leaf in in_torchs_order(layer)]
    for found, expected in zip(flat, gradients_of(other), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


def in_torchs_order(layer):
    """The weights of a layer or block: each kernel or scale before its bias."""
    if "up" in layer:
        return [leaf for part in ("norm", "up", "down") for leaf in in_torchs_order(layer[part])]
    return [layer["kernel"] if "kernel" in layer else layer["scale"], layer["bias"]]


@pytest.mark.slow
@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_the_lipschitz_constant_is_the_largest_gradient_norm_of_an_output(activation):
    network, s = MLP((8, 6), activation=activation), jnp.array([0.1, -0.2, 0.3, 0.7, -1.0])
    layers = moved(network.init(jax.random.key(0), N_IN, OUT, 1.0, of_critic=False))
    norms = []
    for j in range(OUT):
        gradient = jax.grad(lambda hidden, j=j: network([*hidden, layers[-1]], s)[j])(layers[:-1])
        norms.append(np.sqrt(sum(np.sum(np.square(leaf)) for leaf in jax.tree.leaves(gradient))))
    np.testing.assert_allclose(network.lipschitz(layers, s), max(norms), rtol=1e-5)


@pytest.mark.slow
def test_kernels_start_as_they_are_said_to():
    first, *_, last = MLP((512,), kernel_init="lecun").init(jax.random.key(0), 400, 4, 0.5, of_critic=False)
    assert float(first["kernel"].std()) == pytest.approx(400**-0.5, rel=0.02)
    np.testing.assert_allclose(last["kernel"].T @ last["kernel"], 0.25 * np.eye(4), atol=1e-5)
    embedding, block, *_ = SimBa(simba_width=256).init(jax.random.key(0), 4, 2, 1.0, of_critic=False)
    np.testing.assert_allclose(embedding["kernel"] @ embedding["kernel"].T, np.eye(4), atol=1e-5)
    assert float(block["up"]["kernel"].std()) == pytest.approx((2 / 256) ** 0.5, rel=0.02)


@pytest.mark.few
@pytest.mark.parametrize(
    ("own", "actor", "critic"),
    [
        ({"net_arch": {"pi": [8], "vf": (6, 4)}}, [(2, 8), (8, 20)], [(2, 6), (6, 4), (4, 1)]),
        ({"net_arch": [8], "critic_arch": []}, [(2, 8), (8, 20)], [(2, 1)]),
        ({"net_arch": (8, 8)}, [(2, 8), (8, 8), (8, 20)], [(2, 8), (8, 8), (8, 1)]),
    ],
)
def test_actor_and_critic_have_widths_of_their_own(own, actor, critic):
    found = A2C("lqr", "hl-gauss", n_bins=10, **own).get_parameters()
    for name, shapes in (("actor", actor), ("critic", critic)):
        assert [layer["kernel"].shape for layer in found[name]] == shapes


def test_beside_simba_a_critic_may_be_an_mlp():
    network = SimBa(critic_arch=(8, 6))
    layers = moved(network.init(jax.random.key(0), N_IN, OUT, 1.0, of_critic=True))
    x = np.random.default_rng(0).normal(size=(B, N_IN)).astype(np.float32)
    expected = torch_mlp(layers, "tanh")(torch.tensor(x).double())
    np.testing.assert_allclose(network(layers, jnp.asarray(x)), expected.detach(), atol=1e-5)
    assert len(network.init(jax.random.key(0), N_IN, OUT, 1.0, of_critic=False)) == 4


def test_net_arch_of_one_network_alone_is_refused():
    with pytest.raises(UsageError, match=r"^net_arch is {'pi': \[8\]}; give one list for both networks, or a list"):
        A2C("lqr", "hl-gauss", net_arch={"pi": [8]})


NETWORKS_OF_OURS = [
    {"network": "simba", "simba_width": 8, "simba_critic_width": 12, "simba_blocks": 2},
    *({"net_arch": (8, 8), "activation": name, "kernel_init": "lecun"} for name in ACTIVATIONS),
    {"net_arch": (8,), "critic_arch": (4, 4)},
    {"network": "simba", "simba_width": 8, "critic_arch": (4, 4)},
]


@pytest.mark.few
@pytest.mark.parametrize("own", NETWORKS_OF_OURS)
def test_a_model_with_each_network_is_saved_goes_on_and_is_exported(own, tmp_path):
    model = A2C("lqr", "hl-gauss", n_bins=9, deterministic_action="mean", **own).learn(40, progress_bar=False)
    path = model.save(tmp_path / "model")
    again = A2C.load(path, "lqr")
    assert again.settings == model.settings
    for one in (model, again):
        one.learn(40, progress_bar=False)
    for ours, theirs in zip(jax.tree.leaves(model.learner), jax.tree.leaves(again.learner), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    states = np.random.default_rng(0).normal(size=(10_000, 2)).astype(np.float32)
    session = onnxruntime.InferenceSession(export(model, tmp_path / "policy.onnx"))
    (actions,) = session.run(None, {"observation": states})
    np.testing.assert_allclose(actions, model.predict(states, deterministic=True)[0], rtol=0, atol=1e-6)


@pytest.mark.slow
def test_a_flax_module_trains_and_is_saved_and_says_that_it_is_not_exported(flax_network, tmp_path):
    model = A2C("bandit", "gaussian", network="flax", flax_width=6, learning_rate=0.05, box_units=1.0)
    before = model.evaluate(20).mean()
    model.learn(2_000, progress_bar=False)
    assert model.evaluate(20).mean() > before + 5
    again = A2C.load(model.save(tmp_path / "model"), "bandit")
    assert again.settings["flax_width"] == 6
    np.testing.assert_array_equal(again.predict(np.ones(1))[0].shape, model.predict(np.ones(1))[0].shape)
    assert "train/grad_bound" not in logged(model)  # nobody has said its Lipschitz constant
    with pytest.raises(UsageError, match=r"^network is a Width, of which nobody has said how it is"):
        export(model, tmp_path / "policy.onnx")


def test_a_flax_module_of_half_precision_learns_in_float32(monkeypatch):
    half = {"dtype": jnp.bfloat16, "param_dtype": jnp.bfloat16}
    monkeypatch.setattr(Width, "module", nn.Dense(7, **half))
    monkeypatch.setitem(NETWORKS, "flax", Width)
    model = A2C("bandit", "gaussian", network="flax", learning_rate=0.05)
    before = model.get_parameters()["actor"]
    model.learn(100, progress_bar=False)
    after = model.get_parameters()["actor"]
    for mine, theirs in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
        assert mine.dtype == theirs.dtype == np.float32
        assert (mine != theirs).any()


def logged(model):
    logs = []
    model.learn(20, lambda _, log: logs.append(dict(log)) and None, progress_bar=False, log_interval=1)
    return logs[-1]


def test_products_on_an_accelerator_are_plain_ones_with_the_same_gradient(monkeypatch):
    layers = MLP(net_arch=(8,)).init(jax.random.key(0), 3, 2, 1.0, of_critic=False)
    x = jax.random.normal(jax.random.key(1), (5, 3))

    def gradient(layers):
        return jax.grad(lambda layers: (mlp(layers, x) ** 2).sum())(layers)

    here, program = gradient(layers), str(jax.make_jaxpr(lambda layers: gradient(layers))(layers))
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    jax.tree.map(functools.partial(np.testing.assert_allclose, rtol=1e-5), gradient(layers), here)
    assert "optimization_barrier" in program
    assert "optimization_barrier" not in str(jax.make_jaxpr(lambda layers: gradient(layers))(layers))
