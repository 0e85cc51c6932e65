from . import analysis as analysis
from . import page as page
from . import sweep as sweep
