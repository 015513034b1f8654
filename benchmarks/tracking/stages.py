"""Plants and references as they are scored: truth and belief, sampling times, identified rates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from benchmarks.tracking import references as folder
from benchmarks.tracking.case import Case, References
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.truth import limit_band, randomise_plant
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.plugins import modules_of

SUITE_VERSION = 2
SEEDS = 5
TS_S = (5e-5, 1e-4, 2e-4, 1e-3)
"""Sampling times (s) of a plant that was identified at rates like those of references about 10 Hz."""
SLOW_TS_S = (1e-3, 5e-3)
"""Those (s) of a plant that was identified only at lower rates; references are about 1 Hz there."""


def _found() -> References:
    stated = [module.REFERENCES for module in modules_of(folder.__name__)]
    return MappingProxyType({name: make for each in stated for name, make in each.items()})


REFERENCES = _found()
"""Makers of a reference's cases, by its name."""


def cases(references: Sequence[str], amplitude_um: float, base_hz: float) -> tuple[Case, ...]:
    """Build the cases of some references."""
    return tuple(case for name in references for case in REFERENCES[name](amplitude_um, base_hz))


NOISE_UM = 0.010
"""Sensor noise (µm, one standard deviation) of a plant that states none."""
SPREAD = 0.05
"""Relative half-width of the uniform draw of every parameter of the truth."""
COVERED = 1.5
"""Command rates up to this factor above the identified ones count as covered by them."""


@dataclass(frozen=True)
class Stage:
    """A plant as it is scored, its sampling times, and the references' base frequency."""

    # the nominal truth: the plant with its rate band-limited and a noisy sensor
    plant: PlantModel
    ts_s: tuple[float, ...]  # sampling times (s) that the ranking is taken over
    base_hz: float  # what the frequencies of all references but the sines are multiples of (Hz)
    # further sampling times (s), at which trained policies run: they have a ranking of their
    # own
    trained_ts_s: tuple[float, ...] = ()
    # what controllers are told of the plant; None: the plant itself
    believed: PlantModel | None = None

    @property
    def every_ts_s(self) -> tuple[float, ...]:
        """All sampling times (s), shortest first."""
        return tuple(sorted({*self.ts_s, *self.trained_ts_s}))

    def suits(self, ts_s: float) -> bool:
        """Whether a sampling time (s) lies between the shortest and the longest of the plant."""
        return min(self.ts_s) * (1 - 1e-9) <= ts_s <= max(self.ts_s) * (1 + 1e-9)

    @property
    def belief(self) -> PlantModel:
        """Belief that every controller is told, with all effects, as where it tracks or is exported."""
        return self.plant if self.believed is None else self.believed

    def has_core(self, kind: type[Core] | None) -> bool:
        """Whether the belief has that kind of hysteresis core; None: any."""
        return kind is None or isinstance(self.belief.hysteresis, kind)

    def layout(self, ts_s: float, controller: object) -> ObservationLayout:
        """Show as much of the reference ahead as a controller says that it makes use of."""
        usual = ObservationLayout.for_plant(self.plant, ts_s)
        return replace(usual, preview=max(usual.preview, getattr(controller, "needed_preview", 1)))

    @property
    def shown_ts_s(self) -> float:
        """The one sampling time (s) of which traces and detailed tables are shown: the shortest."""
        return min(self.ts_s)

    @property
    def rest_um(self) -> float:
        """Displacement (µm) at rest at the command nearest 0 V of the range."""
        low, high = self.plant.command_range_V
        rest_V = min(max(0.0, low), high)
        plant = Plant(replace(self.plant, effects=()), ts_s=1e-3)
        plant.reset(u0_V=rest_V)
        return float(plant.simulate(np.array([rest_V]))[0])

    def cases(self, references: Sequence[str], ts_s: float) -> tuple[Case, ...]:
        """Return the cases that suit Ts (s)."""
        every = cases(references, self.plant.reference_um[1], self.base_hz)
        return tuple(case for case in every if case.fits(ts_s))

    def references(self, lanes: Sequence[tuple[Case, int]], ts_s: float, ahead: int = 0) -> Array:
        """Return the references (µm) of cases and seeds side by side, ``(K, B)``, held at their end.

        With samples `ahead` each goes on for as many: where it ended it would be held, a corner.
        """
        length = max(case.window(ts_s)[1] for case, _ in lanes) + ahead
        columns = []
        for case, seed in lanes:
            longer = replace(case, periods=case.periods + 1) if ahead else case
            r = longer.samples(ts_s, self.plant.reference_um[0], self.rest_um, seed)[:length]
            columns.append(np.pad(r, (0, length - len(r)), mode="edge"))
        return np.stack(columns, axis=1)

    def covers(self, case: Case, ts_s: float) -> bool:
        """Whether the plant was identified at rates like those of a reference over A.

        A plant that says nothing of its identification covers everything.
        """
        known = largest_rate_V_s(self.plant)
        if known is None:
            return True
        r = case.samples(ts_s, self.plant.reference_um[0], self.rest_um, seed=0)
        steps = np.abs(np.diff(r[case.window(ts_s)[0] - 1 :]))
        return bool(steps.max() <= COVERED * known * ts_s * self.plant.hysteresis.A)


def make_stage(
    plant: PlantModel,
    ts_s: Sequence[float] | None = None,
    believed: PlantModel | None = None,
) -> Stage:
    """Prepare a plant for scoring."""
    sensor = plant.sensor if plant.sensor.noise_um else replace(plant.sensor, noise_um=NOISE_UM)
    scored = replace(limit_band(plant), sensor=sensor)
    slow = _triangle_rate_V_s(plant, 10.0) > (largest_rate_V_s(plant) or math.inf)
    usual = SLOW_TS_S if slow else TS_S
    belief = None if believed is None else limit_band(believed)
    times = usual if ts_s is None else tuple(ts_s)
    return Stage(scored, times, 1.0 if slow else 10.0, believed=belief)


def largest_rate_V_s(plant: PlantModel) -> float | None:
    """Largest command rate (V/s) that the plant was identified at; None where it says nothing."""
    rate = plant.identification.get("fastest_peak_rate_V_s")
    return float(rate) if isinstance(rate, int | float) else None


def _triangle_rate_V_s(plant: PlantModel, frequency_hz: float) -> float:
    return 4.0 * frequency_hz * plant.reference_um[1] / plant.hysteresis.A


def truth(plant: PlantModel, seed: int) -> PlantModel:
    """Draw the plant that a seed scores on: seed 0 is the nominal plant itself.

    Every gain, every gap between thresholds and every number of the shape of its hysteresis core is
    multiplied by its own factor, uniform within 1 ± :data:`SPREAD`; see
    :func:`rdpi_gym.envs.truth.randomise_plant`.
    """
    if seed == 0:
        return plant
    return randomise_plant(plant, SPREAD, np.random.default_rng([seed, 1]))
