"""The Chromium that the page is tested in. As a program: finds one, or else installs one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
INSTALL = [sys.executable, "-m", "playwright", "install", "chromium"]
APT = ["sh", "-c", "apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium"]
MISSING = (
    "The page is tested in a browser, and there is none: install Chromium or Chrome, "
    "or say where one is with CHROMIUM=/path/to/chromium"
)


def find() -> str | None:
    """What CHROMIUM names, else a browser on PATH, else Playwright's own, if that has been installed."""
    on_path = map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
    if found := os.environ.get("CHROMIUM") or next(filter(None, on_path), None):
        return found
    with sync_playwright() as playwright:
        own = playwright.chromium.executable_path
    return own if Path(own).exists() else None


def starts(path: str | None) -> bool:
    """Whether it is there and lacks no library."""
    if path is None or shutil.which(path) is None:
        return False
    return subprocess.run([path, "--version"], capture_output=True, timeout=60).returncode == 0


def main() -> None:
    """Leave a browser that `find` finds, or stop with a sentence."""
    attempts = [INSTALL]
    if os.geteuid() == 0 and shutil.which("apt-get"):
        attempts.append(APT)
    if not os.environ.get("CHROMIUM"):
        for command in attempts:
            if starts(find()):
                break
            subprocess.run(command)
    if not starts(find()):
        raise SystemExit(MISSING)


if __name__ == "__main__":
    main()
