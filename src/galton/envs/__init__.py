"""Environments: the contract in pure JAX (base), the paper's four analytic tasks, and host/ for all that is not JAX.

`find` makes a task of whatever a user gives: a name in registry.ENVS, a Gymnasium id, an environment, a record.
`as_gymnasium` shows our own tasks to Gymnasium. A new task in pure JAX is a file here and an entry in registry.ENVS.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
