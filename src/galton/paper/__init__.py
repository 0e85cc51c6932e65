"""The paper, whole: what is trained, every figure, the claims, and the page that says what holds."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
