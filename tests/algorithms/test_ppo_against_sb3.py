"""Our PPO against Stable-Baselines3's (torch), from equal weights, on recorded rollouts, in the same minibatches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import sb3_contrib
import stable_baselines3
from gymnasium.spaces import Discrete, MultiDiscrete

from galton import make_agent
from galton.algorithms import ppo
from galton.envs.host.actions import Actions
from galton.parts import Box
from galton.torch.sb3 import HistogramPolicy
from galton.training.log import Finished, nothing
from galton.training.run import begin, learn

from .sb3_side import HIGH, LOW, K, Recorder, params_of, record_batch, relative_error, vector_of

SLOW = pytest.mark.slow
T, N, SIZE, EPOCHS = 32, 2, 16, 10
RATE = 2e-3
SAME = {
    "n_steps": T,
    "batch_size": SIZE,
    "n_epochs": EPOCHS,
    "gamma": 0.97,
    "gae_lambda": 0.9,
    "vf_coef": 0.4,
    "ent_coef": 0.01,
    "clip_range": 0.15,
    "max_grad_norm": 0.5,
    "learning_rate": RATE,
}
"""What both have by the same names."""
TOLD = {
    "clip_fraction": "train/clip_fraction",
    "approx_kl": "train/approx_kl",
    "policy_loss": "train/policy_gradient_loss",
    "value_loss": "train/value_loss",
}
"""Our names and SB3's."""


class Sides:
    """SB3's PPO and ours with the same settings and weights."""

    def __init__(
        self,
        monkeypatch,
        loss,
        *,
        normalize_advantage=True,
        target_kl=None,
        total=None,
        clip_range_vf=None,
        space=None,
        n_mask=0,
        of_ours=None,
    ):
        """`of_ours` are the settings of bins, where SB3 has the policy of galton.torch.sb3."""
        self.discrete, self.total = loss == "hl-one-hot" and of_ours is None, total
        self.envs = [Recorder(self.discrete, space, n_mask) for _ in range(N)]
        self.model = (sb3_contrib.MaskablePPO if n_mask else stable_baselines3.PPO)(
            "MlpPolicy" if of_ours is None else HistogramPolicy,
            vector_of(self.envs),
            normalize_advantage=normalize_advantage,
            target_kl=target_kl,
            clip_range_vf=clip_range_vf,
            **SAME | ({"learning_rate": lambda left: RATE * left} if total else {}),
            policy_kwargs=None if of_ours is None else of_ours | {"n_bins": K, "loss": loss},
            seed=3,
            device="cpu",
        )
        self.model._setup_learn(total or 10_000, None)
        self._record(monkeypatch)

        agent = make_agent(
            algorithm="ppo",
            loss=loss,
            n_bins=K,
            n_envs=N,
            normalize_advantage=normalize_advantage,
            target_kl=target_kl or np.inf,
            clip_range_vf=clip_range_vf,
            decay_steps=total or 0,
            **SAME | ({} if of_ours is None else of_ours | {"ratio": "true"}),
        )
        self.agent = agent.on(Box.of(LOW, HIGH) if space is None else Actions("the recorder", space, n_mask=n_mask).box)
        self.run, _ = begin(self.agent, 3 + n_mask, jnp.uint32(0))
        self.run = self.run._replace(
            learner=self.run.learner._replace(params=jax.tree.map(jnp.asarray, params_of(self.model)))
        )
        self._learn = jax.jit(self._in_these_orders)

    def _record(self, monkeypatch):
        """Write down SB3's permutations and its weights after each step."""
        self.permutations, self.after = [], []
        shuffle, step = np.random.permutation, self.model.policy.optimizer.step

        def shuffle_and_tell(n):
            self.permutations.append(shuffle(n))
            return self.permutations[-1]

        def step_and_tell(*args, **kwargs):
            step(*args, **kwargs)
            self.after.append(params_of(self.model))

        monkeypatch.setattr(np.random, "permutation", shuffle_and_tell)
        monkeypatch.setattr(self.model.policy.optimizer, "step", step_and_tell)

    def _in_these_orders(self, run, batch, orders):
        """What training does with a rollout, but for where the orders come from."""

        class InTheseOrders(ppo.PPO):
            def update(self, agent, learner, batch, key):
                return ppo.fit(agent, learner, ppo.prepare(agent, learner, batch), orders)

        agent = self.agent.replace(algorithm=InTheseOrders(**vars(self.agent.algorithm)))
        none = jnp.zeros((T, N), int)
        finished = Finished(none > 0, none.astype(float), none)
        return learn(agent, run, run.learner.normalizer, batch, finished)

    def rollout(self):
        """A rollout, and SB3's training on it."""
        self.permutations.clear()
        self.after.clear()
        batch = record_batch(self.model, self.envs, self.discrete)
        assert batch.terminated.any()
        assert batch.truncated.any()
        if self.total:
            self.model._update_current_progress_remaining(self.model.num_timesteps, self.total)
        self.model.train()
        return batch

    def learn(self, batch, orders):
        """Ours on the same rollout: the run after it, and what the update told."""
        run = self._learn(self.run._replace(tally=nothing(ppo.PPO.scalars)), batch, orders)
        return run, {name: float(value) for name, value in run.tally.diagnostics.items()}

    def orders(self):
        """SB3's permutations of its rows, which are one environment's after the other's, as orders of ours.

        An epoch that SB3 did not begin is in some order, which must not matter.
        """
        rows = np.tile(np.arange(T * N), (EPOCHS, 1))
        rows[: len(self.permutations)] = self.permutations
        return jnp.asarray(rows % T * N + rows // T)


def check_told(sides, told):
    for ours, theirs in TOLD.items():
        expected = sides.model.logger.name_to_value[theirs]
        np.testing.assert_allclose(told[ours], expected, rtol=1e-3, atol=1e-5, err_msg=ours)
    np.testing.assert_allclose(told["entropy"], -sides.model.logger.name_to_value["train/entropy_loss"], rtol=1e-4)


def check_update(sides):
    """Hold one minibatch and ten epochs against SB3's; how far apart the changes of the weights are in the end."""
    start = params_of(sides.model)
    batch = sides.rollout()
    assert len(sides.after) == EPOCHS * T * N // SIZE

    first, _ = sides.learn(batch, sides.orders()[:1, :SIZE])
    change = jax.tree.map(np.subtract, sides.after[0], start)
    assert all(np.abs(leaf).max() > 1e-4 for leaf in jax.tree.leaves(change))
    # An entry may be off by 2e-4 of Adam's step: where a gradient is near Adam's ε, rounding shows.
    close = {"rtol": 1e-5, "atol": 2e-4 * RATE}
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, **close), first.learner.params, sides.after[0])

    whole, told = sides.learn(batch, sides.orders())
    ours, theirs = (jax.tree.map(np.subtract, end, start) for end in (whole.learner.params, sides.after[-1]))
    apart = relative_error(ours, theirs)
    assert apart < 1e-3
    assert told["clip_fraction"] > 0.05
    check_told(sides, told)
    return apart


@pytest.mark.parametrize(
    ("loss", "normalize_advantage", "clip_range_vf", "space", "n_mask"),
    [
        ("gaussian", False, None, None, 0),
        pytest.param("gaussian", True, None, None, 0, marks=pytest.mark.optimised),
        pytest.param("hl-one-hot", False, None, None, 0, marks=pytest.mark.slow),
        ("hl-one-hot", True, 0.02, None, 0),
        pytest.param("hl-one-hot", False, None, Discrete(5), 0, marks=pytest.mark.slow),
        pytest.param("gaussian", True, None, MultiDiscrete([3, 7]), 0, marks=pytest.mark.slow),
        pytest.param("hl-one-hot", True, None, Discrete(5), 5, marks=pytest.mark.slow),
        ("hl-one-hot", True, None, MultiDiscrete([3, 7]), 10),
    ],
)
def test_one_minibatch_and_ten_epochs_equal_sb3s(
    monkeypatch, loss, normalize_advantage, clip_range_vf, space, n_mask, trust
):
    words = {"clip_range_vf": clip_range_vf, "space": space, "n_mask": n_mask}
    sides = Sides(monkeypatch, loss, normalize_advantage=normalize_advantage, **words)
    apart = check_update(sides)
    promise = "Ten epochs of PPO move the weights as Stable-Baselines3's do, minibatch by minibatch."
    trust("ppo-and-sb3", promise, topic="numbers", figure=apart, unit="apart, relative to the change", at_most=1e-3)


@pytest.mark.parametrize(
    ("loss", "words"),
    [
        ("hl-gauss-centred", {"eta": 1.5, "bin_centers": "bounds", "target_tails": "reflected"}),
        pytest.param("hl-gauss", {"eta": 0.7, "bin_centers": "inside", "target_tails": "rescaled"}, marks=SLOW),
        pytest.param(
            "hl-gauss-centred",
            {"eta": 2.0, "bin_centers": "bounds", "target_tails": "edges", "head_scale": 1.5},
            marks=SLOW,
        ),
        pytest.param("hl-one-hot", {"bin_centers": "inside"}, marks=SLOW),
    ],
)
def test_sb3s_ppo_with_the_distribution_in_torch_is_galtons(monkeypatch, loss, words, trust):
    apart = check_update(Sides(monkeypatch, loss, of_ours=words))
    promise = "Stable-Baselines3's PPO with Galton's distribution in torch moves the weights as Galton's PPO does."
    trust("torch-and-sb3", promise, topic="numbers", figure=apart, unit="apart, relative to the change", at_most=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["gaussian", "hl-one-hot"])
def test_rollouts_with_a_learning_rate_that_decays_equal_sb3s(monkeypatch, loss):
    sides = Sides(monkeypatch, loss, total=4 * T * N)
    for left in (0.75, 0.5, 0.25, 0.0):
        before, batch = sides.run, sides.rollout()
        sides.run, told = sides.learn(batch, sides.orders())
        assert sides.model.policy.optimizer.param_groups[0]["lr"] == pytest.approx(left * RATE)
        assert relative_error(sides.run.learner.params, sides.after[-1]) < 1e-3
        check_told(sides, told)
    assert int(sides.run.updates) * sides.agent.rollout.size == sides.model.num_timesteps
    assert relative_error(sides.run.learner.params, before.learner.params) == 0


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["gaussian", "hl-one-hot"])
def test_target_kl_stops_where_sb3_stops(monkeypatch, loss):
    sides = Sides(monkeypatch, loss, target_kl=0.02)
    batch = sides.rollout()
    assert 1 < len(sides.permutations) < EPOCHS
    assert len(sides.after) < len(sides.permutations) * T * N // SIZE
    run, told = sides.learn(batch, sides.orders())
    assert relative_error(run.learner.params, sides.after[-1]) < 1e-3
    assert int(run.learner.optimizer.count) == len(sides.after)
    check_told(sides, told)
