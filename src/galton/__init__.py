"""Galton: policy gradients for continuous control, with classification in place of the hidden regression."""

import lazy_loader

from galton.envs.registry import register_with_gymnasium

__getattr__, __dir__, _ = lazy_loader.attach_stub(__name__, __file__)
__all__ = [
    "A2C",
    "PPO",
    "Agent",
    "Bins",
    "Model",
    "Result",
    "UsageError",
    "__version__",
    "algorithms",
    "callbacks",
    "check_env",
    "critics",
    "deploy",
    "envs",
    "errors",
    "losses",
    "make_agent",
    "networks",
    "optimizers",
    "policies",
    "presets",
    "schedules",
    "train",
    "use_all_cores",
]
"""The names to begin with. The stub beside this file has every public name, those of earlier versions too."""
register_with_gymnasium()
