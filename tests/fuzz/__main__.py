"""Fuzz readers, guided by coverage: `python -m tests.fuzz [--seconds N] [--folder FOLDER] [TARGET ...]`.

Needs atheris. Prints for each target how many inputs were read, and ends with 1 if one of them is a finding; then
that input lies in FOLDER/TARGET, and belongs into tests/fuzz/corpus/TARGET with what mends it. With --inputs N it
reads so many inputs of each target, always the same, without atheris.
"""

import argparse
import random
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

LONGEST = 1 << 16
"""Bytes of an input."""


def fuzz(name: str, seconds: int, folder: Path) -> tuple[int, str]:
    """Fuzz one target in a process of its own: how many inputs were read, and what is told of a finding, or nothing."""
    here = folder / name
    here.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "tests.fuzz", "--child", name, "--seconds", str(seconds), "--folder", str(folder)]
    # Through a shell: a process begins with the peak memory of the one that forked it, which libFuzzer would count.
    command = ["/bin/sh", "-c", '"$@"; exit $?', "fuzz", *command]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    told = re.search(r"stat::number_of_executed_units:\s*(\d+)", done.stdout)
    n = int(told[1]) if told else 0
    finding = re.sub(r"(?m)^#\d+\t.*\n", "", done.stdout)[-3000:]  # without what it says of coverage
    return n, "" if done.returncode == 0 and told else finding or f"exit code {done.returncode}"


def child(name: str, seconds: int, folder: Path) -> None:
    """Fuzz a target until the time is over; does not return."""
    import atheris

    with atheris.instrument_imports(include=["galton", "tomllib"]):
        import galton

        from . import targets
    galton.use_all_cores()
    scratch = Path(tempfile.mkdtemp(dir=folder / name))
    corpus = folder / name / "corpus"
    corpus.mkdir(exist_ok=True)
    for i, seed in enumerate(targets.seeds(name)):
        (corpus / f"seed-{i}").write_bytes(seed)
    targets.warm_up(name, scratch)
    change = targets.TARGETS[name].change

    def mutate(data: bytes, longest: int, seed: int) -> bytes:
        draw = random.Random(seed)
        if draw.random() < 0.2:
            return atheris.Mutate(data, longest)
        return change(data, draw)[:longest]

    def read(data: bytes) -> None:
        targets.run(name, data, scratch)

    options = [f"-max_total_time={seconds}", f"-max_len={LONGEST}", f"-artifact_prefix={folder / name}/finding-"]
    options += ["-print_final_stats=1", "-rss_limit_mb=4096", "-timeout=120", "-len_control=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], read, custom_mutator=mutate)
    atheris.Fuzz()


def read_some(n: int) -> None:
    """Read valid files of each target, and n with something changed; a finding is raised."""
    import galton

    from . import targets

    galton.use_all_cores()
    for name, target in targets.TARGETS.items():
        scratch, draw, files = Path(tempfile.mkdtemp()), random.Random(0), targets.seeds(name)
        targets.warm_up(name, scratch)
        files += [target.change(draw.choice(files), draw) for _ in range(n)]
        taken = [targets.run(name, data, scratch) for data in files]
        print(f"{name}: {len(files)} inputs read, {sum(taken)} of them taken for valid")
        shutil.rmtree(scratch)


def main() -> None:
    """Fuzz the targets that are named, or all."""
    parser = argparse.ArgumentParser()
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--seconds", type=int, default=120)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir(), "galton-fuzz"))
    parser.add_argument("--inputs", type=int)
    parser.add_argument("--child")
    given = parser.parse_args()
    if given.inputs:
        read_some(given.inputs)
        return
    if given.child:
        child(given.child, given.seconds, given.folder)
    from .targets import TARGETS

    failed = False
    for name in given.targets or TARGETS:
        n, finding = fuzz(name, given.seconds, given.folder)
        print(
            f"{name}: {n:,} inputs in {given.seconds} s" + (f", and a finding:\n{finding}" if finding else ""),
            flush=True,
        )
        failed |= bool(finding)
    sys.exit(failed)


if __name__ == "__main__":
    main()
