from .acrobot import Acrobot as Acrobot
from .bandit import Bandit as Bandit
from .base import Environment as Environment
from .find import find as find
from .lqr import LQR as LQR
from .mountain_car import MountainCar as MountainCar
from .registry import ENVS as ENVS
from .registry import make as make
