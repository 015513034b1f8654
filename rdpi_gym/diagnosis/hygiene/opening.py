"""The beginning of a record whose history nobody recorded."""

from __future__ import annotations

import numpy as np

from rdpi_gym.diagnosis.features.half_cycles import half_cycles
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.diagnosis.features.periods import steady_periods
from rdpi_gym.diagnosis.hygiene.finding import BoolArray
from rdpi_gym.measurement import Record

# Of the swing: an extremum has been passed. The further ones count where the nearest is passed late.
_NEAR = (0.02, 0.1, 0.2)
# Of the record: what is left out never outweighs what a model is judged by. Where the last fiftieth
# of the swing comes later, memory of nine tenths of it is known long before.
_LONGEST = 0.5
_FEWEST = 16
_WIDE = 0.3  # of the widest swing: memory shows
_ALIKE_NOISE, _ALIKE = 2.0, 2e-3  # times the noise; of the stroke
_SEEN_NOISE, _SEEN = 3.0, 0.01  # half of the way between branches, where there is memory
_DEGREE = 5


def opening(record: Record) -> BoolArray | None:
    """Samples before the command has passed its extremes on both sides, where memory is unknown.

    Only plays that are wider than the swing go on from before, and they do not move. Where the
    extremes are passed late, most of the swing has to do: at most half of the record, and where even
    that comes later, at most the first cycle and a quarter of the record.
    """
    u = record.u_V
    swing = float(np.ptp(u))
    passed = [
        1 + max(int(np.argmax(u >= u.max() - near)), int(np.argmax(u <= u.min() + near)))
        for near in (share * swing for share in _NEAR)
    ]
    edges = half_cycles(u, record.ts_s).edges
    cycle = int(edges[3]) if edges.size > 3 else u.size
    early = min(passed[0], cycle, u.size // 4)
    last = max(early, next((end for end in passed if end <= _LONGEST * u.size), early))
    mask = np.zeros(u.size, dtype=np.bool_)
    mask[:last] = True
    kept = int((record.error_mask & ~mask).sum())
    if last < 3 or kept < _FEWEST or not (mask & record.error_mask).any():
        return None
    return mask


def begins_in_motion(record: Record, start: BoolArray, span_V: float) -> bool:
    """Whether a record shows that it begins in motion.

    Its periods are alike from the first one on although there is memory to be seen: the same
    command ran before. A record without periods shows nothing; a fit has to say.
    """
    u, y = record.u_V, record.y_um
    if float(np.ptp(u)) < _WIDE * span_V:
        return False
    periods = steady_periods(record, half_cycles(u, record.ts_s))
    if periods is None or periods.first > 0:
        return False
    commands, rows = periods.folded(u)[0], periods.folded(y)
    usual = rows[1:].mean(axis=0)
    noise = rough_part(y)
    # about the curve between the branches, a loop lies on the one side as the command rises
    degree = min(_DEGREE, np.unique(commands.round(9)).size - 1)
    single = np.polynomial.Polynomial.fit(commands, usual, degree)(commands)
    apart = (usual - single) * np.sign(np.gradient(commands))
    if abs(float(apart.mean())) < max(_SEEN_NOISE * noise, _SEEN * float(np.ptp(usual))):
        return False
    size = max(int(start.sum()), 3)
    differ = rows[0, :size] - usual[:size]
    allowed = max(_ALIKE_NOISE * noise, _ALIKE * float(np.ptp(usual)))
    return bool(np.sqrt(np.mean(differ**2)) < allowed)
