"""The whole decision of a policy as a graph: what `predict(deterministic=True)` does with observations."""

from typing import NamedTuple

import numpy as np
from gymnasium.spaces import Box
from jaxtyping import Float

from galton import normalization, parts
from galton.agents import policy_name
from galton.deploy.actions import ACTIONS, Chosen, mixed
from galton.deploy.bodies import BODIES, linear
from galton.deploy.graph import Graph
from galton.envs.host.actions import Actions, entries, leaves
from galton.errors import require
from galton.models import Model
from galton.normalization import Normalizer
from galton.parts import at
from galton.policies import HistogramPolicy, Policy
from galton.policies.histogram import NOWHERE
from galton.policies.mixed import MixedPolicy

OBSERVATION, MASK, ACTION = "observation", "action_mask", "action"
"""The names of the inputs and the output."""


class Decision(NamedTuple):
    """A policy's decision, from an observation to an action."""

    graph: Graph
    observation_shape: tuple[int, ...]
    """Of one observation: as the environment has it where it is a Box, else that of the flat vector."""
    low: Float[np.ndarray, "*shape"]
    """The lower bounds of the action in float32, none below those of the environment; of its shape where that is a Box,
    else flat."""
    high: Float[np.ndarray, "*shape"]
    """The upper bounds of the action in float32, none above those of the environment."""
    chosen: Chosen
    n_mask: int = 0
    """The entries of the mask that comes with an observation; 0: none does."""


def decide(model: Model) -> Decision:
    """The decision of a model's policy as a graph; UsageError where ACTIONS lacks it, or BODIES its network."""
    name, kind = policy_name(model.agent), type(model.agent.network)
    nobody, remedy = "of which nobody has said how it is computed in ONNX; add a function to", "as docs/deploy.md shows"
    require(name in ACTIONS, f"policy is {name!r}, {nobody} galton.deploy.ACTIONS[{name!r}], {remedy}")
    told = f"network is a {kind.__name__}, {nobody} galton.deploy.BODIES[{kind.__name__}], {remedy}"
    require(kind in BODIES, told)
    params, observations = model.learner.params, model.observations
    graph = Graph(params)
    space, n_mask = observations.space, observations.n_mask
    flat = np.array([-1, observations.size - n_mask])
    shape = space.shape if isinstance(space, Box) else (int(flat[1]),)
    rows = OBSERVATION if len(shape) == 1 else graph.add("Reshape", OBSERVATION, flat)
    inputs = _normalised(graph, rows, model.learner.normalizer)
    features = BODIES[kind](graph, model.agent.network, params["actor"], inputs)
    policy = at(model.agent.policy, model.num_timesteps)
    if "log_std" in params and hasattr(policy.head, "log_std_init"):
        learnt = policy.head.replace(log_std_init=np.asarray(params["log_std"]))
        policy = policy.replace(numbers=learnt) if isinstance(policy, MixedPolicy) else learnt
    outputs = linear(
        graph, {name: policy.scaled(part) for name, part in params["actor"][-1].items()}, features, name="outputs"
    )
    if n_mask:
        outputs = _masked(graph, outputs, policy, model.agent.box)
    if isinstance(policy, MixedPolicy):
        chosen = mixed(graph, outputs, policy, ACTIONS[name])
    else:
        chosen = ACTIONS[name](graph, outputs, policy)
    low, high = bounds(model.actions)
    shaped = graph.add("Reshape", chosen.action, np.array([0, *low.shape]))
    graph.add("Min", graph.add("Max", shaped, low), high, name=ACTION)
    return Decision(graph, shape, low, high, chosen, n_mask)


def bounds(actions: Actions) -> tuple[Float[np.ndarray, "*shape"], Float[np.ndarray, "*shape"]]:
    """The box of actions in float32, rounded inwards where the environment's has more digits; of a choice its indices.

    It has the shape of a Box; that of other spaces is flat.
    """
    found = [_bounds(leaf) if isinstance(leaf, Box) else entries(leaf)[:2] for _, leaf in leaves(actions.space)]
    if isinstance(actions.space, Box):
        return found[0]
    low, high = (np.concatenate([np.ravel(bound) for bound in side]) for side in zip(*found, strict=True))
    return low, high


def _bounds(space: Box) -> tuple[np.ndarray, np.ndarray]:
    low, high = (bound.astype(np.float32) for bound in (space.low, space.high))
    low = np.where(low < space.low, np.nextafter(low, np.float32(np.inf)), low)
    high = np.where(high > space.high, np.nextafter(high, np.float32(-np.inf)), high)
    return low, np.maximum(low, high)  # bounds that are one number between two of float32's cross


def _masked(graph: Graph, outputs: str, policy: Policy, box: parts.Box) -> str:
    """The outputs, far below 0 for values that the mask forbids."""
    forbidden = graph.add("Mul", graph.add("Sub", MASK, 1.0), -NOWHERE)
    assert isinstance(policy, HistogramPolicy | MixedPolicy)
    sizes = (0, *policy.of_choices.sizes) if isinstance(policy, MixedPolicy) else box.mask_sizes
    if sum(sizes) == policy.n_outputs:
        return graph.add("Add", outputs, forbidden)
    free, places, start = list[bool](), list[int](), 0  # outputs that no mask is for; others' places in the mask
    for size, width in zip(sizes, policy.sizes, strict=True):
        places += range(start, start + size) if size else [0] * width
        free += [size == 0] * width
        start += size
    spread = graph.add("Mul", graph.add("Gather", forbidden, np.array(places), axis=1), 1.0 - np.array(free))
    return graph.add("Add", outputs, spread)


def _normalised(graph: Graph, rows: str, normalizer: Normalizer) -> str:
    if not normalizer.observation:
        return rows
    from_origin = graph.add("Sub", rows, np.asarray(normalizer.origin))
    centered = graph.add("Sub", from_origin, np.asarray(normalizer.observation.mean))
    scaled = graph.add("Div", centered, np.asarray(normalization.deviation(normalizer)))
    clip = normalization.CLIP
    return graph.add("Clip", scaled, -clip, clip, name="normalised_observation")
