"""Promises, what was last measured of them, and the table of both in docs/trust.md.

A test that holds a promise takes the fixture `trust` and calls it in the end with the figure that it found. Where
GALTON_TRUST names a folder, only such tests run, and each call leaves a file there; otherwise nothing is written.
`python -m tests.trust FOLDER` then makes the records in results/trust of them and of what `make package`, `make
lowest`, `make matrix`, `make newest` and `benchmarks/starting.py` found, and the table of all records.
"""

import datetime
import functools
import hashlib
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, NamedTuple

from galton.saving import files
from galton.saving.provenance import version

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results"
RECORDS, PAGE = RESULTS / "trust", ROOT / "docs" / "trust.md"
FOLDER = os.environ.get("GALTON_TRUST") and Path(os.environ["GALTON_TRUST"]).absolute()
TOPICS = {
    "numbers": "The numbers are right",
    "work": "Work lasts",
    "damage": "What is damaged or hostile does no harm",
    "starting": "It installs, starts and stops",
    "deployed": "Policies run elsewhere",
    "tests": "The tests would notice",
}
"""The headings of the table, in their order, by the word that a record has for them."""
JOINED = {"largest": max, "smallest": min, "sum": sum}


class Record(NamedTuple):
    """A promise and what was last measured of it: a file in results/trust, whose name is the record's."""

    promise: str
    """What holds, as a sentence for a reader who has not read the code."""
    topic: str
    """A key of TOPICS."""
    figure: float
    """What was measured, in `unit`."""
    unit: str
    """What is counted or measured, such as "kills survived"."""
    test: str
    """The test that holds it: `tests/FILE.py::NAME`, without parameters; or the file that measures it."""
    command: str
    """What measures it again."""
    measured: str
    """The day."""
    version: str
    """Galton's version and commit."""
    at_most: float | None = None
    """What the figure must not exceed, if it has such a bound."""
    at_least: float | None = None
    """What the figure must reach, if it has such a bound."""
    details: object = None
    """What else is worth keeping, as JSON: what survived, or the figure of each part."""


def note(
    folder: Path | None,
    case: str,
    name: str,
    promise: str,
    *,
    topic: str,
    figure: float,
    unit: str,
    at_most: float | None = None,
    at_least: float | None = None,
    over: Literal["largest", "smallest", "sum"] = "largest",
    command: str = "",
) -> None:
    """Leave what a case of a test measured in a folder; nothing where that is None.

    Args:
        folder: of what was measured.
        case: the test's id, with its parameters.
        name: of the record, such as "sweep-killed".
        promise: see `Record`, as for those that follow.
        topic: a key of TOPICS.
        figure: of this case.
        unit: what is counted or measured.
        at_most: one bound.
        at_least: the other; one of them must be there.
        over: how the cases of one test become one figure.
        command: what measures it again; by default `make trust` for this test alone.
    """
    test = case.partition("[")[0]
    command = command or f"make trust TESTS={test}"
    record = Record(promise, topic, float(figure), unit, test, command, "", "", at_most, at_least)
    check(name, record)
    assert over in JOINED, over
    if folder:
        day, made_by = now()
        digest = hashlib.sha256(case.encode()).hexdigest()[:16]
        write(folder / f"{name}@{digest}.json", record._replace(measured=day, version=made_by), over=over)


def now() -> tuple[str, str]:
    """The day, and Galton's version and commit, with a + where source or tests are not as in that commit."""
    git = functools.partial(subprocess.run, cwd=ROOT, capture_output=True, text=True)
    commit = git(["git", "rev-parse", "--short=12", "HEAD"]).stdout.strip()
    changed = git(["git", "diff", "--quiet", "HEAD", "--", "src", "tests"]).returncode
    today = datetime.datetime.now(datetime.UTC).date()
    return today.isoformat(), f"{version()} ({commit}{'+' if changed else ''})"


def check(name: str, record: Record) -> None:
    """Fail unless a record says all that the table needs."""
    assert name.replace("-", "").isalnum(), f"{name}: letters, digits and hyphens"
    assert record.topic in TOPICS, f"{name}: topic is {record.topic!r}; choose from {', '.join(TOPICS)}"
    assert record.promise.endswith("."), f"{name}: a promise is a whole sentence"
    assert (record.at_most is None) != (record.at_least is None), f"{name}: give at_most or at_least"
    assert math.isfinite(record.figure), f"{name}: figure is {record.figure}"


def write(path: Path, record: Record, **more: object) -> None:
    """A record as JSON; a bound that it does not have is left out."""
    known = {field: value for field, value in record._asdict().items() if value is not None}
    files.write(path, (json.dumps(known | more, indent=1, ensure_ascii=False) + "\n").encode())


def gather(folder: Path) -> dict[str, Record]:
    """The records by name of what tests left in a folder: one of all cases of a test."""
    found: dict[str, list[dict[str, Any]]] = {}
    for path in sorted(folder.glob("*@*.json")):
        found.setdefault(path.name.partition("@")[0], []).append(json.loads(path.read_text()))
    records = {}
    for name, cases in found.items():
        assert len({case["test"] for case in cases}) == 1, f"{name} is the name of two records"
        figure = JOINED[cases[0]["over"]](case["figure"] for case in cases)
        known = {field: value for field, value in cases[0].items() if field in Record._fields}
        records[name] = Record(**known | {"figure": figure})
    return records


def outside() -> dict[str, Record]:
    """The records by name of what is measured outside the tests: the wheel far from here, and a command's start."""
    package, lowest, matrix, newest, starting = (
        json.loads((RESULTS / f"{name}.json").read_text())
        for name in (
            *(f"packaging/{name}" for name in ("package", "lowest", "matrix", "newest")),
            "benchmarks/starting",
        )
    )

    def record(promise: str, figure: float, unit: str, file: str, command: str, of: dict[str, Any], **bound: float):
        return Record(promise, "starting", figure, unit, file, command, of["measured"], of["version"], **bound)

    versions = starting["versions"]
    starting["version"] = f"{versions['galton']} ({versions['commit']})"
    alone = package["environments"]
    pinned, free = (list(found.values())[-1] for found in (matrix, newest))
    theirs = [f"{library} {free['installed'][library]}" for library in ("gymnasium", "jax", "mujoco", "numpy")]
    return {
        "wheel": record(
            "Two builds give the same bytes. The wheel works in an empty environment, by its core and with each extra "
            "alone; a lacking extra is named.",
            sum(one["calls"] for one in alone.values()),
            f"calls as they must be, in {len(alone)} environments",
            *("tools/package.py", "make package", package),
            at_least=30,
        ),
        "lowest": record(
            "The wheel works with the lowest version of every library that it declares, all at once.",
            lowest["calls"],
            f"calls as they must be with {len(lowest['declared'])} libraries, and {lowest['tests']}",
            *("tools/lowest.py", "make lowest", lowest),
            at_least=20,
        ),
        "pythons": record(
            f"The wheel works with all its extras under Python {', '.join(matrix)}; Box2D has no wheel for 3.14.",
            len(matrix),
            f"versions, each with {pinned['calls']} calls or more as they must be",
            *("tools/matrix.py", "make matrix", pinned),
            at_least=3,
        ),
        "newest": record(
            "The wheel works with the newest version of every library that each of these Pythons has.",
            len(newest),
            f"versions, the last with {', '.join(theirs)}",
            *("tools/matrix.py", "make newest", free),
            at_least=3,
        ),
        "starting": record(
            "`galton compare` soon shows its first numbers when it is started a second time.",
            starting["again_median"]["first"],
            f"seconds, the median of {len(starting['again'])} starts on {starting['cores']} cores",
            *("benchmarks/starting.py", "python benchmarks/starting.py", starting),
            at_most=5,
        ),
    }


def load(folder: Path = RECORDS) -> dict[str, Record]:
    """The records of a folder by name, in order."""
    return {path.stem: Record(**json.loads(path.read_text())) for path in sorted(folder.glob("*.json"))}


def kept(record: Record) -> bool:
    """Whether the figure is within its bound."""
    if record.at_most is not None:
        return record.figure <= record.at_most
    return record.figure >= record.at_least


def table(records: Iterable[Record]) -> str:
    """Records as rows of a Markdown table; "" where there are none."""
    rows = []
    for record in records:
        path, _, name = record.test.partition("::")
        title = f' "{name}"' if name else ""
        bounds = {"at most": record.at_most, "at least": record.at_least}
        bound = " and ".join(f"{word} {number(value)}" for word, value in bounds.items() if value is not None)
        figure = f"{number(record.figure)} {record.unit}".replace(" %", "%") + ("" if kept(record) else ", **missed**")
        test = f"[{Path(path).name}](../{path}{title})"
        rows.append(f"| {record.promise} | {test} | {bound} | {figure} |")
    head = "| promise | test | asked | last measured |\n|---|---|---|---|\n"
    return head + "\n".join(rows) if rows else ""


def number(value: float) -> str:
    """A figure as a page shows it: 50, 1,250, 99.3, 3.41e-07."""
    if value == int(value) and abs(value) < 1e9:
        return f"{int(value):,}"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"


def page(text: str, records: Iterable[Record]) -> str:
    """The page with the tables of these records."""
    from galton_experiments.page.quotes import filled  # much to import, which conftest.py has no use for

    known = list(records)
    tables = {title: table(record for record in known if record.topic == topic) for topic, title in TOPICS.items()}
    return filled(text, {title: rows for title, rows in tables.items() if rows}.get)


def main(*folders: str) -> None:
    """Take over what tests left in folders, and write the page."""
    for found in (*(gather(Path(folder)) for folder in folders), outside()):
        for name, record in found.items():
            write(RECORDS / f"{name}.json", record)
    files.write(PAGE, page(PAGE.read_text(encoding="utf-8"), load().values()).encode())


if __name__ == "__main__":
    main(*sys.argv[1:])
