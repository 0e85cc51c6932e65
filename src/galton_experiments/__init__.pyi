from . import analysis as analysis
from . import page as page
from . import runs as runs
from . import sweep as sweep
