"""The distribution in the libraries that people train with in PyTorch: `make test-others`."""

import numpy as np
import pytest
import torch
from torch import nn

import galton
from galton.torch import Histogram, initialize_

reason = "make test-others installs it"
runners = pytest.importorskip("rsl_rl.runners", reason=reason)
torchrl = pytest.importorskip("torchrl", reason=reason)
skrl = pytest.importorskip("skrl", reason=reason)
tensordict = pytest.importorskip("tensordict", reason=reason)
pytestmark = pytest.mark.filterwarnings("ignore")  # the libraries' own

N = 64


class Points:
    """Points in a plane that are to be pushed into the middle, in torch, as rsl_rl steps environments."""

    num_envs, num_actions, max_episode_length, device, cfg = N, 2, 20, "cpu", {}

    def __init__(self):
        self.episode_length_buf = torch.zeros(N, dtype=torch.long)
        self.position = 2 * torch.rand(N, 2) - 1

    def get_observations(self):
        return tensordict.TensorDict({"policy": self.position.clone()}, batch_size=[N])

    def step(self, actions):
        assert bool((actions.abs() <= 1).all())
        self.position = (self.position + 0.2 * actions).clamp(-1, 1)
        reward = -self.position.norm(dim=-1)
        self.episode_length_buf += 1
        ended = self.episode_length_buf >= self.max_episode_length
        self.position = torch.where(ended[:, None], 2 * torch.rand(N, 2) - 1, self.position)
        self.episode_length_buf[ended] = 0
        return self.get_observations(), reward, ended, {"time_outs": ended}


def runner(loss):
    body = {"class_name": "MLPModel", "hidden_dims": [32, 32], "activation": "elu"}
    histogram = {"class_name": "galton.torch.rsl_rl:Histogram", "n_bins": 21, "loss": loss, "eta": 1.0}
    return runners.OnPolicyRunner(
        Points(),
        {
            "num_steps_per_env": 20,
            "save_interval": 1000,
            "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
            "algorithm": {
                "class_name": "PPO",
                "learning_rate": 1e-3,
                "schedule": "adaptive",
                "desired_kl": 0.02,
                "entropy_coef": 0.0,
                "num_learning_epochs": 5,
                "num_mini_batches": 4,
            },
            "actor": body | {"distribution_cfg": histogram},
            "critic": dict(body),
            "multi_gpu": None,
        },
    )


@pytest.mark.parametrize("loss", ["hl-one-hot", "hl-gauss-centred"])
def test_rsl_rls_runner_learns_to_push(loss, tmp_path):
    torch.manual_seed(0)
    made = runner(loss)

    def distance():
        """Of the deterministic policy, in the end."""
        position = 2 * torch.rand(500, 2, generator=torch.Generator().manual_seed(1)) - 1
        for _ in range(15):
            seen = tensordict.TensorDict({"policy": position}, batch_size=[500])
            with torch.no_grad():
                position = (position + 0.2 * made.alg.actor(seen)).clamp(-1, 1)
        return position.norm(dim=-1).mean().item()

    before = distance()
    made.learn(40)
    assert before > 0.5
    assert distance() < 0.15
    exported = made.alg.actor.distribution.as_deterministic_output_module()
    logits = torch.randn(3, 2, 21)
    expected = made.alg.actor.distribution.deterministic_output(logits)
    torch.testing.assert_close(torch.jit.script(exported)(logits), expected)
    made.export_policy_to_jit(str(tmp_path), "policy.pt")
    seen = 2 * torch.rand(5, 2) - 1
    acted = made.alg.actor(tensordict.TensorDict({"policy": seen}, batch_size=[5]))
    torch.testing.assert_close(torch.jit.load(tmp_path / "policy.pt")(seen), acted)


def test_torchrls_losses_take_it():
    from tensordict.nn import TensorDictModule
    from torchrl.modules import ProbabilisticActor, ValueOperator
    from torchrl.objectives import A2CLoss, ClipPPOLoss

    layer = initialize_(nn.Linear(3, 22), 11)
    body = TensorDictModule(nn.Sequential(layer, nn.Unflatten(-1, (2, 11))), ["observation"], ["logits"])
    words = {"low": -1.0, "high": 2.0, "loss": "hl-gauss-centred", "eta": 1.0}
    actor = ProbabilisticActor(
        body, in_keys=["logits"], distribution_class=Histogram, distribution_kwargs=words, return_log_prob=True
    )
    critic = ValueOperator(nn.Linear(3, 1), in_keys=["observation"])
    data = actor(tensordict.TensorDict({"observation": torch.randn(50, 3)}, [50])).detach()
    advantage = torch.randn(50, 1)
    data = data.update({"advantage": advantage, "value_target": torch.zeros(50, 1)})
    own = Histogram(layer(data["observation"]).unflatten(-1, (2, 11)), **words)
    expected = torch.autograd.grad((advantage[:, 0] * own.loss(data["action"])).mean(), layer.weight)[0]
    for kind in (ClipPPOLoss, A2CLoss):
        objective = kind(actor, critic, entropy_bonus=False)
        gradient = torch.autograd.grad(
            objective(data)["loss_objective"], list(objective.actor_network_params.values(True, True))
        )
        found = next(g for g in gradient if g.shape == expected.shape)
        torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-6)


def test_skrls_model_acts_and_tells_what_its_ppo_reads():
    from gymnasium.spaces import Box
    from skrl.models.torch import Model

    from galton.torch.skrl import HistogramMixin

    class Policy(HistogramMixin, Model):
        def __init__(self, observation_space, action_space, device):
            Model.__init__(self, observation_space=observation_space, action_space=action_space, device=device)
            HistogramMixin.__init__(self, n_bins=11, low=action_space.low, high=action_space.high)
            self.net = initialize_(nn.Linear(3, 22), 11)

        def compute(self, inputs, role):
            return self.net(inputs["observations"]), {}

    policy = Policy(Box(-1, 1, (3,)), Box(np.float32([-1, 0]), np.float32([1, 2])), "cpu")
    inputs = {"observations": torch.randn(5, 3)}
    actions, outputs = policy.act(inputs, role="policy")
    assert actions.shape == (5, 2)
    assert outputs["log_prob"].shape == policy.get_entropy(role="policy").shape == (5, 1)
    again = policy.act(inputs | {"taken_actions": actions}, role="policy")[1]["log_prob"]
    torch.testing.assert_close(again, outputs["log_prob"])
    assert policy.distribution(role="policy").stddev.shape == (5, 2)


def test_an_infinite_box_is_refused_by_skrls_model_when_it_is_made():
    from galton.torch.skrl import HistogramMixin

    with pytest.raises(galton.UsageError, match="bins need finite bounds"):
        HistogramMixin(low=-np.inf)
