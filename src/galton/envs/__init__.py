"""The paper's analytic tasks in pure JAX. A new one is a file here and an entry in registry.ENVS."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
