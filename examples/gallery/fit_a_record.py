"""
Fit a record
============

How well does the rate-dependent Prandtl-Ishlinskii (RDPI) model describe a stage, and where does it
fail? Three calls: load, fit, compare.

The records are measured ones that ship: a PICMA stack in a flexure, 1 Hz sines to fit and nested
loops to validate on. With records of your own, the first line is ``data = rg.load("run.csv")``.
"""

import rdpi_gym as rg

data = rg.example("picma")
data

# %%
# Fit
# ---
# Weights, thresholds and the rate law are found by Equations 9 and 10 of the paper, with an offset
# for each record. The answer comes first: the error on records that the fit has not seen.

model = rg.fit(data, plays=10)
model

# %%
# Every parameter has an interval. Where it reaches zero, the records do not determine that weight;
# their sum is known far better than each of them.

model.to_dataframe().head(6)

# %%
# Compare
# -------
# The error is more than the noise: the model misses something, and the lines below say where.

comparison = rg.compare(data, model)
print(comparison)
comparison.plot()

# %%
# The same as a page with interactive figures: ``comparison.page("compare.html")``. The model goes
# on as a plant, for example into a compensator:

controller = rg.make_controller("classical-reference-rate", model)
print(type(controller).__name__, "for", model.plant.name)
