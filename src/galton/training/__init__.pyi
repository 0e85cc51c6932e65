from . import rollout as rollout
from .log import MEAN_ACTION_RETURN as MEAN_ACTION_RETURN
from .population import Population as Population
from .population import populate as populate
from .train import final as final
