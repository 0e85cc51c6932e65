"""The command line: `main`, and beside it a module for each command of one run.

What begins with an underscore is no command but helps several. The commands of many runs are in `galton_experiments`.
"""
