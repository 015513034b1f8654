"""Figures and numbers of the paper as cases to simulate."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from benchmarks.paper.tracking import READINGS, Reading, Sine
from rdpi_gym.plant import PAPER_III_B, PAPER_IV_B

TS_S = (1e-3, 1e-4, 1e-6)
"""Sampling times of Section III-B (s)."""
FREQUENCIES_HZ = (1.0, 25.0, 50.0)
"""Frequencies of Section III-B (Hz)."""
BOUND_UM = 3.0
"""Section V: the error is "bounded within 3 µm"."""
TABLE_TS_S = (1e-3, 1e-4, 1e-5, 1e-6)
LOOP_SAMPLES = 400
"""Section IV-B: data points K of a loop."""

SWEEP_LABEL = "Section III-A, error against Ts"

COMPENSATORS = tuple(r for r in READINGS.values() if r.structure != "none")
INVERSION_FREE = tuple(r for r in COMPENSATORS if r.structure == "inversion-free")


class Claim(Enum):
    """Claim of the paper on a case."""

    LOOP = "the hysteresis loop widens with the frequency"
    SMALLER_TS = "reducing the sampling time improves the compensation: e(k) → 0"
    SMALLER_TS_PAIR = "the output at Ts = 1e-4 s follows the reference better than at 1e-3 s"
    COMPLETE = "complete compensation at Ts = 1e-6 s"
    BOUND = "the error is bounded within 3 µm"


@dataclass(frozen=True)
class Case:
    """One simulation that stands for a panel or a number of the paper."""

    label: str  # figure or section
    claim: Claim  # what the paper says of it
    # what is simulated
    reading: Reading
    sine: Sine
    paper_value: float | None = None  # the number in the paper's text, where it has one


def section_iii(frequency_hz: float, ts_s: float) -> Sine:
    """Return the reference of Section III-B: amplitude 10 on the five-play model."""
    return Sine("P5", PAPER_III_B, 10.0, frequency_hz, ts_s)


SECTION_V = Sine("P10", PAPER_IV_B, 40.0, 80.0, 5e-5)
"""Reference of Section V: 40 µm, 80 Hz, 50 µs."""

# Fig. 7 prints no drive; its loops are those of a 40 V sine, K = 400 samples each.
FIG_7 = tuple(Sine("P10", PAPER_IV_B, 40.0, hz, 1.0 / (LOOP_SAMPLES * hz)) for hz in (10.0, 100.0))

SWEEP = tuple(
    section_iii(50.0, 1.0 / (50.0 * m)) for m in np.rint(np.geomspace(20, 20_000, 22)).tolist()
)
"""Sampling times between those of the paper, 50 Hz."""


def paper_cases() -> tuple[Case, ...]:
    """Return every simulated case, in the order of the paper."""
    none = READINGS["none"]
    cases = [
        Case(f"Fig. 3{panel}", Claim.LOOP, none, section_iii(hz, TS_S[0]))
        for panel, hz in zip("abc", FREQUENCIES_HZ, strict=True)
    ]
    cases += [
        Case(f"Fig. 3{panel}", Claim.SMALLER_TS, reading, section_iii(hz, ts_s))
        for panel, hz in zip("def", FREQUENCIES_HZ, strict=True)
        for reading in INVERSION_FREE
        for ts_s in TS_S
    ]
    cases += [
        Case(f"Fig. 4{panel}", Claim.SMALLER_TS_PAIR, reading, section_iii(50.0, ts_s))
        for reading in INVERSION_FREE
        for panel, ts_s in zip("ab", TS_S[:2], strict=True)
    ]
    cases += [
        Case(f"Fig. 5{panel}", Claim.COMPLETE, reading, section_iii(hz, TS_S[-1]))
        for panel, hz in zip("abc", FREQUENCIES_HZ, strict=True)
        for reading in INVERSION_FREE
    ]
    cases += [
        Case(SWEEP_LABEL, Claim.SMALLER_TS, reading, section_iii(50.0, ts_s))
        for reading in READINGS.values()
        for ts_s in TABLE_TS_S
    ]
    cases += [Case("Fig. 7", Claim.LOOP, none, sine) for sine in FIG_7]
    cases.append(Case("Section V, no compensation", Claim.BOUND, none, SECTION_V))
    cases += [
        Case(
            "Fig. 8b" if reading.structure == "closed-form" else "Fig. 8a",
            Claim.BOUND,
            reading,
            SECTION_V,
            BOUND_UM,
        )
        for reading in COMPENSATORS
    ]
    return tuple(cases)
