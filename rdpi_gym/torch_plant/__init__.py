"""The batched plant and its tracking step in torch: one code for CPU and CUDA tensors.

Needs torch (the extra ``rl``); nothing imports this room at start-up.
"""

from rdpi_gym.torch_plant.episodes import TorchEpisodes
from rdpi_gym.torch_plant.hysteresis import RDPITensors
from rdpi_gym.torch_plant.plant import TorchPlant
from rdpi_gym.torch_plant.tracking import TorchTracking

__all__ = ["RDPITensors", "TorchEpisodes", "TorchPlant", "TorchTracking"]
