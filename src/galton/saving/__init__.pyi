from .provenance import machine as machine
from .provenance import versions as versions
