"""Galton's files are written and read whole or not at all, and with what made them.

`checkpoint` has settings and arrays in one file, `model_file` says which of them make a model, `files` and
`result_folder` write files and folders whole, and `provenance` tells versions, machine and commit.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
