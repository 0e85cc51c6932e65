"""The command line: `main`, and beside it a module for each command that it knows, or a folder (sweep).

What begins with an underscore is no command but helps several.
"""
