"""How files of Galton's are written and read: whole or not at all, and with what made them.

`checkpoint` has settings and arrays in one file, `model_file` says which of them make a model, `files` and
`result_folder` write files and folders whole, and `provenance` tells versions, machine and commit.
"""
