"""The galton command. Each of COMMANDS is a module beside this one, loaded when it is called for."""

import importlib
import signal
import sys

from galton.cli._words import run_command
from galton.errors import BrokenEnvironmentError, CheckpointError, UsageError, unknown

COMMANDS = {
    "train": "train one policy and keep it in a run folder",
    "compare": "train several losses over many seeds and say which is best",
    "sweep": "train a grid of settings on every core or on a cluster",
    "watch": "film a policy that was trained",
    "reproduce": "train and draw the figures of the paper",
    "report": "write the page of what was reproduced",
}

RESUMABLE = ("sweep", "reproduce", "report")
"""The commands whose work is kept as it is done."""

EXIT_CODES = {BrokenEnvironmentError: 1, CheckpointError: 2, UsageError: 2}
"""What the command ends with, by whose fault it was: an environment's, or that of an argument or a file."""

HELP = f"""\
usage: galton COMMAND ...

Policy gradients for continuous control: classification against regression.

commands:
{chr(10).join(f"  {name:10}{summary}" for name, summary in COMMANDS.items())}

galton COMMAND --help lists the options of a command.
"""


def main() -> None:
    """Run a command; the exit code says how it went: 0 done, 130 interrupted, or one of EXIT_CODES."""
    name, arguments = (sys.argv[1], sys.argv[2:]) if len(sys.argv) > 1 else ("--help", [])
    if name in ("--help", "-h"):
        print(HELP, end="")
    elif name == "--version":
        print(importlib.import_module("importlib.metadata").version("galton"))
    else:
        sys.exit(_run(name, arguments))


def _run(name: str, arguments: list[str]) -> int:
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that it cleans up as Ctrl-C does
    sys.path.append("")  # a module of one's own in the current folder is found; it can't hide an installed one
    try:
        if name not in COMMANDS:
            raise unknown("command", name, COMMANDS)
        run_command(f"galton.cli.{name}", arguments)
    except tuple(EXIT_CODES) as error:
        print(f"galton: {error}", file=sys.stderr)
        return next(code for kind, code in EXIT_CODES.items() if isinstance(error, kind))
    except KeyboardInterrupt:
        left = "the same command goes on with the rest" if name in RESUMABLE else "nothing was written"
        print(f"galton: interrupted; {left}", file=sys.stderr)
        return 130
    return 0
