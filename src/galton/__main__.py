"""`python -m galton`."""

from galton.cli.main import main

main()
