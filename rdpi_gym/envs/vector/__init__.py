"""The vector environment: thousands of plants, one kernel."""

from rdpi_gym.envs.vector.environment import PiezoTrackingVectorEnv

__all__ = ["PiezoTrackingVectorEnv"]
