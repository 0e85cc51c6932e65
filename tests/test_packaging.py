"""What the package says of itself agrees with itself, and with what `make package` and `make matrix` found."""

import json
import re
import tomllib
from pathlib import Path

import pytest

import galton
from galton import extras

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results" / "packaging"
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]
OTHERS = {"brax", "gymnax", "mjx", "playground", "torch"}
"""Extras that `make test-others` installs and tries."""
USERS = set(extras.LIBRARIES.values()) - OTHERS
"""The extras that somebody needs who uses Galton, and does not work on it."""


def numbers(version):
    return tuple(int(part) for part in re.findall(r"\d+", version))


def name_of(requirement):
    return re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", requirement)[0]).lower()


def found(name):
    return json.loads((RESULTS / f"{name}.json").read_text())


def test_the_version_stands_in_one_place():
    assert "version" in PROJECT["dynamic"]
    assert (ROOT / PYPROJECT["tool"]["hatch"]["version"]["path"]).samefile(Path(galton.__file__).parent / "version.py")
    assert f"version: {galton.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    newest = re.search(r"^## ([\d.]+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert galton.__version__.removesuffix(".dev0") == newest[1]


def test_every_direct_dependency_is_pinned_within_what_is_declared():
    pins = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines())
    pins = {name_of(name): version for name, version in pins.items()}
    lines = [*PROJECT["dependencies"], *(line for some in PROJECT["optional-dependencies"].values() for line in some)]
    lines = [line for line in lines if not line.startswith("galton[")]
    assert len(lines) > 30
    for line in lines:
        for sign, version in re.findall(r"(>=|==|<)([\d.]+)", line):
            pinned, bound = numbers(pins[name_of(line)]), numbers(version)
            assert {">=": pinned >= bound, "==": pinned == bound, "<": pinned < bound}[sign], line


def test_every_extra_for_users_was_installed_by_itself_and_used():
    assert found("package")["environments"].keys() == {"core"} | USERS
    assert PROJECT["optional-dependencies"].keys() == USERS | OTHERS | {"test", "bench", "docs", "dev", "studies"}


def test_the_core_has_no_library_of_an_extra():
    core = found("package")["environments"]["core"]["packages"]
    assert core.keys() >= {name_of(line) for line in PROJECT["dependencies"]}
    assert not core.keys() & {name_of(library) for library in extras.LIBRARIES}


def test_the_versions_of_python_that_were_tried_are_those_named():
    named = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r"Python :: 3\.\d+$", line)]
    tried = {found("package")["python"].rpartition(".")[0]}
    tried |= found("matrix").keys() if (RESULTS / "matrix.json").exists() else set()
    assert named == sorted(tried, key=numbers)
    assert PROJECT["requires-python"] == f">={named[0]}"


def test_the_lowest_versions_that_were_tried_are_those_declared():
    tried = {name_of(name): version for name, version in found("lowest")["declared"].items()}
    lines = [*PROJECT["dependencies"], *(line for name in USERS for line in PROJECT["optional-dependencies"][name])]
    declared = {name_of(line): re.search(r">=([\d.]+)", line)[1] for line in lines if not line.startswith("galton[")}
    assert tried == declared
    installed = found("lowest")["installed"]
    for name, version in declared.items():
        assert numbers(installed[name])[: len(numbers(version))] == numbers(version), name


def test_the_newest_versions_were_tried_under_each_of_these_pythons():
    assert found("newest").keys() == found("matrix").keys()
    core = {name_of(line) for line in PROJECT["dependencies"]}
    assert all(one["installed"].keys() >= core for one in found("newest").values())


def test_the_page_says_which_newest_versions_were_used_under_which_python():
    rows: dict[tuple[str, str], list[str]] = {}
    commands = {"newest": "make newest", "newest-jax-0.11.2": "tools/matrix.py --newest jax==0.11.2"}
    tried = [(command, *one) for name, command in commands.items() for one in found(name).items()]
    for command, python, one in tried:
        named = {"jax": "JAX", "mujoco": "MuJoCo", "gymnasium": "Gymnasium", "numpy": "NumPy"}
        told = ", ".join(f"{name} {one['installed'][library]}" for library, name in named.items())
        rows.setdefault((told, command), []).append(python)
    page = (ROOT / "docs" / "install.md").read_text()
    for (told, command), pythons in rows.items():
        assert f"{told} | {', '.join(pythons)} | `{command}` |" in page
    assert f"| {', '.join(found('matrix'))} | `make matrix` |" in page


def test_the_table_of_extras_says_what_was_measured():
    sizes = {name: one["megabytes"] for name, one in found("package")["environments"].items()}
    page = (ROOT / "docs" / "install.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \|.*\| (\d+) MB \|$", page, re.MULTILINE))
    assert rows.keys() == USERS
    for name, said in rows.items():
        assert float(said) == pytest.approx(sizes[name] - sizes["core"], abs=0.51), name
    core = re.search(r"core takes (\d+) MB", page)
    assert float(core[1]) == pytest.approx(sizes["core"], abs=0.51)


def test_the_packages_description_has_no_link_into_the_repository():
    hook = PYPROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]
    (fragment,) = hook["fragments"]
    text = (ROOT / fragment["path"]).read_text()
    for change in hook["substitutions"]:
        text = re.sub(change["pattern"], change["replacement"], text)
    assert [link for link in re.findall(r"\]\(([^)]*)", text) if not link.startswith("https://")] == []
    assert "make demo" in text
