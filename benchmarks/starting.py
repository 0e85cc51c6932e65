"""Measure how soon `galton compare` shows numbers: with nothing compiled before, and again.

The command runs on a terminal of its own with a folder of its own for compiled programs; its first numbers are the
first rate of training. A further process then tells on how many threads XLA spends what compiling costs.

    python benchmarks/starting.py [--again 5] [--out results/benchmarks]      # rewrites starting.json
"""

import argparse
import json
import os
import pty
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from sides import write

LOSSES = ("gaussian", "hl-one-hot", "hl-gauss", "hl-gauss-centred")
COMMAND = ("-m", "galton", "compare", "bandit", "--losses", *LOSSES, "--overwrite", "--out", "out")


def start(folder):
    """A comparison: seconds until its first numbers and until its end, and of the processor."""
    began = time.perf_counter()
    process, terminal = pty.fork()
    if not process:
        os.chdir(folder)
        os.environ.pop("JAX_COMPILATION_CACHE_DIR", None)
        os.environ |= {"GALTON_PROGRAMS": str(folder / "programs"), "COLUMNS": "100"}
        os.execv(sys.executable, [sys.executable, *COMMAND])
    shown, first = b"", None
    while data := _read(terminal):
        shown += data
        if first is None and b"steps/s" in shown:
            first = time.perf_counter() - began
    _, status, used = os.wait4(process, 0)
    assert status == 0, shown[-500:].decode(errors="replace")
    assert first is not None, "no rate was shown"
    return {"first": first, "whole": time.perf_counter() - began, "processor": used.ru_utime + used.ru_stime}


def _read(terminal):
    try:
        return os.read(terminal, 65536)
    except OSError:  # how Linux says that the other side is gone
        return b""


def by_thread():
    """Seconds of the processor that each thread of this process has used, the main one first."""
    ticks, seconds = os.sysconf("SC_CLK_TCK"), []
    for task in sorted(Path("/proc/self/task").iterdir(), key=lambda path: int(path.name)):
        fields = (task / "stat").read_text().rpartition(")")[2].split()
        seconds.append((int(fields[11]) + int(fields[12])) / ticks)
    return np.array(seconds)


def compiling():
    """Measure compiling for each loss, in seconds of the main thread and of each other; for a process of its own."""
    import galton

    galton.use_all_cores()
    galton.train("bandit", galton.make_agent(loss="gaussian", n_bins=3), [0], 100)  # what is done once
    rows = []
    for loss in LOSSES:
        before = by_thread()
        galton.train("bandit", galton.make_agent(loss=loss, n_steps=5, net_arch=()), range(20), 100, n_logs=1)
        after = by_thread()
        spent = after - np.pad(before, (0, len(after) - len(before)))
        others = sorted((seconds for seconds in spent[1:] if seconds >= 0.05), reverse=True)
        rows.append({"loss": loss, "main": round(spent[0], 2), "others": [round(seconds, 2) for seconds in others]})
    print(json.dumps(rows))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--again", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        first, *again = [start(Path(folder)) for _ in range(1 + arguments.again)]
    off = os.environ | {"GALTON_PROGRAMS": "off", "JAX_ENABLE_COMPILATION_CACHE": "false"}
    code = "import sys; sys.path.insert(0, sys.argv[1]); import starting; starting.compiling()"
    told = subprocess.run(
        [sys.executable, "-c", code, str(Path(__file__).parent)], check=True, capture_output=True, text=True, env=off
    )
    medians = {name: float(np.median([one[name] for one in again])) for name in first}
    found = {
        "command": "galton " + " ".join(COMMAND[2:]),
        "load": os.getloadavg()[0],
        "first_start": first,
        "again": again,
        "again_median": medians,
        "compiling": json.loads(told.stdout),
    }
    write(arguments.out / "starting.json", ("jax", "jaxlib"), **found)
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
