"""Environments: the contract in pure JAX, the paper's four analytic tasks, names for all, and host/ for the rest.

A new task in pure JAX is a file here and an entry in registry.ENVS.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
