"""Robots whose actuators or ground change while an agent learns, in MuJoCo, for `gymnasium.make`.

Their clock, the steps that a copy has taken since it was made, is neither observed nor set back by the end of an
episode. It is a part of the state that is saved, and evaluation begins where training is. In every second period a
robot is another one: `change` says how.
"""

from typing import Any, Literal, get_args

import gymnasium
import numpy as np
from jaxtyping import Float

from galton.errors import require_integer, require_word
from galton.extras import needed

with needed("a robot whose gears change", "mujoco", "imageio"):  # which Gymnasium imports with it
    import mujoco

Change = Literal["reversal", "leg", "friction", "cosine"]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_LEGS = {"HalfCheetah-v5": (0, 1, 2), "Ant-v5": (2, 3)}
"""The actuators of HalfCheetah's hind leg and of Ant's left front leg."""


class Gears(gymnasium.Env[np.ndarray, np.ndarray]):
    """Gymnasium's HalfCheetah-v5 or Ant-v5 with gears that are × −1 in every second period, or another change.

    Args:
        robot: the id of Gymnasium's environment.
        change: every gear × −1 (`reversal`), those of one leg × 0 (`leg`) or all friction × 0.3 (`friction`), in every
            second period; or every gear × cos(2π t / period) (`cosine`).
        period: steps of a copy from one change to the next, or of one wave.
        render_mode: Gymnasium's.
        kwargs: the keyword arguments of Gymnasium's environment.

    Raises:
        UsageError: a change or a period that there is not, or MuJoCo is not installed.
    """

    metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"], "render_fps": 20}  # noqa: RUF012

    def __init__(
        self,
        robot: Literal["HalfCheetah-v5", "Ant-v5"],
        change: Change = "reversal",
        period: int = 100_000,
        render_mode: str | None = None,
        **kwargs: Any,
    ) -> None:
        require_word("robot", robot, _LEGS)
        require_word("change", change, get_args(Change))
        require_integer("period", period, 1)
        made: Any = gymnasium.make(robot, render_mode=render_mode, **kwargs)
        self.robot = made.unwrapped
        """Gymnasium's environment, whose model changes."""
        self.observation_space, self.action_space = self.robot.observation_space, self.robot.action_space
        self.render_mode, self.change, self.period = render_mode, change, period
        model = self.robot.model
        self._usual, self._leg = (model.actuator_gear.copy(), model.geom_friction.copy()), list(_LEGS[robot])
        self.t = self._begin = 0

    def factors(self, t: int) -> tuple[Float[np.ndarray, " u"], float]:
        """The factors of the gears, one for each actuator, and that of friction, in the step after t others."""
        gears = np.ones(self.robot.model.nu)
        if self.change == "cosine":
            return gears * np.cos(2 * np.pi * (t % self.period) / self.period), 1.0
        is_changed = t // self.period % 2 == 1
        if is_changed and self.change == "reversal":
            gears *= -1
        elif is_changed and self.change == "leg":
            gears[self._leg] = 0
        return gears, 0.3 if is_changed and self.change == "friction" else 1.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; with a seed alone the clock begins anew."""
        super().reset(seed=seed)
        self.robot.np_random = self.np_random
        if seed is not None:
            self.t, self._begin = self._begin, 0
        self._turn()
        observation, info = self.robot.reset(options=options)
        return observation, info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one step of the robot's, and let the clock go on."""
        observation, reward, terminated, truncated, info = self.robot.step(action)
        self.t += 1
        self._turn()
        return observation, float(reward), bool(terminated), truncated, info

    def go_on_from(self, trained: "Gears") -> None:
        """Let the next reset with a seed begin where another copy's clock is."""
        self._begin = trained.t

    def get_state(self) -> dict[str, np.ndarray]:
        """The clock, and the state of the simulation; bodies' places are those of the last substep's beginning."""
        model, data = self.robot.model, self.robot.data
        physics = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, physics, _STATE)
        return {"t": np.array(self.t), "physics": physics, "xpos": data.xpos.copy()}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on from what `get_state` told."""
        self.t = int(state["t"])
        self._turn()
        mujoco.mj_setState(self.robot.model, self.robot.data, np.asarray(state["physics"], np.float64), _STATE)
        self.robot.data.xpos[:] = state["xpos"]

    def render(self) -> Any:
        """Show the robot as Gymnasium's environment does."""
        return self.robot.render()

    def close(self) -> None:
        """Close the environment of Gymnasium's inside."""
        self.robot.close()

    def _turn(self) -> None:
        """Give the model what it has at this step."""
        (usual, friction), (gears, slippery) = self._usual, self.factors(self.t)
        self.robot.model.actuator_gear[:] = usual * gears[:, None]
        self.robot.model.geom_friction[:] = friction * slippery
