"""Looks the pinned versions of constraints.txt up in a database of known vulnerabilities, with pip-audit.

It fails for a finding that EXPLAINED does not have, and for a package that the database could not be asked about:
pip-audit itself passes over those.

    python tools/audit.py [--service pypi] [--out results/packaging]
"""

import argparse
import datetime
import json
import subprocess
import sys
from pathlib import Path

import builds

EXPLAINED: dict[str, str] = {}
"""The reason why a finding does not touch Galton's users, by its id; CONTRIBUTING.md has the same words."""


def main() -> None:
    """Ask about every pinned package, print what was found, and keep it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--service", choices=["pypi", "osv", "esms"], default="pypi", help="the database")
    parser.add_argument("--out", type=Path, default=builds.ROOT / "results" / "packaging")
    options = parser.parse_args()
    pinned = str(builds.ROOT / "constraints.txt")
    command = ["pip_audit", "-r", pinned, "--no-deps", "--disable-pip", "--format", "json", "--progress-spinner", "off"]
    done = subprocess.run(
        [sys.executable, "-m", *command, "--vulnerability-service", options.service], capture_output=True, text=True
    )
    if not done.stdout:
        sys.exit(f"the database {options.service} can't be asked: {done.stderr.strip().splitlines()[-1]}")
    packages = json.loads(done.stdout)["dependencies"]
    unknown = [one["name"] for one in packages if "skip_reason" in one]
    findings = {vuln["id"]: one["name"] for one in packages for vuln in one.get("vulns", [])}
    options.out.mkdir(parents=True, exist_ok=True)
    record = {
        "on": datetime.date.today().isoformat(),
        "packages": len(packages),
        "not looked up": len(unknown),
        "findings": findings,
    }
    (options.out / "audit.json").write_text(json.dumps(record, indent=1) + "\n")
    print(f"{len(packages) - len(unknown)} of {len(packages)} pinned packages looked up, {len(findings)} findings")
    new = {name: package for name, package in findings.items() if name not in EXPLAINED}
    if new:
        sys.exit(f"not explained: {', '.join(f'{name} in {package}' for name, package in new.items())}")
    if len(unknown) == len(packages):
        sys.exit(f"the database {options.service} knows none of them: it can't be reached through this package index")
    if unknown:
        sys.exit(f"the database {options.service} does not know {', '.join(unknown)}")


if __name__ == "__main__":
    main()
