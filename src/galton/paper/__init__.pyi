from .figure import FigureStudy as FigureStudy
from .registry import FIGURES as FIGURES
from .sweeps import Sweep as Sweep
from .verdicts import claim as claim
