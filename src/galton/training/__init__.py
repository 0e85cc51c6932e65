"""From an agent and an environment to trained runs.

`train` trains many runs side by side. Below it stand a population, on environments in JAX (on_device, rollout) or
outside JAX (on_host, host_group, host_programs); what one run is (run); its evaluation (evaluate); and what is recorded
of it (log, diagnosis).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
