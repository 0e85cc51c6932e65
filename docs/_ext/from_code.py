"""Directives that make tables from the code and the results, so that the pages can't fall behind them.

`{parameters}` lists an algorithm's settings, or those that are named; `{registry}` lists losses, policies, algorithms
or environments; `{paper-returns}` has the final training returns of some losses, and `{winners}` their best settings.
"""

import functools
import inspect
import types
import typing
from collections.abc import Iterable
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective

from galton.algorithms import ALGORITHMS, Algorithm, Rollout
from galton.critics import CRITICS
from galton.envs.registry import ENVS, make
from galton.fields import AtLeast
from galton.losses import LOSSES
from galton.models.settings import usual
from galton.networks import NETWORKS
from galton.optimizers import OPTIMIZERS, Optimizer
from galton.parts import Part, settings
from galton.policies import POLICIES
from galton.words import CHOICES, vocabulary
from studies.paper import report, reproduce, standings
from studies.paper.trained import Trained

RESULTS = Path(__file__).parents[2] / "results" / "paper"
Rows = list[list[str]]


def described() -> dict[str, str]:
    """What each setting says of itself, where it first stands, and each word that chooses a part."""
    kinds = [Rollout, *(kind for choice in CHOICES.values() for kind in choice.registry.values())]
    found = {choice.word: choice.meaning for choice in CHOICES.values()}
    for owner in (owner for kind in kinds for owner in reversed(kind.__mro__) if issubclass(owner, Part)):
        for (record, name), lines in ModuleAnalyzer.for_module(owner.__module__).find_attr_docs().items():
            if record == owner.__name__:
                found.setdefault(name, " ".join(lines).strip())
    return found


def allowed(name: str) -> str:
    """What a setting may be, in words."""
    for choice in (choice for choice in CHOICES.values() if choice.word == name):
        return "True or False." if True in choice.registry else "A name, or a part itself."
    annotation = vocabulary().annotations[name]
    kind, details = typing.get_origin(annotation), typing.get_args(annotation)
    if kind is typing.Literal:
        return "One of " + ", ".join(f"`{word}`" for word in details) + "."
    if kind is tuple or (kind is types.UnionType and typing.get_origin(details[0]) is tuple):
        return "Whole numbers from 1."
    if kind is typing.Annotated:
        bound = details[1]
        return f"A whole number from {bound.least}." if isinstance(bound, AtLeast) else f"A number: {bound.wanted}."
    return {bool: "True or False.", str: "A name."}[annotation]


def parameters(*names: str) -> Rows:
    """The settings of these names, or of the algorithm of that name, with their defaults."""
    values = vocabulary().usual
    if len(names) == 1 and names[0] in ALGORITHMS:
        values = {"loss": values["loss"], "n_envs": values["n_envs"]} | usual(ALGORITHMS[names[0]])
        names = tuple(values)
    texts = described()
    rows = [[f"`{name}`", f"`{values[name]}`", f"{texts[name]} *{allowed(name)}*"] for name in names]
    return [["parameter", "default", "what it is"], *rows]


def said(thing: object) -> str:
    """The first paragraph of a docstring, for a cell."""
    text = inspect.getdoc(thing) or ""
    return " ".join(text.split("\n\n")[0].split()).replace("|", "\\|")


def listed(names: Iterable[str]) -> str:
    """Names for a cell."""
    return ", ".join(f"`{name}`" for name in names) or "none"


def section(page: str, name: str, label: str) -> str:
    """A link to the section of a page that has a part's label as its heading."""
    return f"[`{name}`](/{page}.md#{label.partition(' (')[0].lower().replace(' ', '-')})"


def losses() -> Rows:
    """LOSSES, each with its section."""
    rows = [
        [section("losses", name, loss.label), loss.label, f"`{loss.policy}`", said(loss)]
        for name, loss in LOSSES.items()
    ]
    return [["loss", "in figures", "usual policy", "what it is"], *rows]


def policies() -> Rows:
    """POLICIES, each with its section, and with the losses that can train it."""
    rows = []
    for name, policy in POLICIES.items():
        fitting = [f"`{key}`" for key, loss in LOSSES.items() if loss.family in ("density", policy.family)]
        rows.append([section("policies", name, policy.label), policy.label, ", ".join(fitting), said(policy)])
    return [["policy", "in figures", "losses that fit it", "what it is"], *rows]


def critics() -> Rows:
    """CRITICS, each with its settings."""
    rows = [[f"`{name}`", critic.label, listed(settings(critic)), said(critic)] for name, critic in CRITICS.items()]
    return [["critic", "in figures", "settings of its own", "what it is"], *rows]


def networks() -> Rows:
    """NETWORKS, each with its settings."""
    rows = [[f"`{name}`", kind.label, listed(settings(kind)), said(kind)] for name, kind in NETWORKS.items()]
    return [["network", "in figures", "settings of its own", "what it is"], *rows]


def optimizers() -> Rows:
    """OPTIMIZERS, each with the settings that not every optimizer has."""
    shared = settings(Optimizer)
    rows = [
        [f"`{name}`", kind.label, listed(each for each in settings(kind) if each not in shared), said(kind)]
        for name, kind in OPTIMIZERS.items()
    ]
    return [["optimizer", "in figures", "settings of its own", "what it is"], *rows]


def algorithms() -> Rows:
    """ALGORITHMS, each with its page and the settings that not every algorithm has."""
    shared = settings(Algorithm)
    rows = [
        [f"[`{name}`](/{name}.md)", entry.label, listed(name for name in settings(entry) if name not in shared)]
        for name, entry in ALGORITHMS.items()
    ]
    return [["algorithm", "in figures", "settings of its own"], *rows]


def environments() -> Rows:
    """ENVS, with the sizes of actions and observations."""
    rows = []
    for name, entry in ENVS.items():
        env = make(name)
        low, high = env.action_low, env.action_high
        box = f"{len(low)} in [{low[0]:g}, {high[0]:g}]"
        rows.append(
            [f"`{name}`", f"`{entry.gymnasium_id}`", box, str(len(env.observation_low)), str(env.max_episode_steps)]
        )
    return [["environment", "Gymnasium id", "actions", "observations", "steps an episode"], *rows]


@functools.cache
def trained() -> Trained:
    """What `results/paper/data` holds."""
    return reproduce.load(str(RESULTS))


@functools.cache
def quoted() -> Rows:
    """The table of final training returns, as README quotes it."""
    table = report.tables(trained())["Final training return on fresh seeds"]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
    return [cells[0], *cells[2:]]


def paper_returns(*names: str) -> Rows:
    """The columns of these losses."""
    head = quoted()[0]
    columns = [0, 1, *(head.index(LOSSES[name].label) for name in names)]
    rows = [[row[i].replace(" ± ", "\u00a0±\u00a0") for i in columns] for row in quoted()]
    return [["task", *rows[0][1:]], *rows[1:]]


def winners(*names: str) -> Rows:
    """The best settings of these losses of App. C.2's grid."""
    labels = [LOSSES[name].label for name in names]
    rows = [row[:3] for row in standings.winners(trained()).rows if row[1] in labels]
    table = [["task", "loss", "best setting of its grid"], *rows]
    return [[row[0], row[2]] for row in table] if len(names) == 1 else table


class Table(SphinxDirective):
    """A table in Markdown, by a function of the directive's words."""

    has_content = False
    optional_arguments = 100

    def rows(self) -> Rows:
        """The cells, the head first."""
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        """Parse the table as if it stood on the page."""
        head, *rows = self.rows()
        lines = ["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)]
        box = nodes.Element()
        box.document = self.state.document
        self.state.nested_parse(StringList(lines, self.env.docname), 0, box)
        for table in box.findall(nodes.table):
            table["classes"].append(self.name)
        return box.children


class Parameters(Table):
    """`{parameters} NAME …`."""

    def rows(self) -> Rows:
        """Settings, with their defaults."""
        return parameters(*self.arguments)


class Registry(Table):
    """`{registry} losses`, and so on."""

    KNOWN: typing.ClassVar = {
        f.__name__: f for f in (losses, policies, critics, networks, optimizers, algorithms, environments)
    }

    def rows(self) -> Rows:
        """The entries of the registry."""
        return self.KNOWN[self.arguments[0]]()


class PaperReturns(Table):
    """`{paper-returns} LOSS …`."""

    def rows(self) -> Rows:
        """A row per task."""
        return paper_returns(*self.arguments)


class Winners(Table):
    """`{winners} LOSS …`."""

    def rows(self) -> Rows:
        """A row per task and loss."""
        return winners(*self.arguments)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("parameters", Parameters)
    app.add_directive("registry", Registry)
    app.add_directive("paper-returns", PaperReturns)
    app.add_directive("winners", Winners)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
