"""The command line calls each argument by the option that fills it."""

import contextlib
import dataclasses
import importlib
import re
from collections.abc import Iterator, Sequence
from types import ModuleType
from typing import Annotated, NamedTuple, get_args, get_origin, get_type_hints

from galton.cli._interrupts import leaving_at_once
from galton.errors import UsageError
from galton.extras import MissingExtraError

ABOUT = r"(?= (?:is|are|has|holds|names|goes|needs)\b)"
"""The verb that follows the name of an argument where a message begins with it."""

ELSEWHERE = ("loss", "algorithm")
"""The words that each command has as options of its own."""


class Fills(NamedTuple):
    """In the annotation of an option: what the functions that it is for call it, where that is another name."""

    argument: str


def options_of(record: type) -> dict[str, str]:
    """The option that fills each argument: all fields of a record of options and of the records in it, as typed.

    What has a place instead of a name keeps its plain word, or has that of the help where it is another one (DIR); so
    does nothing that an outer record has already named.
    """
    from tyro.conf import Positional  # `galton --help` needn't load it

    placed = get_args(Positional[int])[1:]
    known: dict[str, str] = {}
    inner: dict[str, str] = {}
    for name, hint in get_type_hints(record, include_extras=True).items():
        kind, *marks = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            inner |= options_of(kind)
            continue
        if get_origin(kind) is dict:  # of settings by name, each of which is an option
            from galton.words import vocabulary

            inner |= {word: "--" + word.replace("_", "-") for word in vocabulary().usual if word not in ELSEWHERE}
            continue
        typed = _placed(name, marks) if any(mark in placed for mark in marks) else "--" + name.replace("_", "-")
        arguments = [mark.argument for mark in marks if isinstance(mark, Fills)]
        known |= dict.fromkeys([name, *arguments], typed)
    return inner | known


def _placed(name: str, marks: Sequence[object]) -> str:
    """The word that help has for an argument with a place, unless it is its name in capitals or no plain word."""
    shown = [str(word) for mark in marks if (word := getattr(mark, "metavar", None))]
    return next((word for word in shown if word.isalpha() and word != name.upper()), name)


def resaid(message: str, record: type) -> str:
    """A message about arguments in the words of the command line.

    The argument that it begins with becomes its option, and so do others that no plain word could be. What follows a
    colon was said of something else, such as a file, and stays.
    """
    options = options_of(record)
    subject, colon, rest = message.partition(": ")
    names = "|".join(map(re.escape, options))
    compound = "|".join(name for name in map(re.escape, options) if "_" in name)
    subject = re.sub(rf"^(?:{names}){ABOUT}", lambda found: options[found[0]], subject)
    if compound:
        alone = rf"(?<![\w./'\"\[=-])(?:{compound})(?![\w/'\"\](=-]|\.\w)"
        subject = re.sub(alone, lambda found: options[found[0]], subject)
    return subject + colon + rest


@contextlib.contextmanager
def in_its_words(record: type | None) -> Iterator[None]:
    """Say what goes wrong inside in the words of these options; None where there are none."""
    try:
        yield
    except UsageError as error:
        if record is not None:
            error.args = (resaid(str(error), record),)
        raise


def run_command(module: str, arguments: Sequence[str]) -> None:
    """Run the command in that module: its `main`, whose errors are said in the words of its `Options`."""
    with leaving_at_once("interrupted; nothing was written"):
        command = _imported(module)
    with in_its_words(vars(command).get("Options")):
        command.main(arguments)


def _imported(module: str) -> ModuleType:
    """The module of a command; an extra that one of its modules lacks is one that the command lacks."""
    try:
        return importlib.import_module(module)
    except MissingExtraError as error:
        name = " ".join(module.removesuffix(".run").split(".")[2:])
        _, rest = str(error).split(" needs ", 1)
        raise MissingExtraError(f"{name} needs {rest}") from None
