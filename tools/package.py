"""Builds the wheel, looks into it, installs it far from the repository and uses it, with each extra by itself.

The extras test, bench, docs and dev are for work in the repository, and `make test` and `make docs` try them.
What was tried of the same wheel before is not tried again; remove results/packaging/package.json to have it so.

    python tools/package.py [--extras studies onnx] [--keep build/package] [--out results/packaging]
"""

import argparse
import json
import platform
import shutil
import sys
from pathlib import Path

import builds
from environments import Environment
from smoke import CORE, MISSING, SMOKE, TORCH, TRAIN, TRAINED_IN_TORCH, check

CONSTRAINTS = builds.ROOT / "constraints.txt"


def tried(wheel: Path, extra: str | None, folder: Path) -> dict[str, object]:
    """Install the wheel with one extra, or none, use it, and say what that took: bytes by package, and seconds."""
    requirement = f"{wheel}[{extra}]" if extra else str(wheel)
    environment = Environment.make(folder / (extra or "core"), [requirement], CONSTRAINTS)
    calls = [TRAIN, *SMOKE[extra]] if extra else [*CORE, *MISSING]
    seconds = check(environment, calls, str(folder.with_name("programs")))
    installed = environment.installed()
    environment.remove()
    return {
        "megabytes": round(sum(size for _, size in installed.values()) / 1e6, 1),
        "packages": {name: round(size / 1e6, 1) for name, (_, size) in installed.items()},
        "calls": len(calls),
        "seconds": round(seconds),
    }


def try_torch(wheel: Path, folder: Path) -> None:
    """Train with `galton.torch` where the wheel lies beside torch, without JAX or anything else that it depends on."""
    environment = Environment.make(folder / "torch", list(TORCH), CONSTRAINTS)
    environment.run("python", "-m", "pip", "install", "--quiet", "--no-deps", str(wheel))
    check(environment, [TRAINED_IN_TORCH], str(folder.with_name("programs")))
    beside = environment.installed()
    if "jax" in beside:
        sys.exit("JAX is beside torch, so nothing was learnt of whether galton.torch needs it")
    print(f"torch alone: trained and exported beside {', '.join(beside)}", flush=True)
    environment.remove()


def try_all(wheel: Path, extras: list[str], file: Path, record: dict, folder: Path) -> dict[str, dict]:
    """Try the core and these extras, and write each result into a file as it comes.

    What the file has of the same wheel is not tried again.
    """
    known = json.loads(file.read_text()) if file.exists() else {}
    found = known["environments"] if known.get("wheel") == record["wheel"] else {}
    file.parent.mkdir(parents=True, exist_ok=True)
    for extra in [None, *extras]:
        name = extra or "core"
        if name not in found:
            found[name] = tried(wheel, extra, folder)
            ordered = {name: found[name] for name in ("core", *SMOKE) if name in found}
            file.write_text(json.dumps(record | {"environments": ordered}, indent=1) + "\n")
        print(f"{name}: {found[name]['megabytes']} MB, {found[name]['calls']} calls as they must be", flush=True)
    return found


def table(found: dict[str, dict[str, object]]) -> str:
    """Tabulate what was installed and done: the size of an extra is what it adds to the core."""
    core = found["core"]
    rows = [("core", core["megabytes"], len(core["packages"]), core["calls"])]
    for extra, one in found.items():
        if extra != "core":
            more = one["packages"].keys() - core["packages"].keys()
            rows.append((extra, one["megabytes"] - core["megabytes"], len(more), one["calls"]))
    lines = [f"{'':10}{'MB':>8}{'packages':>10}{'calls':>7}"]
    return "\n".join([*lines, *(f"{name:10}{size:8.1f}{packages:10}{calls:7}" for name, size, packages, calls in rows)])


def main() -> None:
    """Do all of it, or end at what is wrong; keep the numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--extras", nargs="*", choices=list(SMOKE), default=list(SMOKE), help="those to try")
    parser.add_argument("--keep", type=Path, default=builds.ROOT / "build" / "package", help="the folder to work in")
    parser.add_argument("--out", type=Path, default=builds.ROOT / "results" / "packaging")
    options = parser.parse_args()
    folder = options.keep.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    wheel, source = builds.build(folder)
    print(f"two builds gave the same bytes: {wheel.name}, {source.name}")
    builds.check_metadata(wheel, source)
    kinds = builds.contents(wheel)
    print(f"in the wheel: {', '.join(f'{n} {kind}' for kind, n in kinds.items())}")
    print(f"in the source distribution: {', '.join(builds.in_source(source))}")
    record = {
        "python": platform.python_version(),
        "wheel": {"sha256": builds.digest(wheel), "bytes": wheel.stat().st_size, "holds": kinds},
        "source bytes": source.stat().st_size,
        **builds.made(wheel),
    }
    found = try_all(wheel, options.extras, options.out / "package.json", record, folder)
    try_torch(wheel, folder)
    print(f"{table(found)}\nthe wheel: {wheel}")


if __name__ == "__main__":
    main()
