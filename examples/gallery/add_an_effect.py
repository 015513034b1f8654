"""
Add an effect of one's own
==========================

Nothing in the catalogue explains what is left, and you have a suspicion. Write it as one class, and let the records judge it
beside all others.

The example is self-heating: losses warm a stack while it moves fast, and it grows.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

import rdpi_gym as rg
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import Plant
from rdpi_gym.plant.effects import Effect, Parameter

# %%
# The kernel
# ----------
# What enters and leaves are arrays (time, lanes): the fit runs many plants side by side. State is NaN before the
# first sample.


@njit
def warm(x, u, p, state, ts, y):
    """Add a temperature that follows the squared rate of the command."""
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):  # no sample yet: cold, and at rest
            state[0, b], state[1, b] = u[0, b], 0.0
        for t in range(x.shape[0]):
            state[1, b] += p[1, b] * (p[0, b] * (u[t, b] - state[0, b]) ** 2 - state[1, b])
            state[0, b], y[t, b] = u[t, b], x[t, b] + state[1, b]


# %%
# The effect
# ----------
# It says about itself what a reader and a fit must know: parameters with physical bounds, equation, trace, experiment.


@dataclass(frozen=True)
class SelfHeating(Effect):
    """Displacement added by a temperature that follows the squared rate of the command."""

    rise_um: float = 0.2
    time_constant_s: float = 1.0
    name, slot, order = "self_heating", "output", 25
    parameters = (
        Parameter("rise_um", "µm", -10.0, 10.0, (0.05, 0.5), "rise d at 1000 V/s", neutral=0.0),
        Parameter("time_constant_s", "s", 0.01, 1e4, (0.2, 5.0), "time constant τ"),
    )
    equation = "y = y_m + θ, τ dθ/dt + θ = d (u̇ / 1000 V/s)²"
    signature = "A drift in fast stretches alone, which dies away after them."
    experiment, source = "A fast burst in a slow sine, then none.", "An example: estimated sizes."
    mistaken_for, block = ("thermal_drift", "creep"), staticmethod(warm)

    def coefficients(self, ts_s, hysteresis):
        """Return the column of ``p``."""
        return [self.rise_um / (1e3 * ts_s) ** 2, -np.expm1(-ts_s / self.time_constant_s)]

    def state_rows(self, ts_s):
        """Last command and temperature."""
        return 2


# %%
# Records to try it on
# --------------------
# Bursts in a slow sine, with 10 nm of noise. That the effect is found in them shows that the class works; whether it
# is *real* only measured records decide.

plant = replace(rg.plants["P5"], effects=(SelfHeating(rise_um=0.15, time_constant_s=0.8),))
ts_s, rng = 1e-3, np.random.default_rng(1)
t_s = np.arange(0.0, 5.0, ts_s)
bursts = {"first": (12.0, 25.0, 1.0), "second": (18.0, 12.0, 0.5), "validation": (15.0, 18.0, 2.0)}
records = []
for name, (amplitude_V, frequency_hz, start_s) in bursts.items():
    burst = amplitude_V * np.sin(2 * np.pi * frequency_hz * (t_s - start_s))
    u_V = 15.0 * np.sin(np.pi * t_s) + burst * ((t_s > start_s) & (t_s < start_s + 2.0))
    y_um = Plant(plant, ts_s).simulate(u_V) + 0.01 * rng.standard_normal(t_s.size)
    role = "validation" if name == "validation" else "train"
    records.append(Record(name, t_s, u_V, y_um, ts_s=ts_s, role=role))
data = Dataset("bursts", tuple(records))

# %%
# Judge it
# --------
# The new effect is one candidate among all of the catalogue. Without it the nearest relative takes a part of the
# error and is not renamed as the cause.

judged = rg.diagnose(data, effects=[SelfHeating], jobs=1)
judged.to_dataframe().head(4)[["candidate", "validation_rmse_um", "share", "confidence"]]

# %%
# Add it
# ------

added = rg.add(SelfHeating, data, rg.fit(data, plays=5), jobs=1)
print(added)
added.plot()

# %%
print(added.plant.effects[0].values)  # the records were made with 0.15 µm and 0.8 s

# %%
# In a file of its own the class is named as ``module:Class`` on the command line, or installed by an entry point, as
# ``examples/own_package`` does: then saved models find it by its name.
