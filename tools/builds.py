"""The wheel and the source distribution: built twice, compared, checked and looked into."""

import datetime
import functools
import hashlib
import subprocess
import sys
import tarfile
import zipfile
from collections import Counter
from pathlib import Path

from environments import clean

ROOT = Path(__file__).parents[1]
PARTS = {
    ".py": "modules",
    ".pyi": "stubs, from which names are loaded and types are read",
    ".typed": "the mark that Galton has types",
    ".css": "the page of `galton benchmark`",
    ".jinja": "the page of `galton benchmark`",
}
"""The files that a wheel may hold under galton/, by their ending."""
BESIDE = {"LICENSE", "METADATA", "RECORD", "WHEEL", "entry_points.txt"}
"""The files that it may hold beside those."""


def build(folder: Path) -> tuple[Path, Path]:
    """Build the wheel, by way of the source distribution, and return both files; two builds must give the same bytes.

    Raises:
        SystemExit: they do not, or a build fails.
    """
    first, second = (_build(folder / name) for name in ("first", "second"))
    for one, other in zip(first, second, strict=True):
        if one.name != other.name or one.read_bytes() != other.read_bytes():
            sys.exit(f"two builds differ: {one} and {other}")
    source, wheel = first
    return wheel, source


def _build(folder: Path) -> list[Path]:
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT]
    done = subprocess.run(command, capture_output=True, text=True, env=clean())
    if done.returncode:
        sys.exit(f"the build failed:\n{done.stdout}{done.stderr}")
    found = [*folder.glob("*.tar.gz"), *folder.glob("*.whl")]
    if len(found) != 2:
        sys.exit(f"{folder} holds {found}, and not a source distribution and a wheel")
    return found


def check_metadata(*files: Path) -> None:
    """End unless an index would take these files, and show their description, which no relative link may stand in.

    Raises:
        SystemExit: with what is wrong.
    """
    done = subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *files], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{done.stdout}{done.stderr}")
    description = metadata(files[0]).partition("\n\n")[2]
    for piece in description.split("](")[1:]:
        if not piece.startswith(("https://", "#")):
            sys.exit(f"the description has a link that leads nowhere outside the repository: {piece.partition(')')[0]}")


def metadata(wheel: Path) -> str:
    """Read what the wheel says of itself; the description follows its first empty line."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
        return archive.read(name).decode()


def contents(wheel: Path) -> dict[str, int]:
    """Count the files of each kind that the wheel holds.

    Raises:
        SystemExit: one that a user does not need, or code that is not the repository's.
    """
    kinds: Counter[str] = Counter()
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            path = Path(name)
            if path.parts[0].startswith("galton") and path.suffix in PARTS:
                if archive.read(name) != (ROOT / "src" / path).read_bytes():
                    sys.exit(f"{name} is not the repository's")
                kinds[path.suffix] += 1
            elif path.parts[0].endswith(".dist-info") and path.name in BESIDE:
                kinds[path.name] += 1
            else:
                sys.exit(f"{name} is in the wheel, where no user needs it")
    return dict(sorted(kinds.items()))


def in_source(source: Path) -> list[str]:
    """List what lies at the top of the source distribution."""
    with tarfile.open(source) as archive:
        return sorted({name.split("/")[1] for name in archive.getnames()})


def made(wheel: Path) -> dict[str, str]:
    """The day, and the wheel's version and commit, with a + where the source is not as in that commit."""
    git = functools.partial(subprocess.run, cwd=ROOT, capture_output=True, text=True)
    commit = git(["git", "rev-parse", "--short=12", "HEAD"]).stdout.strip()
    changed = git(["git", "diff", "--quiet", "HEAD", "--", "src", "pyproject.toml"]).returncode
    today = datetime.datetime.now(datetime.UTC).date()
    version = wheel.name.split("-")[1]
    return {"measured": today.isoformat(), "version": f"{version} ({commit}{'+' if changed else ''})"}


def digest(file: Path) -> str:
    """The SHA-256 of a file's bytes."""
    return hashlib.sha256(file.read_bytes()).hexdigest()
