"""Virtual environments in which a built wheel is installed, measured and used, far from the repository."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

SIZES = """
import importlib.metadata, json, re, sys
found = {}
for one in importlib.metadata.distributions():
    name = re.sub(r"[-_.]+", "-", one.metadata["Name"]).lower()
    files = [file.locate() for file in one.files or []]
    found[name] = [one.version, sum(file.stat().st_size for file in files if file.is_file())]
json.dump(found, sys.stdout)
"""
OF_VENV = ("pip", "setuptools")
"""The packages that are in an environment before anything is installed."""


@dataclasses.dataclass(frozen=True)
class Environment:
    """A virtual environment and the folder that its commands work in."""

    folder: Path
    work: Path

    @classmethod
    def make(cls, folder: Path, requirements: list[str], constraints: Path | None, python: str = sys.executable):
        """A new environment with these requirements; one that was there is replaced.

        Args:
            folder: the environment; what its commands write lies beside it.
            requirements: for `pip install`.
            constraints: the file for its `-c`; None for the newest versions.
            python: the interpreter.

        Raises:
            SystemExit: pip could not install them; its words are shown.
        """
        work = folder.with_name(f"{folder.name}-work")
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        environment = cls(folder, work)
        subprocess.run([python, "-m", "venv", "--clear", folder], check=True, env=clean())
        given = ["-c", str(constraints)] if constraints else []
        pip = environment.run("python", "-m", "pip", "install", "--quiet", *given, *requirements)
        if pip.returncode:
            sys.exit(f"pip could not install {requirements}:\n{pip.stdout}{pip.stderr}")
        return environment

    def run(self, program: str, *arguments: str, **more: str) -> subprocess.CompletedProcess[str]:
        """Run a program of the environment in its folder, as a user with an empty home would.

        Args:
            program: in the environment's bin.
            arguments: its words.
            more: variables of the process's environment.
        """
        command = [self.folder / "bin" / program, *arguments]
        variables = clean() | {"PATH": f"{self.folder / 'bin'}:{os.environ['PATH']}"} | more
        return subprocess.run(command, cwd=self.work, env=variables, capture_output=True, text=True)

    def installed(self) -> dict[str, tuple[str, int]]:
        """Version and bytes, compiled modules included, of what was installed beside pip, by its name."""
        found = json.loads(self.run("python", "-c", SIZES).stdout)
        return {name: tuple(found[name]) for name in sorted(found) if name not in OF_VENV}

    def remove(self) -> None:
        """Delete the environment and what its commands wrote."""
        shutil.rmtree(self.folder)
        shutil.rmtree(self.work)


def clean() -> dict[str, str]:
    """This process's variables without those that would let the repository's code or settings in."""
    kept = {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "JAX_", "XLA_", "GALTON"))
    }
    return kept | {"PIP_DISABLE_PIP_VERSION_CHECK": "1"}


def find_python(version: str) -> str | None:
    """The interpreter of a version such as 3.12: on the path, or pyenv's; None where there is none."""
    here = [shutil.which(f"python{version}")]
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    for found in [*here, *sorted(root.glob(f"{version}.*/bin/python"))]:
        if found and subprocess.run([found, "--version"], capture_output=True).returncode == 0:
            return str(found)
    return None
