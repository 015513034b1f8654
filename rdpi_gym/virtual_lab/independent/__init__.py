"""An independent formulation of the plant and its effects, for hidden truths.

Nothing here is shared with the models that are fitted: plays are written as stop operators, the
mechanics and the electronics as differential equations, creep as a continuous spectrum, the delay
as a shift, all on a time grid of 10 µs or finer. A file states in ``TWINS`` which effects it
formulates; a new one is found without a list.
"""

from rdpi_gym.virtual_lab.independent.simulation import LARGEST_STEP_S, simulate_truth
from rdpi_gym.virtual_lab.independent.twin import Grid, MaterialTwin, Mechanism, Twin, twins

__all__ = [
    "LARGEST_STEP_S",
    "Grid",
    "MaterialTwin",
    "Mechanism",
    "Twin",
    "simulate_truth",
    "twins",
]
