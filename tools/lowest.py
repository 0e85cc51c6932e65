"""Installs the lowest versions that pyproject.toml declares, and uses Galton with them.

Every direct dependency of the core and of the extras for users is of its lowest version at once; what those bring
themselves is of the newest version that they take. The wheel is used as tools/smoke.py says, and the tests of the
core run, with warnings that are no errors.

    python tools/lowest.py [--python 3.11] [--out results/packaging]
"""

import argparse
import json
import sys
from pathlib import Path

import builds
from environments import Environment, find_python
from requirements import USERS, lowest
from smoke import CORE, SMOKE, check

TESTS = (
    "test_bins.py",
    "test_targets.py",
    "test_losses.py",
    "test_returns.py",
    "test_theory.py",
)
"""The tests of what computes, which need no other library to compare with."""
TEST_LIBRARIES = ["beartype", "hypothesis", "pytest"]


def main() -> None:
    """Make the environment, use it, run the tests, and keep the versions."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default="3.11", help="its version")
    parser.add_argument("--keep", type=Path, default=builds.ROOT / "build" / "lowest", help="the folder to work in")
    parser.add_argument("--out", type=Path, default=builds.ROOT / "results" / "packaging")
    options = parser.parse_args()
    python = find_python(options.python)
    if python is None:
        sys.exit(f"there is no Python {options.python} here")
    folder = options.keep.resolve()
    wheel, _ = builds.build(folder / "built")
    made = builds.made(wheel)
    declared = lowest()
    constraints = folder / "lowest.txt"
    constraints.write_text("".join(f"{name}=={version}\n" for name, version in declared.items()))
    requirements = [f"{wheel}[{','.join(USERS)}]", *TEST_LIBRARIES]
    environment = Environment.make(folder / "environment", requirements, constraints, python)
    calls = [*CORE, *(call for extra in USERS for call in SMOKE[extra])]
    seconds = check(environment, calls, str(folder.with_name("programs")))
    tests = [str(builds.ROOT / "tests" / name) for name in TESTS]
    lenient = ("-o", "filterwarnings=", "-p", "no:cacheprovider", "-m", "not slow")
    done = environment.run("python", "-m", "pytest", *lenient, *tests)
    if done.returncode:
        sys.exit(f"{done.stdout}{done.stderr}")
    installed = {name: version for name, (version, _) in environment.installed().items()}
    environment.remove()
    told = done.stdout.strip().splitlines()[-1].partition(" in ")[0]
    print(f"Python {options.python} with the lowest versions: {round(seconds)} s of use, and {told}")
    options.out.mkdir(parents=True, exist_ok=True)
    record = {"python": options.python, "declared": declared, "installed": installed}
    record |= {"calls": len(calls), "tests": told} | made
    (options.out / "lowest.json").write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
