"""The galton command. Each of COMMANDS is a module beside this one or of EXPERIMENTS, loaded when it is called for.

Its exit codes: 0 done; 1 an environment broke; 2 a wrong argument, a file that can't be read or written, a full disk
or too little memory; 130 interrupted; 141 nobody read the output any more, as a shell shows SIGPIPE.
"""

import atexit
import os
import signal
import sys

from galton.cli._interrupts import ASKING
from galton.cli._output import keep_signs
from galton.cli._program_faults import keep_programs
from galton.cli._words import run_command
from galton.errors import BrokenEnvironmentError, CheckpointError, UsageError, require, require_word
from galton.version import __version__

COMMANDS = {
    "train": "train one policy and keep it in a run folder",
    "compare": "train several losses over many seeds and say which is best",
    "sweep": "train a grid of settings on every core or on a cluster",
    "benchmark": "tune methods with equal budgets and judge them on held-out tasks",
    "watch": "film a policy that was trained",
    "export": "write a trained policy as an ONNX file, or its model card",
    "check": "say what Galton makes of an environment, and what to do about it",
    "evaluate": "play episodes of a trained policy and say what they return",
    "plot": "draw the learning curves of runs",
}

EXPERIMENTS = ("compare", "sweep", "benchmark", "plot")
"""The commands of many runs, which the package above this one has."""

MOVED = ("reproduce", "report")
"""Commands of before 0.2.0 that the studies in a clone have now."""

RESUMABLE = ("sweep", "benchmark")
"""The commands whose work is kept as it is done."""

SIZES = (
    "net-arch",
    "n-bins",
    "n-envs",
    "n-steps",
    "eval-episodes",
    "seeds",
    "trials",
    "logs",
    "shard-width",
    "gpus",
    "max-steps",
    "episodes",
)
"""The options that decide how much memory is needed. What they are by default fits any machine."""

HELP = f"""\
usage: galton COMMAND ...

Policy gradients for continuous control: classification against regression.

commands:
{chr(10).join(f"  {name:10}{summary}" for name, summary in COMMANDS.items())}

galton COMMAND --help lists the options of a command. Those of train and compare are the ones that people use most;
--help-all lists all.
"""


def main() -> None:
    """Run a command; the exit code says how it went, as the module's docstring has it."""
    name, arguments = (sys.argv[1], sys.argv[2:]) if len(sys.argv) > 1 else ("--help", [])
    keep_signs()
    try:
        code: int | str | None = _run(name, arguments)
    except SystemExit as left:  # tyro's, or rich's where nobody reads what it prints
        code = 141 if isinstance(left.__context__, BrokenPipeError) else left.code
    except BrokenPipeError:
        code = 141
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # Python would try again as it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = code or 141
    for number in ASKING:  # all is done; what was registered last is called first
        atexit.register(signal.signal, number, signal.SIG_IGN)
    sys.exit(code)


def _run(name: str, arguments: list[str]) -> int:
    if name == "help" and arguments:
        name, arguments = arguments[0], ["--help"]
    if name in ("--help", "-h", "help"):
        print(HELP, end="")
        return 0
    if name in ("--version", "-v", "-V", "version"):
        print(__version__)
        return 0
    for number in ASKING:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)  # so that it cleans up as Ctrl-C does
    try:
        require(name not in MOVED, f"{name} is a command of a clone now: python -m studies.paper {name}")
        require_word("command", name, COMMANDS)
        keep_programs()
        package = "galton_experiments.commands" if name in EXPERIMENTS else "galton.cli"
        run_command(f"{package}.{name}", arguments)
    except (BrokenEnvironmentError, CheckpointError, UsageError) as error:
        print(f"galton: {error}", file=sys.stderr)
        return 1 if isinstance(error, BrokenEnvironmentError) else 2
    except KeyboardInterrupt as interrupt:
        left = "the same command goes on with the rest" if name in RESUMABLE else "nothing was written"
        done = f"{interrupt}, and " if interrupt.args else ""
        print(f"galton: interrupted; {done}{left}", file=sys.stderr)
        return 130
    except BrokenPipeError:
        raise
    except Exception as error:
        cause = _of_the_machine(error, arguments)
        if cause is None:
            raise
        print(f"galton: {cause}", file=sys.stderr)
        return 2
    return 0


def _of_the_machine(error: Exception, arguments: list[str]) -> str | None:
    """The message for an error that comes of this machine: its files, its disk, its memory; None for any other."""
    if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error):  # what NumPy and JAX raise
        typed = [word.partition("=")[0].removeprefix("--").replace("_", "-") for word in arguments]
        options = [f"--{name}" for name in SIZES if name in typed] or [f"--{name}" for name in SIZES]
        said = (str(error) or type(error).__name__).splitlines()[0]
        return f"there is too little memory for this; make {' or '.join(options)} smaller ({said})"
    if isinstance(error, OSError):
        return f"a file can't be read or written: {error}"
    return None
