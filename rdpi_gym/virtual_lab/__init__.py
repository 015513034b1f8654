"""Plants with hidden effects: their truth, their records, and the study of who finds them.

What is hidden is simulated by :mod:`rdpi_gym.virtual_lab.independent`, never by the stages that are fitted.
"""

from rdpi_gym.virtual_lab.dataset import simulate_dataset, write_dataset
from rdpi_gym.virtual_lab.draws import HIDEABLE, hide, hide_one
from rdpi_gym.virtual_lab.truth import Truth

__all__ = ["HIDEABLE", "Truth", "hide", "hide_one", "simulate_dataset", "write_dataset"]
