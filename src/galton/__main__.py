"""The galton command for `python -m galton`, which is the same as `galton`."""

import sys

from galton.cli.main import main

if not sys.flags.safe_path:
    sys.path.pop(0)  # the current folder, which `galton` does not search either (see galton.cli._reading)
main()
