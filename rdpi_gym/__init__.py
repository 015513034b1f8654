"""Piezo micro- and nano-positioning under hysteresis."""

from gymnasium.envs.registration import register

register(
    id="rdpi_gym/PiezoTracking-v0",
    entry_point="rdpi_gym.envs.piezo_tracking:PiezoTrackingEnv",
    vector_entry_point="rdpi_gym.envs.vector:PiezoTrackingVectorEnv",
    max_episode_steps=2000,
)
