from rdpi_gym import signals as signals
from rdpi_gym.face import *  # noqa: F403
from rdpi_gym.laboratory.opening import OpenLab as OpenLab
from rdpi_gym.laboratory.opening import lab as lab
from rdpi_gym.support.errors import InputError as InputError

__version__: str
