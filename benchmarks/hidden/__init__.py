"""Plants with hidden effects: their truth, their records, and the study of who finds them.

What is hidden is simulated by :mod:`benchmarks.independent`, never by the stages that are fitted.
"""

from benchmarks.hidden.dataset import simulate_dataset, write_dataset
from benchmarks.hidden.draws import HIDEABLE, hide, hide_one
from benchmarks.hidden.truth import Truth

__all__ = ["HIDEABLE", "Truth", "hide", "hide_one", "simulate_dataset", "write_dataset"]
