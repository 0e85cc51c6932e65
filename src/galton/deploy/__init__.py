"""A trained policy for where there is no Galton: an ONNX file with its contract, a model card, and the Hub.

A graph is put together in ONNX's words without ONNX (graph, actions, decision), then written
(policy_files). The card and the Hub need neither.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
