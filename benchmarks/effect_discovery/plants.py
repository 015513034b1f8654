"""The hysteresis of a foreign plant: unlike thresholds and weights, or a density of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.effect_discovery.protocols import Experiment
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.support.arrays import Array

_DENSE = 120  # plays that stand for a continuous density
_FEWER = 20  # plays of the model about which visibility is judged
_RATED_SHARE = 0.45
_FIRST_NOISE = (1.0e-4, 2.5e-4)  # of peak to peak: the first study's
_TIMES = 10.0


@dataclass(frozen=True, eq=False)
class Foreign:
    """A plant without what is hidden in it."""

    a0_um_V: float  # gain without plays (µm/V)
    # float64[n]: Of the plays (V, µm/V)
    thresholds_V: Array
    weights: Array
    delta2_s: float  # growth of the thresholds with the rate (s)
    # range that is used
    centre_V: float
    span_V: float
    stroke_um: float  # half of the displacement over that range
    noise_um: float  # of the sensor (rms)
    colour: float  # correlation of the noise from sample to sample

    @property
    def gain_um_V(self) -> float:
        """Gain while every play slides."""
        return self.a0_um_V + float(self.weights.sum())

    def model(self) -> PlantModel:
        """Return a plant of the package that is like it, a density in few plays."""
        thresholds, weights = self.thresholds_V, self.weights
        if thresholds.size == _DENSE:
            groups = np.array_split(np.arange(_DENSE), _FEWER)
            thresholds = np.array([thresholds[g].mean() for g in groups])
            weights = np.array([weights[g].sum() for g in groups])
        hysteresis = RDPI(
            (self.a0_um_V, *weights.tolist()), tuple(thresholds.tolist()), self.delta2_s
        )
        return PlantModel(
            hysteresis, "foreign", (self.centre_V - self.span_V, self.centre_V + self.span_V),
            (self.gain_um_V * self.centre_V, self.stroke_um),
        )  # fmt: skip


def fastest_rate_V_s(experiment: Experiment) -> float:
    """Rate of the command that one sample in a hundred exceeds, of its fastest record (V/s)."""
    fastest = 0.0
    for drive in experiment.drives:
        changes = np.abs(np.diff(drive.command_V))
        usual = float(np.quantile(changes, 0.99)) or float(changes.max())
        fastest = max(fastest, usual / drive.ts_s)
    return fastest


def draw_plant(
    experiment: Experiment, rng: np.random.Generator, rated: bool | None = None
) -> Foreign:
    """Draw a plant to suit an experiment."""
    span, kind = experiment.span_V, rng.random()
    reach = span * rng.uniform(0.3, 0.9)
    n = _DENSE if kind < 0.25 else int(rng.integers(6, 26))
    if kind < 0.25:
        thresholds = reach * (np.arange(n) + 0.5) / n
        shape = np.exp(-thresholds / (reach * rng.uniform(0.2, 1.0)))
    else:
        thresholds = np.sort(reach * rng.uniform(0.01, 1.0, n) ** rng.uniform(1.0, 2.0))
        thresholds = np.maximum.accumulate(thresholds + 1e-3 * reach * np.arange(1, n + 1) / n)
        shape = rng.uniform(0.75, 1.0) ** np.arange(n) * np.exp(rng.normal(0.0, 0.3, n))
    share = rng.uniform(0.25, 0.9)
    stroke = 0.5 * float(np.exp(rng.uniform(np.log(1.0), np.log(100.0))))
    a0 = stroke / span / (1.0 + 0.6 * share)
    weights = a0 * share * shape / shape.sum()
    is_rated = bool(rng.random() < _RATED_SHARE)
    growth = rng.uniform(0.02, 0.25) * reach / max(fastest_rate_V_s(experiment), 1e-9)
    noise = 2.0 * stroke * rng.uniform(*_FIRST_NOISE) * _TIMES ** rng.uniform()
    colour = float(rng.uniform(0.1, 0.5)) if rng.random() < 0.3 else 0.0
    return Foreign(
        a0, thresholds, weights, growth if (is_rated if rated is None else rated) else 0.0,
        experiment.centre_V, span, stroke, noise, colour,
    )  # fmt: skip


def noise_of(plant: Foreign, samples: int, rng: np.random.Generator) -> Array:
    """Noise of the sensor (µm): white, or of first order, with the plant's rms."""
    from scipy.signal import lfilter

    white = rng.normal(0.0, plant.noise_um, samples)
    if plant.colour == 0.0:
        return white
    size = np.sqrt(1.0 - plant.colour**2)
    return np.asarray(lfilter([size], [1.0, -plant.colour], white))


def decaying_history(
    start_V: float, reach_V: float, ratio: float, turns: int
) -> Sequence[float]:  # fmt: skip
    """Commands at which a decaying motion about `start_V` turned."""
    return [start_V + reach_V * (-ratio) ** k for k in range(turns)]
