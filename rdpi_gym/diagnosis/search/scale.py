"""What records are large enough for: loops of one size, and the comb that a search begins with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.features.half_cycles import half_cycles, vary
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.plant import RDPI


def one_size(records: Sequence[Record]) -> bool:
    """Whether loops of one size are all that records hold: they do not tell weights apart."""
    cycles = [half_cycles(r.u_V, r.ts_s) for r in records]
    sizes = np.concatenate([c.amplitude_V[c.whole] for c in cycles])
    return bool(sizes.size) and not vary(sizes)


def comb(records: Sequence[Record]) -> RDPI:
    """Return the RDPI model on the fine fixed comb of a search, to be fitted: convex in its weights."""
    return RDPI.comb(data_scale(records))
