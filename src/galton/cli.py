"""The galton command. Each subcommand is a module of galton.commands, loaded when it is called for."""

import importlib
import signal
import sys

COMMANDS = {
    "train": "train one policy and keep it in a run folder",
    "compare": "train several losses over many seeds and say which is best",
    "sweep": "train a grid of settings on every core or on a cluster",
    "watch": "film a policy that was trained",
    "reproduce": "train and draw the figures of the paper",
    "report": "write the page of what was reproduced",
}

RESUMABLE = ("sweep", "reproduce", "report")
"""Whose work is kept as it is done."""

HELP = f"""\
usage: galton COMMAND ...

Policy gradients for continuous control: classification against regression.

commands:
{chr(10).join(f"  {name:10}{summary}" for name, summary in COMMANDS.items())}

galton COMMAND --help lists the options of a command.
"""


def main() -> None:
    """Run a command. Exit codes: 0 done, 1 a broken environment, 2 a wrong argument or file, 130 interrupted."""
    name, arguments = (sys.argv[1], sys.argv[2:]) if len(sys.argv) > 1 else ("--help", [])
    if name in ("--help", "-h"):
        print(HELP, end="")
        return
    if name == "--version":
        print(importlib.import_module("importlib.metadata").version("galton"))
        return
    if name not in COMMANDS:
        sys.exit(_complain(f"command is {name!r}; choose from {', '.join(COMMANDS)}"))

    from galton.errors import BrokenEnvironmentError, CheckpointError, UsageError

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that it cleans up as Ctrl-C does
    sys.path.append("")  # a module of one's own in the current folder is found; it can't hide an installed one
    try:
        importlib.import_module(f"galton.commands.{name}").main(arguments)
    except (UsageError, CheckpointError) as error:
        sys.exit(_complain(str(error)))
    except BrokenEnvironmentError as error:
        sys.exit(_complain(str(error)) - 1)
    except KeyboardInterrupt:
        left = "the same command goes on with the rest" if name in RESUMABLE else "nothing was written"
        print(f"galton: interrupted; {left}", file=sys.stderr)
        sys.exit(130)


def _complain(message: str) -> int:
    print(f"galton: {message}", file=sys.stderr)
    return 2
