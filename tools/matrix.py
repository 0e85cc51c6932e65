"""Uses the wheel, with all extras for users, under every version of Python that is here.

The versions of the libraries are those of constraints.txt, or with --newest those that pip takes by itself
beside the ones that are named.

    python tools/matrix.py [--newest [jax==0.11.2 ...]] [--pythons 3.11 3.12 3.13 3.14] [--out results/packaging]
"""

import argparse
import json
from pathlib import Path

import builds
from environments import Environment, find_python
from requirements import users
from smoke import CORE, SMOKE, check


def main() -> None:
    """Try each version, print a line for it, and keep what was seen."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--newest", nargs="*", metavar="NAME==VERSION", help="without constraints.txt, but for these")
    parser.add_argument("--pythons", nargs="+", default=["3.11", "3.12", "3.13", "3.14"], help="their versions")
    parser.add_argument("--keep", type=Path, default=builds.ROOT / "build" / "matrix", help="the folder to work in")
    parser.add_argument("--out", type=Path, default=builds.ROOT / "results" / "packaging")
    options = parser.parse_args()
    folder = options.keep.resolve()
    is_newest, named = options.newest is not None, options.newest or []
    kind, constraints = ("newest", None) if is_newest else ("matrix", builds.ROOT / "constraints.txt")
    name = "-".join([kind, *(one.replace("==", "-") for one in named)])
    wheel, _ = builds.build(folder / "built")
    made = builds.made(wheel)
    options.out.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, object]] = {}
    for version in options.pythons:
        python = find_python(version)
        if python is None:
            print(f"Python {version}: not here", flush=True)
            continue
        extras = users(version)
        calls = [*CORE, *(call for extra in extras for call in SMOKE[extra])]
        wanted = [f"{wheel}[{','.join(extras)}]", *named]
        environment = Environment.make(folder / version, wanted, constraints, python)
        seconds = check(environment, calls, str(folder.with_name("programs")))
        whole = environment.run("python", "-c", "import platform; print(platform.python_version())").stdout.strip()
        installed = {library: release for library, (release, _) in environment.installed().items()}
        environment.remove()
        found[version] = {"python": whole, "calls": len(calls), "seconds": round(seconds)} | made
        found[version] |= {"installed": installed} if is_newest else {}
        ordered = {one: found[one] for one in sorted(found, key=lambda one: int(one.partition(".")[2]))}
        (options.out / f"{name}.json").write_text(json.dumps(ordered, indent=1) + "\n")
        print(f"Python {whole}: {len(calls)} calls as they must be, {round(seconds)} s", flush=True)


if __name__ == "__main__":
    main()
