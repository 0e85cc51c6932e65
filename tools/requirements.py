"""The requirements are those of pyproject.toml."""

import re
import tomllib

from builds import ROOT
from smoke import SMOKE

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
USERS = tuple(SMOKE)
"""The extras that somebody needs who uses Galton, and does not work on it."""
OTHERS = ("test", "bench", "docs", "dev")
"""Those for work in the repository."""


def users(python: str) -> tuple[str, ...]:
    """Those of USERS that have all their libraries under a version of Python, such as 3.14."""

    def there(extra: str) -> bool:
        ends = re.findall(r"python_version < '3\.(\d+)'", " ".join(PROJECT["optional-dependencies"][extra]))
        return all(int(python.partition(".")[2]) < int(end) for end in ends)

    return tuple(extra for extra in USERS if there(extra))


def lowest(extras: tuple[str, ...] = USERS) -> dict[str, str]:
    """The lowest version of each direct dependency of the core and these extras that is declared to do.

    Raises:
        ValueError: one is declared without a lowest version.
    """
    lines = [line for extra in extras for line in PROJECT["optional-dependencies"][extra]]
    found = {}
    for line in [*PROJECT["dependencies"], *lines]:
        if line.startswith("galton["):
            continue
        said = re.fullmatch(r"([\w.-]+)(?:>=|==)([\d.]+)(?:,<[\d.]+)?(?:; .*)?", line)
        if said is None:
            raise ValueError(f"{line!r} is no name>=lowest or name>=lowest,<next, with a marker behind it or none")
        found[said[1]] = said[2]
    return found
