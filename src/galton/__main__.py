"""`python -m galton`."""

from galton.cli import main

main()
