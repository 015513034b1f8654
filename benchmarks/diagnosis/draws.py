"""Plants of the benchmark: those of the studies of hidden and of foreign effects, mixed."""

from __future__ import annotations

from functools import cache

import numpy as np

from benchmarks.effect_discovery.cases import Case, Source
from benchmarks.effect_discovery.foreign import FOREIGN
from benchmarks.effect_discovery.independent import INDEPENDENT

_ORDER = 20_261_125  # of the cases, the same for every seed
_STUDIES = ("single", "pairs", "none", "outside")


@cache
def drawn_cases(seed: int) -> tuple[tuple[Source, Case], ...]:
    """Return all plants of a seed, in an order of which any beginning is a fair sample."""
    foreign = FOREIGN.cases(list(FOREIGN.numbers), None, seed, FOREIGN.effects)
    hidden = INDEPENDENT.cases(_STUDIES, None, seed, INDEPENDENT.effects)
    cases = [*((FOREIGN, case) for case in foreign), *((INDEPENDENT, case) for case in hidden)]
    order = np.random.default_rng(_ORDER).permutation(len(cases))
    return tuple(cases[k] for k in order)
