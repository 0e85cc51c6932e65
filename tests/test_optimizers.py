"""Optimizers against torch's and Stable-Baselines3's, step by step."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
import torch
from stable_baselines3.common.sb2_compat.rmsprop_tf_like import RMSpropTFLike

import galton
from galton.optimizers import OPTIMIZERS, Adam, AdamW, Optimizer, RMSprop, count

RATE = 0.02
THEIRS = {
    Adam(RATE): lambda p: torch.optim.Adam(p, RATE, eps=1e-5),
    AdamW(RATE, weight_decay=0.3): lambda p: torch.optim.AdamW(p, RATE, eps=1e-5, weight_decay=0.3),
    RMSprop(RATE): lambda p: RMSpropTFLike(p, RATE, alpha=0.99, eps=1e-5),
    RMSprop(RATE, rms_decay=0.5): lambda p: RMSpropTFLike(p, RATE, alpha=0.5, eps=1e-5),
}


class OfEach(Optimizer):
    """The critic's gradient is scaled down, the actor's is Adam's."""

    label = "of each"

    @property
    def transformation(self):
        kinds = {"a": optax.scale_by_adam(), "c": optax.scale(0.1)}
        return optax.multi_transform(kinds, {"actor": "a", "critic": "c"})


def test_a_transformation_may_name_actor_and_critic():
    params = {"actor": jnp.ones(3), "critic": jnp.ones(2)}
    optimizer = OfEach(RATE)
    after, state, _ = optimizer.step(params, optimizer.init(params), jax.tree.map(lambda x: x / 10, params))
    np.testing.assert_allclose(after["actor"], 1 - RATE, rtol=1e-5)
    np.testing.assert_allclose(after["critic"], 1 - RATE / 100, rtol=1e-6)
    assert int(count(state)) == 1


@pytest.mark.slow
@pytest.mark.parametrize(("ours", "theirs"), THEIRS.items())
def test_twenty_steps_are_those_of_torch(ours, theirs):
    rng = np.random.default_rng(0)
    start = {"actor": rng.normal(size=(3, 4)).astype(np.float32), "critic": rng.normal(size=2).astype(np.float32)}
    params, weights = start, [torch.nn.Parameter(torch.tensor(value)) for value in start.values()]
    state, other = ours.init(params), theirs(weights)
    for _ in range(20):
        gradient = {name: rng.normal(size=value.shape).astype(np.float32) for name, value in start.items()}
        params, state, norm = ours.step(params, state, jax.tree.map(jnp.asarray, gradient))
        for weight, given in zip(weights, gradient.values(), strict=True):
            weight.grad = torch.tensor(given)
        expected = torch.nn.utils.clip_grad_norm_(weights, 0.5)
        assert float(norm) == pytest.approx(float(expected), rel=1e-5)
        other.step()
    assert int(count(state)) == 20
    for found, weight in zip(params.values(), weights, strict=True):
        np.testing.assert_allclose(found, weight.detach(), rtol=1e-5, atol=1e-6)


class Lion(Optimizer):
    """Its memory is in bfloat16, which files do not have."""

    label = "Lion"

    @property
    def transformation(self):
        return optax.scale_by_lion(mu_dtype=jnp.bfloat16)


def test_a_memory_in_bfloat16_goes_on_to_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setitem(OPTIMIZERS, "lion", Lion)
    model = galton.A2C("bandit", "gaussian", optimizer="lion", learning_rate=1e-3)
    model.advance(3)
    loaded = galton.A2C.load(model.save(tmp_path / "model"), "bandit")
    for one in (model, loaded):
        one.advance(3)
    for ours, theirs in zip(*(jax.tree.leaves(one.learner) for one in (model, loaded)), strict=True):
        np.testing.assert_array_equal(ours, theirs)
