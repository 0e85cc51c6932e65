"""Schedules: numbers that change with the environment steps of a run, in the place of any that stays.

Each has a word too, for command lines and files: `linear(3e-4, 0, 1e6)` is `Linear(3e-4, 0, 1e6)`.
"""

import ast
import dataclasses
from typing import Annotated, Any, ClassVar, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from galton.errors import UsageError, require
from galton.fields import Within
from galton.parts import Schedule as Schedule
from galton.types import Finite, NotNegative, Number

TreeT = TypeVar("TreeT")
Number_ = Annotated[Number, Within(lambda x: ~np.isnan(x), "a number")]
Steps = Annotated[Number, Within(lambda x: x > 0, "greater than 0, or inf for all steps that are trained")]


class Between(Schedule):
    """A schedule from one number to another, which then stays."""

    fixed: ClassVar[tuple[str, ...]] = ("start", "end", "steps", "begin")

    start: Finite = 0.0
    """The number at the first step."""
    end: Finite = 0.0
    """The number in the end."""
    steps: Steps = float("inf")
    """Environment steps from start to end; inf: all that are trained, which `learn` and `train` know."""
    begin: NotNegative = 0.0
    """The environment step where it begins."""

    def values(self) -> tuple[Any, ...]:
        """Both numbers, between which all others lie."""
        return self.start, self.end

    def done(self, step: Float[Array, "*runs"] | float) -> Float[Array, "*runs"]:
        """The share of the way that is behind at this step."""
        return jnp.clip((step - jnp.asarray(self.begin)) / self.steps, 0.0, 1.0)

    @property
    def is_endless(self) -> bool:
        """True if it goes over all that is trained."""
        return bool(np.any(np.isinf(self.steps)))

    def over(self, begin: int, end: float) -> "Between":
        """The schedule that goes from one step to another if it goes over all that is trained."""
        whole, own = np.isinf(self.steps), np.asarray(self.begin, np.float32)
        first = np.where(whole, np.maximum(own, np.float32(begin)), own)
        steps = np.where(whole, np.maximum(np.float32(end) - first, 1), np.asarray(self.steps, np.float32))
        return self.replace(begin=first, steps=steps)


class Linear(Between):
    """A number that goes from start to end linearly."""

    label = "linear"

    def __call__(self, step: Float[Array, "*runs"] | float) -> Float[Array, "*runs"]:
        """The number at this step."""
        done, end = self.done(step), jnp.asarray(self.end)
        return jnp.where(done < 1, self.start + (end - self.start) * done, end)


class Cosine(Between):
    """A number that goes from start to end along half a cosine (Loshchilov & Hutter, 2017)."""

    label = "cosine"

    def __call__(self, step: Float[Array, "*runs"] | float) -> Float[Array, "*runs"]:
        """The number at this step."""
        done, start = self.done(step), jnp.asarray(self.start)
        return jnp.where(done > 0, self.end + (start - self.end) * (1 + jnp.cos(jnp.pi * done)) / 2, start)


class Step(Schedule):
    """A number that is one up to a step, and another from there on; both may be schedules of their own.

    An update has the number of the step after its rollout.
    """

    label = "step"
    fixed: ClassVar[tuple[str, ...]] = ("at_step",)

    before: Number_ = 0.0
    """The number before that step."""
    after: Number_ = 0.0
    """The number from that step on."""
    at_step: NotNegative = 0.0
    """The environment step from which the number is the second one."""

    def values(self) -> tuple[Any, ...]:
        """Both numbers, or those of both schedules."""
        return tuple(
            value
            for each in (self.before, self.after)
            for value in (each.values() if isinstance(each, Schedule) else [each])
        )

    def __call__(self, step: Float[Array, "*runs"] | float) -> Float[Array, "*runs"]:
        """The number at this step."""
        before, after = (
            each(step) if isinstance(each, Schedule) else jnp.asarray(each) for each in (self.before, self.after)
        )
        return jnp.where(step < self.at_step, before, after)

    @property
    def is_endless(self) -> bool:
        """True if one of its schedules goes over all that is trained."""
        return any(each.is_endless for each in (self.before, self.after) if isinstance(each, Schedule))

    def over(self, begin: int, end: float) -> "Step":
        """The same of schedules that go over all that is trained."""
        return self.replace(before=over(self.before, begin, end), after=over(self.after, begin, end))


LONGEST = 10_000
"""Characters of a text at most."""
SCHEDULES: dict[str, type[Schedule]] = {"linear": Linear, "cosine": Cosine, "step": Step}


def over(tree: TreeT, begin: int, end: float) -> TreeT:
    """A part, or a number, whose schedules that go over all that is trained go from one step to another."""

    def spanned(leaf: Any) -> Any:
        return leaf.over(begin, end) if isinstance(leaf, Schedule) else leaf

    spread: TreeT = jax.tree.map(spanned, tree, is_leaf=lambda leaf: isinstance(leaf, Schedule))
    return spread


def read(name: str, text: str) -> Schedule:
    """The schedule that a text describes, as `told` writes it: its numbers in order, without names.

    Raises:
        UsageError: it describes none.
    """
    try:
        made = _made(ast.parse(text[:LONGEST].strip(), mode="eval").body)
    except UsageError as error:
        raise UsageError(f"{name} is {text!r}, whose {error}") from None
    except (SyntaxError, ValueError, TypeError, KeyError, RecursionError, MemoryError):
        made = None
    if not isinstance(made, Schedule):
        raise UsageError(f"{name} is {text!r}; it must be a number, or a schedule such as linear(3e-4, 0, 1e6)")
    return made


def _made(node: ast.expr) -> Any:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_made(node.operand)
    if not isinstance(node, ast.Call):
        return ast.literal_eval(node) if not isinstance(node, ast.Name) else {"inf": float("inf")}[node.id]
    if not isinstance(node.func, ast.Name) or node.keywords:
        raise SyntaxError
    kinds = {key.replace("-", "_"): kind for key, kind in SCHEDULES.items()}
    return kinds[node.func.id](*map(_made, node.args))


def told(schedule: Schedule) -> str:
    """The text of a schedule, which `read` understands; UsageError for one that has no name."""
    shown = [_told(getattr(schedule, field.name)) for field in dataclasses.fields(schedule)]
    names = [name for name, kind in SCHEDULES.items() if kind is type(schedule)]
    if not names:
        raise UsageError(f"a schedule is {schedule!r}, and files hold names; give its class a line in SCHEDULES")
    return f"{names[0].replace('-', '_')}({', '.join(shown)})"


def _told(value: Any) -> str:
    if isinstance(value, Schedule):
        return told(value)
    return repr(value if isinstance(value, bool | int | str) else float(value))


def of_remaining(name: str, value: Any) -> Any:
    """The schedule of one of SB3's, a function of what remains of training, 1 to 0; anything else as it is.

    Raises:
        UsageError: the function is not linear.
    """
    if not callable(value) or isinstance(value, Schedule):
        return value
    try:
        start, end = float(value(1.0)), float(value(0.0))
        linear = all(np.isclose(value(left), end + left * (start - end)) for left in np.linspace(0.05, 0.95, 19))
    except (TypeError, ValueError):
        linear = False
    require(
        linear,
        f"{name} is {value!r}; it must be a number or a schedule. A function of what remains of training is understood "
        "if it is linear; write another as galton.schedules.Cosine or Step, of environment steps",
    )
    return Linear(start, end) if start != end else start
