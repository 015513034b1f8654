"""
Score a controller
==================

A controller of your own beside those that ship, in micrometres. Anything with ``predict`` is one.

This one divides the reference by the plant's static gain: it knows nothing of hysteresis.
"""

import matplotlib.pyplot as plt
import numpy as np

import rdpi_gym as rg


class Proportional:
    """Divides the reference by the static gain of the plant that it believes in."""

    def __init__(self, belief, layout):
        self.gain_um_V, self.layout = belief.hysteresis.A, layout

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        """Answer the reference's next sample."""
        command_V = self.layout.reference_um(observation)[..., 1] / self.gain_um_V
        return self.layout.action_for(command_V, observation), state


# %%
# One episode
# -----------
# A sine of 50 Hz and 40 µm on the paper's plant with ten play operators, sampled every 0.1 ms. The
# action is the command's place in its range; ``info`` has everything in µm and V.

env = rg.environments.make("P10", reference="sine", frequency_hz=50.0, max_episode_steps=800)


def follow(controller):
    """Return the tracking error (µm) of an episode."""
    observation, _ = env.reset(seed=0)
    state, errors_um, over = None, [], False
    while not over:
        action, state = controller.predict(observation, state, deterministic=True)
        observation, _, _, over, info = env.step(action)
        errors_um.append(info["error_um"])
    return np.array(errors_um)


layout = env.unwrapped.layout
contestants = {"proportional (mine)": Proportional(rg.plants["P10"], layout)}
for name in ("classical-reference-rate", "pi-classical-reference-rate"):
    contestants[name] = rg.make_controller(name, "P10", layout)
errors_um = {name: follow(controller) for name, controller in contestants.items()}
for name, error_um in errors_um.items():
    # the first period brings the plant from rest onto its loop
    settled = error_um[200:]
    print(
        f"{name:30} {np.sqrt(np.mean(settled**2)):6.3f} µm rms, {abs(settled).max():6.3f} µm largest"
    )

# %%
# What is left is the hysteresis: without compensation the error has the shape of the loop.

figure, axes = plt.subplots(figsize=(9, 3.6), layout="constrained")
for name, error_um in errors_um.items():
    axes.plot(1e3 * layout.ts_s * np.arange(1, len(error_um) + 1), error_um, label=name)
axes.set(xlabel="Time (ms)", ylabel="Tracking error (µm)")
axes.legend()

# %%
# The whole benchmark
# -------------------
# One case is an anecdote. In a file of its own, say ``my_controllers.py``, the same class is scored on all
# references, plants and sampling times, on truths that differ from the belief:
#
# .. code-block:: bash
#
#     rdpi bench --controller my_controllers:Proportional --out results/mine
