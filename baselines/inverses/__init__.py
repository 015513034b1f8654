"""Inverses of the effects that have a stable one, one effect a file.

Effects in slot ``rate`` are not inverted but followed, ``congruency`` is inverted together with the
plays (:mod:`baselines.inverses.chain`), and ``initial_memory`` is set at the start.
"""

from baselines.inverses.base import INVERSES, Inverse, Setting, inverse_of
from baselines.inverses.chain import Inverses, inverses_of

__all__ = ["INVERSES", "Inverse", "Inverses", "Setting", "inverse_of", "inverses_of"]
