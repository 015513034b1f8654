"""From a blank file to a scored compensator on a discovered plant: twelve lines, one import."""

import rdpi_gym as rg

data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)  # or rg.load("measurement.csv")
data = data.select("stairs", "sine-50hz", "validation-stairs", "quiet")  # a few records are quick
print(data)
found = rg.discover(data)
print(found)
layout = rg.environments.layout(found, ts_s=2e-4)
compensator = rg.make_controller("extended-inverse", found, layout)
print(compensator.predict([0.0] * layout.size)[0])
scores = rg.benchmark(["none", "extended-inverse"], [found], ["sine"], [2e-4], seeds=2)
print(scores)
scores.page("results/twelve_lines.html")
