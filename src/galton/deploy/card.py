"""A model card: what somebody should know of a trained policy before they use it, as Markdown, from its run alone.

Its head is what the Hugging Face Hub reads. Which licence the policy has is not for Galton to say, so it names none.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from scipy import stats

from galton.agents import policy_name
from galton.decimals import fitting
from galton.models import Model
from galton.models.settings import unusual

STEP, MEAN, STD, TRAINING = "time/total_timesteps", "eval/mean_reward", "eval/std_reward", "rollout/ep_rew_mean"
ROWS = 10
"""Of the learning curve, at most."""
USE = """\
With Galton, which loads a model without running any code of its file:

```python
import galton

model = galton.Model.load(FILE)
action, _ = model.predict(observation, deterministic=True)
```

Without Galton, `policy.onnx` takes the same observations to the same actions. `galton export` writes it, and
`policy.json` beside it says all that a caller has to know."""
Point = Mapping[str, float]
"""The known numbers of one log point, by name."""
Table = Sequence[Sequence[str]]


def card(model: Model, settings: Mapping[str, Any], points: Sequence[Point], file: str = "model.safetensors") -> str:
    """The card of a saved model, from its run's config.json and log points; what is not there is left out.

    The file is the model's, by its name in the folder of the card.
    """
    env, algorithm = settings.get("env", model.env_name), model.agent.algorithm.label
    parts = [
        _head(str(env), ["continuous-control"] * bool(model.agent.box.numbers)),
        f"# {_name(env)}: {algorithm} with {model.settings['loss']}",
        f"A policy that Galton trained for {model.num_timesteps:,} steps of its environment.",
        "Its licence is not said here. Whoever publishes it chooses one and adds `license:` to the head of this file.",
        "## The task",
        _table(("", ""), _task(model, settings, env)),
        "## What it returns",
        *_returns(model, settings, points),
        "## How it learned",
        *_curve(points),
        "## How it was trained",
        *_training(model, settings),
        "## How to use it",
        USE.replace("FILE", json.dumps(file)),
        *_versions(settings),
    ]
    return "\n\n".join(parts) + "\n"


def _head(env: str, kinds: Sequence[str]) -> str:
    tags = "\n".join(f"- {json.dumps(tag)}" for tag in ("reinforcement-learning", *kinds, env))
    return f"---\nlibrary_name: galton\npipeline_tag: reinforcement-learning\ntags:\n{tags}\n---"


def _task(model: Model, settings: Mapping[str, Any], env: object) -> Table:
    space = model.action_space
    constants = settings.get("env_kwargs")
    return [
        ("Environment", _code(env)),
        *([("Its keyword arguments", _code(json.dumps(constants)))] if constants else []),
        ("Observation", _code(model.observation_space)),
        ("Action", _code(space)),
        ("Policy", _code(policy_name(model.agent))),
        ("Observations are normalised", "yes" if model.agent.rollout.normalize_observation else "no"),
    ]


def _returns(model: Model, settings: Mapping[str, Any], points: Sequence[Point]) -> list[str]:
    """The returns of the deterministic policy, with an interval where it played several episodes."""
    evaluated = [point for point in points if MEAN in point]
    if not evaluated:
        return ["The run was not evaluated, so what the policy returns without exploration is not known."]
    n = settings.get("eval_episodes")
    n = n if type(n) is int and 0 < n < 2**31 else 0  # more are no episodes
    best = max(evaluated, key=lambda point: point[MEAN])
    own = [point for point in evaluated if point[STEP] == model.num_timesteps][-1:]
    known = {"This policy": own[0]} if own else {"The last of its run": evaluated[-1]}
    known |= {f"The best of its run's {len(evaluated):,}": best}
    rows = [
        (name, f"{point[STEP]:,.0f}", str(n or "not known"), _number(point[MEAN]), _interval(point, n))
        for name, point in known.items()
    ]
    return [
        "Undiscounted returns of whole episodes without exploration, played while it was trained.",
        _table(("Evaluation", "Step", "Episodes", "Mean return", "95% interval"), rows),
        "The interval is Student's t over the episodes of one evaluation. It says nothing of other seeds: this is one "
        "run. The best of several evaluations is the luckiest too, so it promises too much.",
    ]


def _interval(point: Point, n: int) -> str:
    """The interval of the mean of n returns with this standard deviation, which was divided by n."""
    if n < 2 or STD not in point:
        return "not known"
    half = stats.t.ppf(0.975, n - 1) * point[STD] / math.sqrt(n - 1)
    form = fitting(point[MEAN], half)
    return f"{point[MEAN] - half:{form}} to {point[MEAN] + half:{form}}"


def _curve(points: Sequence[Point]) -> list[str]:
    if not points:
        return ["The run has no log points."]
    last = len(points) - 1
    chosen = sorted({round(i * last / (ROWS - 1)) for i in range(ROWS)})
    rows = [(f"{points[i][STEP]:,.0f}", *(_number(points[i].get(name)) for name in (TRAINING, MEAN))) for i in chosen]
    return [
        f"{len(rows)} of its {len(points):,} log points. The training return is of episodes with exploration.",
        _table(("Step", "Training return", "Evaluation return"), rows),
    ]


def _training(model: Model, settings: Mapping[str, Any]) -> list[str]:
    agent = model.agent
    rows = {"loss": model.settings["loss"], "seed": model.seed, "n_envs": agent.rollout.n_envs} | unusual(agent)
    command = settings.get("command")
    said = ["This command trained it:", f"```\n{_plain(command)}\n```"] if isinstance(command, str) else []
    told = f"Its loss and seed, and the settings that are not {agent.algorithm.label}'s defaults:"
    return [*said, told, _table(("Setting", "Value"), [(_code(name), _code(value)) for name, value in rows.items()])]


def _versions(settings: Mapping[str, Any]) -> list[str]:
    found = settings.get("versions")
    if not isinstance(found, dict):
        return []
    rows = [(_name(name), _code(version)) for name, version in found.items() if version is not None]
    return ["## Versions", _table(("", ""), rows)]


def _table(head: Sequence[str], rows: Table) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


def _number(value: float | None) -> str:
    return "not known" if value is None else f"{value:{fitting(value)}}"


def _plain(value: object) -> str:
    """A text in one line that ends no block of code and that a file can hold; files of strangers may hold any."""
    return " ".join(str(value).encode(errors="backslashreplace").decode().split()).replace("`", "'")


def _code(value: object) -> str:
    """A text as code, in which nothing is markup; a bar in it ends no cell of a table, behind a backslash neither."""
    text = _plain(value).replace("\\|", "\\ |").replace("|", "\\|")
    return f"`{text}`"


def _name(value: object) -> str:
    """A name such as Pendulum-v1 as it is; anything else as code, for Markdown might see HTML or a link in it."""
    text = _plain(value)
    return text if re.fullmatch(r"[A-Za-z0-9][\w/-]*", text, re.ASCII) else _code(text)
