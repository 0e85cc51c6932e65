"""Mutants: Galton with one thing broken at a time, to see whether a test notices.

`python -m tests.mutants.runner` copies the source into a temporary folder, puts in one mutant after the other, runs
the tests that should fail, and writes results/trust/mutants.json. With names of files of this folder, or sentences in
them, (`python -m tests.mutants.runner losses "λ has no effect."`) it tries those alone and keeps what is known of the
others.
"""

import collections
import json
import multiprocessing
import os
import re
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
NEVER = "never tried"
RECORD = ROOT / "results" / "trust" / "mutants.json"
OPTIONS = ("-q", "-x", "-n", "0", "-p", "no:cacheprovider", "-m", "not slow")
PRELOADED = ["jax.numpy", "scipy.stats", "optax", "pyarrow.parquet", "gymnasium", "stable_baselines3"]
"""What the processes of all mutants share, so that it is imported once; Galton is not among it."""
MINUTES = 10
"""How long the tests of a mutant may take; one that makes them hang is noticed too."""


class Mutant(NamedTuple):
    """A change of one place of the source that breaks something, and who should notice."""

    file: str
    """The file under src."""
    breaks: str
    """What is broken, as a sentence."""
    old: str
    """The text that is replaced, which the file has once."""
    new: str
    tests: tuple[str, ...]
    """The files under tests/, or `file::test`, of which one should fail; quick ones first."""
    survives: str = ""
    """Why no test can notice, where that is so."""

    @property
    def name(self) -> str:
        """What the record calls it."""
        return f"{self.file}: {self.breaks}"


def load(*chosen: str) -> list[Mutant]:
    """The mutants of these files of this folder, or that break just this; all of them by default."""
    known = [(path.stem, mutant) for path in sorted(HERE.glob("*.toml")) for mutant in _of(path)]
    return [mutant for area, mutant in known if not chosen or area in chosen or mutant.breaks in chosen]


def _of(path: Path) -> Iterator[Mutant]:
    area = tomllib.loads(path.read_text())
    for known in area.pop("mutant"):
        whole = {**area, **known}
        yield Mutant(**whole | {"tests": tuple(whole["tests"])})


def mutated(mutant: Mutant, folder: Path) -> str:
    """The file's text with the mutant in it, from the packages in this folder."""
    text = (folder / mutant.file).read_text()
    assert text.count(mutant.old) == 1, f"{mutant.file} has {text.count(mutant.old)} × {mutant.old!r}"
    return text.replace(mutant.old, mutant.new)


def failing(folder: Path, tests: tuple[str, ...]) -> str:
    """The first of these tests that fails with the packages in this folder, "" if none does."""
    output = folder / "output"
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    process = context.Process(target=_test, args=(folder, tests, output))
    process.start()
    process.join(60 * MINUTES)
    if process.is_alive():
        process.kill()
        return f"more than {MINUTES} minutes"
    text = output.read_text()
    assert process.exitcode in (0, 1, 2), text  # 1: a test failed; 2: so did its import
    failed = re.search(r"^(?:FAILED|ERROR) (?:tests/)?([^\s\[]+)", text, re.MULTILINE)
    return failed[1] if failed else "" if process.exitcode == 0 else "import"


def _test(folder: Path, tests: tuple[str, ...], output: Path) -> None:
    """Run tests in this process, with the packages in this folder here and in processes that they start."""
    with output.open("w") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    os.environ |= {"PYTHONPATH": str(folder), "HYPOTHESIS_STORAGE_DIRECTORY": str(folder / "hypothesis")}
    os.environ.pop("GALTON_TRUST", None)
    os.chdir(ROOT)
    sys.path.insert(0, str(folder))
    import pytest

    preloaded = "ignore::pytest.PytestAssertRewriteWarning"  # what is imported already can't be rewritten
    sys.exit(pytest.main([*OPTIONS, "-W", preloaded, *(f"tests/{test}" for test in tests)]))


def main(*chosen: str) -> None:
    """Try mutants, tell of each and keep it in the record."""
    mutants = load(*chosen)
    assert mutants, f"there is no mutant {' or '.join(chosen)}"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "src"
        shutil.copytree(ROOT / "src", folder, ignore=shutil.ignore_patterns("__pycache__"))
        wrong = failing(folder, tuple(dict.fromkeys(test for mutant in mutants for test in mutant.tests)))
        assert not wrong, f"{wrong} fails without any mutant"
        for mutant in mutants:
            whole = (folder / mutant.file).read_text()
            (folder / mutant.file).write_text(mutated(mutant, folder))
            test = failing(folder, mutant.tests)
            (folder / mutant.file).write_text(whole)
            print(f"{'killed' if test else 'SURVIVED':10}{mutant.name} {test}", flush=True)
            keep(mutant, test)


def keep(mutant: Mutant, test: str) -> None:
    """Put what was found of a mutant into the record; those that were never tried count as survivors."""
    from tests.trust import Record, now, write

    details = json.loads(RECORD.read_text())["details"] if RECORD.exists() else {"killed": {}, "survived": {}}
    tried = [name for name, why in details["survived"].items() if why != NEVER]
    known = dict.fromkeys(tried, "") | details["killed"] | {mutant.name: test}
    found = {each: known.get(each.name) for each in load()}
    killed = {each.name: test for each, test in found.items() if test}
    survived = {each.name: NEVER if test is None else each.survives for each, test in found.items() if not test}
    killers = collections.Counter(test.partition("::")[0] for test in killed.values())
    promise = "If one small change breaks a loss, a return, a policy, an algorithm, a plan or a file, a test fails."
    details = {"killed": killed, "survived": survived, "killers": dict(killers.most_common())}
    share, unit = 100 * len(killed) / len(found), f"% of {len(found)} mutants killed"
    record = Record(promise, "tests", share, unit, "tests/mutants/runner.py", "make mutants", *now())
    write(RECORD, record._replace(at_least=90, details=details))


if __name__ == "__main__":
    main(*sys.argv[1:])
