"""The command line: a module for each command. What begins with an underscore is no command but helps several."""
