"""Users hold these: A2C, PPO, TRPO and VMPO, each one run on one environment, with Stable-Baselines3's habits."""

from typing import Any

from galton.algorithms import ALGORITHMS
from galton.losses import Loss
from galton.models.file import InexactResume
from galton.models.model import Model
from galton.models.settings import signature

__all__ = ["A2C", "PPO", "TRPO", "VMPO", "InexactResume", "Model"]


class A2C(Model):
    """Advantage actor-critic with SB3's semantics, but for Adam in the place of RMSprop.

    Where no loss is named it trains the preset "classification": centred HL-Gauss over 25 bins, with the settings that
    benchmarks/winner-a2c.toml selected for it. Where a loss is named, or with the preset "paper", the settings are
    those of the paper's appendix C.2, such as 20 steps an update.

    Keyword arguments are the settings of the agent's parts, as `galton.make_agent` takes them; see `Model` for the
    others.
    """

    def __init__(self, env: object, loss: str | Loss | None = None, **settings: Any) -> None:
        super().__init__(env, loss, algorithm="a2c", **settings)


class PPO(Model):
    """Proximal policy optimisation for every loss (see `galton.algorithms.ppo`), with SB3's semantics.

    Where no loss is named it trains the preset "gaussian": a Gaussian in units of the action box with eight
    environments, normalised observations and rewards, and a learning rate that falls to 0 while `learn` lasts. With
    preset="classification" it trains centred HL-Gauss over 50 bins, with the settings that
    benchmarks/winner-mujoco.toml selected for it. Where a loss is named, or with the preset "paper", the numbers are
    SB3's too.

    Keyword arguments are the settings of the agent's parts, as `galton.make_agent` takes them; see `Model` for the
    others.
    """

    def __init__(self, env: object, loss: str | Loss | None = None, **settings: Any) -> None:
        super().__init__(env, loss, algorithm="ppo", **settings)


class TRPO(Model):
    """Trust region policy optimisation for every loss (see `galton.algorithms.trpo`), with sb3-contrib's semantics.

    Where no loss is named it trains the preset "gaussian": a Gaussian in units of the action box with eight
    environments, normalised observations and rewards. Where a loss is named, or with the preset "paper", the numbers
    are sb3-contrib's.

    Keyword arguments are the settings of the agent's parts, as `galton.make_agent` takes them; see `Model` for the
    others.
    """

    def __init__(self, env: object, loss: str | Loss | None = None, **settings: Any) -> None:
        super().__init__(env, loss, algorithm="trpo", **settings)


class VMPO(Model):
    """On-policy maximum a posteriori policy optimisation for every loss (see `galton.algorithms.vmpo`).

    Where no loss is named it trains the preset "gaussian", as PPO does.

    Keyword arguments are the settings of the agent's parts, as `galton.make_agent` takes them; see `Model` for the
    others.
    """

    def __init__(self, env: object, loss: str | Loss | None = None, **settings: Any) -> None:
        super().__init__(env, loss, algorithm="v-mpo", **settings)


for _model, _algorithm in {A2C: "a2c", PPO: "ppo", TRPO: "trpo", VMPO: "v-mpo"}.items():
    setattr(_model, "__signature__", signature(ALGORITHMS[_algorithm]))  # noqa: B010
