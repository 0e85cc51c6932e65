"""A command line becomes a record of options, or one sentence that says why it can't; its modules are imported.

The current folder is searched for what the command line names, and for nothing else: what a file names, such as the
plan of a sweep, may be a stranger's. Such a module must be installed, lie on PYTHONPATH, or be typed as well.
"""

import contextlib
import io
import re
import sys
from collections.abc import Collection, Sequence
from typing import Annotated, TypeVar

import tyro

from galton.cli._registry import REGISTRY, showing
from galton.cli._words import options_of
from galton.errors import UsageError, did_you_mean
from galton.extras import import_all

OptionsT = TypeVar("OptionsT")

Imports = Annotated[
    tuple[str, ...],
    tyro.conf.arg(help="Modules to import first, where losses, policies and other parts of your own are registered."),
]
"""The option of the commands that need what a user has registered."""


def search_here() -> None:
    """Have this process and its workers search the current folder, behind all that is installed."""
    if "" not in sys.path:
        sys.path.append("")


def import_typed(modules: Sequence[str]) -> None:
    """Import modules that the command line names; UsageError for one that can't be."""
    if modules:
        search_here()
        import_all(modules)


def read_options(
    options: type[OptionsT],
    name: str,
    arguments: Sequence[str],
    default: OptionsT | None = None,
    common: Collection[str] = (),
) -> OptionsT:
    """A command's options from its arguments; UsageError in one sentence. Help is printed and ends the process.

    `--help` shows the `common` options if there are some, and `--help-all` shows all.
    """
    said = io.StringIO()
    words = ["--help" if word == "--help-all" else word for word in arguments]
    few = common if words == [*arguments] and {"-h", "--help"} & {*words} else ()
    help_ = f"`galton {name} {'--help-all' if common else '--help'}` lists the options"
    try:
        with contextlib.redirect_stderr(said), showing(few):
            found, unknown = tyro.cli(
                options,
                prog=f"galton {name}",
                args=words,
                default=default,
                config=(tyro.conf.OmitArgPrefixes,),
                return_unknown_args=True,
                registry=REGISTRY,
            )
    except SystemExit as exit_:
        if not exit_.code:
            if few:
                print(f"galton {name} --help-all lists all options.")
            raise
        cause = exit_.__context__
        while cause and not isinstance(cause, UsageError):
            cause = cause.__context__
        odd = [word for word in arguments if word.startswith("--") and not _is_known(word, options)]
        told = _stray(odd[0], options, name, help_) if odd else f"{_in_a_line(said.getvalue())}; {help_}"
        raise cause or UsageError(told) from None
    sys.stderr.write(said.getvalue())
    if unknown:
        raise UsageError(_stray(unknown[0], options, name, help_))
    assert found is not None
    return found


def _is_known(word: str, options: type) -> bool:
    """True if a word is an option, or the opposite of one."""
    typed = word.partition("=")[0].replace("_", "-")
    known = {*options_of(options).values(), "--help", "--help-all", "--"}
    return not known.isdisjoint({typed, typed.replace("--no-", "--", 1)})


def _stray(word: str, options: type, name: str, help_: str) -> str:
    """The message about a word that is no option and has no place."""
    if word.lower() in ("true", "false", "0", "1", "yes", "no"):
        return f"{word!r} is one argument too many; a switch stands alone, as --resume or --no-resume; {help_}"
    if not word.startswith("-"):
        return f"{word!r} is one argument too many; {help_}"
    typed, known = word.partition("=")[0], options_of(options)
    exact = known.get(typed.strip("-").replace("-", "_"), "")  # what functions call it
    if exact and not exact.startswith("--"):
        return f"{typed} is no option of `galton {name}`; its value has a place of its own, without a name; {help_}"
    meant = f"; did you mean {exact}?" if exact else did_you_mean(typed, known.values())
    return f"{typed} is no option of `galton {name}`{meant or f'; {help_}'}"


def _in_a_line(box: str) -> str:
    """The first part of a box that tyro drew, where it says what is wrong."""
    first = re.split(r"─{3,}", re.sub(r"\A.*\n", "", box))[0]
    told = " ".join(word for word in first.split() if word not in ("│", "(required)"))
    return told.removeprefix("Error parsing ").rstrip(".")
