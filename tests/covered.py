"""How many lines of the source the tests run: `make coverage` measures it, this makes the record of it.

Lines of programs for JAX count where they are traced, which is when Python runs them.
"""

import collections
import json
import sys
import tempfile
from pathlib import Path

import coverage

from tests.trust import RECORDS, ROOT, Record, now, write


def lines() -> dict[str, tuple[list[int], int]]:
    """Of each file under src: the lines that no test ran, and how many there are that could be run."""
    measured = coverage.Coverage()
    measured.load()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "coverage.json"
        ours = str(ROOT / "src" / "*")  # and no copy that a test made
        measured.json_report(outfile=str(path), include=[ours])
        files = json.loads(path.read_text())["files"]
    whole = {name.partition("src/")[2]: (of["missing_lines"], of["summary"]) for name, of in files.items()}
    return {name: (missing, summary["num_statements"]) for name, (missing, summary) in whole.items()}


def main() -> None:
    """Write the record, and print the lines that were not run."""
    found, packages = lines(), collections.defaultdict(lambda: [0, 0])
    for name, (missing, n) in found.items():
        package = "/".join(name.split("/")[1:-1][:1])
        packages[package or "galton"][0] += n - len(missing)
        packages[package or "galton"][1] += n
        if missing:
            print(f"{name} {len(missing)} of {n}: {', '.join(map(str, missing))}")
    run, of = (sum(each[i] for each in packages.values()) for i in (0, 1))
    details = {name: round(100 * a / b, 1) for name, (a, b) in sorted(packages.items()) if b}
    unit, promise = f"% of {of:,} lines", "The tests that take seconds run nearly every line."
    print(f"{100 * run / of:.1f}{unit}", details)
    record = Record(promise, "tests", 100 * run / of, unit, "tests/covered.py", "make coverage", *now())
    write(RECORDS / "coverage.json", record._replace(at_least=95, details=details))


if __name__ == "__main__":
    sys.exit(main())
