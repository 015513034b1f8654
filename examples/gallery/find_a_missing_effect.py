"""
Find a missing effect
=====================

A fitted model leaves more than the noise. Which physical effect is missing? The laboratory refits every effect of
its catalogue together with the model, judges each on records that no fit has seen, and adds what improves them.

The records are simulated with an effect that is drawn at random and hidden. With records of your own, the
first line is ``data = rg.load("folder_of_records")``.
"""

import rdpi_gym as rg

data = rg.simulate("P5", hide="random", seed=18, ts_factor=4.0)
rg.fit(data, plays=5)

# %%
# The sensor's noise is 0.012 µm and the model leaves far more. What is it?

found = rg.discover(data, jobs=1)
print(found)
found.plot()

# %%
# Step by step
# ------------
# The error of each model on the way, in µm.

found.to_dataframe()

# %%
# Was it right?
# -------------
# Only a simulation has a truth to look at.

for effect in data.truth.hidden:
    print("hidden:", effect.name, effect.values)
for effect in found.plant.effects:
    print("found: ", effect.name, effect.values)

# %%
# Back and forth
# --------------
# Each result goes on: take the effect out again, or add another against the advice, and see the error before and
# after.

without = found.remove(found.plant.effects[0].name)
without.to_dataframe()[["model", "validation_rmse_um", "times_noise_floor"]]

# %%
# ``found.page("found.html")`` writes the page of ``rdpi discover`` with every figure, and ``found.plant`` is the
# model: ``rg.make_controller("extended-inverse", found)`` undoes what was found.
