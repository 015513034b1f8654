"""The virtual laboratory: records of a plant with hidden effects, as `rdpi simulate` makes them.

What is hidden is simulated by :mod:`rdpi_gym.virtual_lab.independent`, never by the stages that are
fitted. :func:`hide` draws effects until each of them can be seen.
"""

from rdpi_gym.virtual_lab.dataset import Truth, simulate_dataset, write_dataset
from rdpi_gym.virtual_lab.draws import HIDEABLE, MaskedError, draw_effect, hide, hide_one

__all__ = [
    "HIDEABLE",
    "MaskedError",
    "Truth",
    "draw_effect",
    "hide",
    "hide_one",
    "simulate_dataset",
    "write_dataset",
]
