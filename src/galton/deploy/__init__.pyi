from .actions import ACTIONS as ACTIONS
from .actions import Chosen as Chosen
from .bodies import BODIES as BODIES
from .graph import Graph as Graph
from .policy_files import export as export
