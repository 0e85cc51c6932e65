"""The subcommands of galton: a module each with `main(arguments)`."""
