"""Eq. 6 without a rate: the loop of its delayed Ω alone, which needs g = S / a_0 below 1."""

from __future__ import annotations

from dataclasses import dataclass

from baselines.stability import inversion_free_polynomial, spectral_radius
from benchmarks.paper.cases import SECTION_V
from benchmarks.paper.readings import READINGS
from benchmarks.paper.tracking import Sine, Tracking, track
from rdpi_gym.plant import PAPER_IV_B, RDPI, named_plant


def identified_g() -> float:
    """Return g of the plant that was identified from the measured PICMA record."""
    return named_plant("picma").hysteresis.g


@dataclass(frozen=True)
class StaticRun:
    """Eq. 6 and the exact inverse on a plant without a rate, 80 Hz, 40 µm, 50 µs.

    Parameters
    ----------
    g
        S / a_0 of the plant, in plant and compensator.
    run
        Eq. 6 as printed.
    smooth
        The classical inverse, which is exact here: the command that Eq. 6 should find.
    """

    g: float
    run: Tracking
    smooth: Tracking

    @property
    def growth(self) -> float:
        """Factor by which a disturbance grows from sample to sample while all plays slide."""
        sine = self.run.sine
        return spectral_radius(inversion_free_polynomial(sine.hysteresis, sine.ts_s))

    @property
    def spikes(self) -> float:
        """Largest rate of the command over that of the exact inverse, median of the realisations."""
        return self.run.median_max_rate / self.smooth.max_rate


def static_plant(g: float) -> RDPI:
    """Return the plant of Section IV-B without its rate, its plays scaled to S / a_0 = `g`."""
    a0, *plays = PAPER_IV_B.weights
    scaled = (a * g / PAPER_IV_B.g for a in plays)
    return RDPI((a0, *scaled), PAPER_IV_B.thresholds_V, 0.0)


def static_runs(lanes: int, seed: int) -> tuple[StaticRun, ...]:
    """Run Eq. 6 on static plants of several g."""
    found = []
    for g in (0.9, identified_g(), 2.0):
        sine = Sine(
            f"P10-static, g = {g:.3g}",
            static_plant(g),
            SECTION_V.amplitude_um,
            SECTION_V.frequency_hz,
            SECTION_V.ts_s,
        )
        literal = track(READINGS["literal"], sine, lanes, seed)
        exact = track(READINGS["closed-form same thresholds"], sine, 1, seed)
        found.append(StaticRun(g, literal, exact))
    return tuple(found)
