from .engine import sweep as sweep
from .grid import expand as expand
from .grid import paper_grid as paper_grid
from .grid import task_defaults as task_defaults
from .study import Setting as Setting
from .study import Study as Study
