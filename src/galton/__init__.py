"""Galton: policy gradients for continuous control, with classification in place of the hidden regression."""

import lazy_loader

from galton.envs.registry import register_with_gymnasium

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
register_with_gymnasium()
