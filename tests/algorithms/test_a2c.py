import jax
import jax.numpy as jnp
import pytest

from .rollouts import setup, update


def test_an_update_tells_the_scalars_that_its_class_names():
    agent, learner, batch = setup("gaussian")
    _, told = update(agent, learner, batch)
    assert set(told) == set(agent.algorithm.scalars)


def test_the_step_is_bounded_by_max_grad_norm():
    agent, learner, batch = setup("gaussian", max_grad_norm=0.5)
    huge = batch._replace(reward=1e6 * batch.reward)
    after, told = update(agent, learner, huge)
    assert float(told["grad_norm"]) > 1e3
    clipped = jax.tree.map(lambda moment: moment / 0.1, after.optimizer.mu)  # the first moment after one step is 0.1 g
    norm = float(jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(clipped))))
    assert norm == pytest.approx(0.5, rel=1e-4)


@pytest.mark.few
@pytest.mark.parametrize("loss", ["gaussian", "hl-gauss"])
def test_the_entropy_bonus_raises_entropy(loss):
    entropies = []
    for ent_coef in (0.0, 1.0):
        agent, learner, batch = setup(loss, ent_coef=ent_coef, learning_rate=1e-2)
        still = batch._replace(reward=jnp.zeros_like(batch.reward))
        for _ in range(20):
            learner, told = update(agent, learner, still)
        entropies.append(float(told["entropy"]))
    assert entropies[1] > entropies[0]
