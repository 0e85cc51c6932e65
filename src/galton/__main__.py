"""The galton command for `python -m galton`, which is the same as `galton`."""

from galton.cli.main import main

main()
