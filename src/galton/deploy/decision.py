"""The whole decision of a policy as a graph: what `predict(deterministic=True)` does with observations."""

from typing import NamedTuple

import numpy as np
from gymnasium.spaces import Box
from jaxtyping import Float

from galton import normalization
from galton.agents import policy_name
from galton.deploy.actions import ACTIONS, Chosen
from galton.deploy.bodies import BODIES, linear
from galton.deploy.graph import Graph
from galton.envs.host.action_box import ActionBox
from galton.envs.host.observations import Observations
from galton.errors import require
from galton.models import Model
from galton.normalization import Normalizer
from galton.parts import at

OBSERVATION, ACTION = "observation", "action"
"""The names of the input and the output."""


class Decision(NamedTuple):
    """A policy's decision, from an observation to an action."""

    graph: Graph
    observation_shape: tuple[int, ...]
    """Of one observation: as the environment has it where it is a Box, else that of the flat vector."""
    action_shape: tuple[int, ...]
    """Of one action, as the environment has it."""
    low: Float[np.ndarray, "*shape"]
    """The lower bounds of the action in float32, none below those of the environment."""
    high: Float[np.ndarray, "*shape"]
    """The upper bounds of the action in float32, none above those of the environment."""
    chosen: Chosen


def decide(model: Model) -> Decision:
    """The decision of a model's policy as a graph; UsageError where ACTIONS lacks it, or BODIES its network."""
    name, kind = policy_name(model.agent), type(model.agent.network)
    nobody, remedy = "of which nobody has said how it is computed in ONNX; add a function to", "as docs/deploy.md shows"
    require(name in ACTIONS, f"policy is {name!r}, {nobody} galton.deploy.ACTIONS[{name!r}], {remedy}")
    told = f"network is a {kind.__name__}, {nobody} galton.deploy.BODIES[{kind.__name__}], {remedy}"
    require(kind in BODIES, told)
    graph, params, observations = Graph(), model.learner.params, model.observations
    shape = observation_shape(observations)
    rows = OBSERVATION if len(shape) == 1 else graph.add("Reshape", OBSERVATION, np.array([-1, observations.size]))
    inputs = _normalised(graph, rows, model.learner.normalizer)
    features = BODIES[kind](graph, model.agent.network, params["actor"], inputs)
    policy = at(model.agent.policy, model.num_timesteps)
    if "log_std" in params:
        policy = policy.replace(log_std_init=np.asarray(params["log_std"]))
    outputs = linear(
        graph, {name: policy.scaled(part) for name, part in params["actor"][-1].items()}, features, name="outputs"
    )
    chosen = ACTIONS[name](graph, outputs, policy)
    low, high = bounds(model.actions)
    shaped = graph.add("Reshape", chosen.action, np.array([0, *low.shape]))
    graph.add("Min", graph.add("Max", shaped, low), high, name=ACTION)
    return Decision(graph, shape, low.shape, low, high, chosen)


def observation_shape(observations: Observations) -> tuple[int, ...]:
    """The shape of one observation in the file: a Box's own, else that of the flat vector."""
    space = observations.space
    return space.shape if isinstance(space, Box) else (observations.size,)


def bounds(actions: ActionBox) -> tuple[Float[np.ndarray, "*shape"], Float[np.ndarray, "*shape"]]:
    """The box of actions in float32, rounded inwards where the environment's has more digits."""
    low, high = (bound.astype(np.float32) for bound in (actions.space.low, actions.space.high))
    low = np.where(low < actions.space.low, np.nextafter(low, np.float32(np.inf)), low)
    high = np.where(high > actions.space.high, np.nextafter(high, np.float32(-np.inf)), high)
    return low, high


def _normalised(graph: Graph, rows: str, normalizer: Normalizer) -> str:
    if not normalizer.observation:
        return rows
    from_origin = graph.add("Sub", rows, np.asarray(normalizer.origin))
    centered = graph.add("Sub", from_origin, np.asarray(normalizer.observation.mean))
    scaled = graph.add("Div", centered, np.asarray(normalization.deviation(normalizer)))
    clip = normalization.CLIP
    return graph.add("Clip", scaled, -clip, clip, name="normalised_observation")
