"""
Train an agent
==============

A policy learns to move the command so that the stage follows, on plants that differ from episode to
episode. This is a first look of some seconds; :doc:`the page for it </docs/train-an-agent>` goes from
nothing to a policy that beats the compensators. It needs the extra ``rl`` (Stable-Baselines3, PyTorch).
"""

import matplotlib.pyplot as plt
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO

import rdpi_gym as rg
from rdpi_gym.envs.wrappers.history import VectorHistoryObservation
from rdpi_gym.envs.wrappers.stable_baselines import StableBaselinesVecEnv

torch.set_num_threads(1)  # a network this small only loses by more

# %%
# Sixty-four plants at once
# -------------------------
# Each lane draws its own weights, thresholds and rate law around P10. Actions are increments of the command:
# a network that knows nothing then moves the stage gently.


def lanes(num_envs):
    """Return plants side by side that show the last 8 samples, too."""
    vector = rg.environments.make_vector(
        "P10",
        num_envs,
        reference=["sine", "triangle"],
        frequency_hz=(20.0, 100.0),
        action="increment",
        randomise=0.05,
        max_episode_steps=250,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
    return VectorHistoryObservation(vector, history=8)


model = PPO(
    "MlpPolicy", StableBaselinesVecEnv(lanes(64)), n_steps=128, batch_size=1024, gamma=0.95,
    learning_rate=1e-3, device="cpu", seed=1,
)  # fmt: skip


# %%
# Train, and watch the error
# --------------------------
# On 32 plants and references that are not trained on, in µm.


def rms_um(policy):
    """RMS tracking error (µm) over an episode of each of 32 lanes."""
    held_out, errors_um = lanes(32), []
    observation, _ = held_out.reset(seed=1000)
    for _ in range(240):
        action, _ = policy.predict(observation, deterministic=True)
        observation, _, _, _, info = held_out.step(action)
        errors_um.append(info["error_um"])
    return np.sqrt(np.mean(np.square(errors_um)))


steps, errors_um = [0], [rms_um(model)]
for _ in range(4):
    model.learn(16_384, reset_num_timesteps=False)
    steps.append(model.num_timesteps)
    errors_um.append(rms_um(model))
for step, error_um in zip(steps, errors_um, strict=True):
    print(f"after {step:7,} steps: {error_um:6.2f} µm rms")

# %%
figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
axes.semilogy(steps, errors_um, "o-")
axes.set(xlabel="Steps of all plants together", ylabel="RMS error (µm)")

# %%
# From a terminal the same takes one command, which also keeps the best policy, goes on after an
# interruption, and compares with a compensator:
#
# .. code-block:: bash
#
#     rdpi train ppo --action increment --timesteps 1500000 --out results/agent
