"""The plant on torch tensors, made from its kernels: differentiable through time.

Needs torch (the extra ``rl``); nothing imports this room at start-up.
"""

from rdpi_gym.torch_plant.plant import TorchPlant

__all__ = ["TorchPlant"]
