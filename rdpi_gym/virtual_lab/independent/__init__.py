"""An independent formulation of the plant and its effects, for hidden truths.

Nothing here is shared with the models that are fitted: plays are written as stop operators, the
mechanics and the electronics as differential equations, creep as a continuous spectrum, the delay
as a shift, all on a time grid of 10 µs or finer.
"""

from rdpi_gym.virtual_lab.independent.simulation import simulate_truth

__all__ = ["simulate_truth"]
