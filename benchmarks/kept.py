"""A study's command keeps what each of its jobs found in a file, and goes on from what is there."""

import argparse
import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from scipy import stats


def study(doc: str, name: str, jobs: Mapping[tuple[str, ...], Callable], tell: Callable) -> None:
    """Do each job that the file lacks, write it down and print a line of it.

    Args:
        doc: the help of the command.
        name: of its file in results/benchmarks.
        jobs: a job's place in the file, one key inside the other, and what finds its entry.
        tell: the text of an entry in its line.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("only", nargs="*", help="do the jobs whose place has one of these words; all without any")
    parser.add_argument("--out", type=Path, default=Path(f"results/benchmarks/{name}.json"))
    options = parser.parse_args()
    if unknown := set(options.only) - {word for place in jobs for word in place}:
        parser.error(f"no job has {', '.join(sorted(unknown))} in its place")
    out, found = options.out, json.loads(options.out.read_text()) if options.out.exists() else {}
    for (*groups, last), job in jobs.items():
        if options.only and not {*groups, last} & set(options.only):
            continue
        entries = found
        for group in groups:
            entries = entries.setdefault(group, {})
        if last not in entries:
            entries[last] = job()
            out.write_text(json.dumps(found) + "\n")
        print("|", " | ".join([*groups, last, tell(entries[last])]), "|", flush=True)


def interval(values, digits=3):
    """The mean of independent values with its 95% interval."""
    return f"{np.mean(values):.{digits}f} ± {stats.t.ppf(0.975, len(values) - 1) * stats.sem(values):.{digits}f}"
