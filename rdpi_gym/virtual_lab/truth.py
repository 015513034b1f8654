"""The truth behind a simulated data set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import Effect
from rdpi_gym.signals.experiments import Experiment, standard_protocol
from rdpi_gym.support.checks import is_finite, shown
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_json
from rdpi_gym.virtual_lab.independent.simulation import LARGEST_STEP_S

FORMAT, VERSION = "rdpi-truth", 1
TS_FACTORS = (0.1, 4.0)
"""Beyond the larger one the fastest lines of the protocol are not sampled."""

# Of the span, the smallest loops of the protocol where no threshold says how small they should be.
_SMALL = 0.05


@dataclass(frozen=True)
class Truth:
    """A plant, what is hidden in it, and the experiments that it goes through.

    Parameters
    ----------
    plant
        The plant that is known; effects of its own are no secret.
    hidden
        Effects besides those.
    noise_um
        White noise of the sensor (µm rms).
    seed
        Of the noise and of the random commands.
    ts_factor
        Factor on the sampling times of the standard protocol.

    Raises
    ------
    InputError
        Negative noise, a factor out of range, or a hidden effect that the plant has anyway.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> truth = Truth(P10, (), noise_um=0.012, seed=0)
    >>> round(truth.span_V, 2), round(truth.stroke_um, 2), len(truth.experiments())
    (32.75, 40.0, 16)
    """

    plant: PlantModel
    hidden: tuple[Effect, ...]
    noise_um: float
    seed: int
    ts_factor: float = 1.0

    def __post_init__(self) -> None:
        if not (is_finite(self.noise_um) and self.noise_um >= 0):
            raise InputError(
                f"noise_um is {shown(self.noise_um)}; give white noise of 0 µm rms or above, as in 0.012"
            )
        low, high = TS_FACTORS
        if not (is_finite(self.ts_factor) and low <= self.ts_factor <= high):
            raise InputError(
                f"ts_factor is {shown(self.ts_factor)}; give a factor on the sampling times from {low} to {high}"
            )
        known = [effect.name for effect in self.plant.effects]
        for effect in self.hidden:
            if effect.name in known:
                raise InputError(
                    f"{self.plant.name} has {effect.name} already; hide another effect"
                )

    @property
    def centre_V(self) -> float:
        """Middle of the command's range (V)."""
        low, high = self.plant.command_range_V
        return 0.5 * (low + high)

    @property
    def span_V(self) -> float:
        """Largest excursion of the experiments from the centre (V).

        As much as the plant's reference amplitude needs, and as its range allows.
        """
        low, high = self.plant.command_range_V
        return min(0.5 * (high - low), self.plant.reference_um[1] / self.plant.hysteresis.A)

    @property
    def stroke_um(self) -> float:
        """Displacement of the span without hysteresis (µm)."""
        return self.span_V * self.plant.hysteresis.A

    def experiments(self) -> tuple[Experiment, ...]:
        """Return the standard protocol of this plant."""
        core: Core = self.plant.hysteresis
        thresholds = core.thresholds_V if isinstance(core, RDPI) else (_SMALL * self.span_V,)
        first_V = thresholds[0] if thresholds else self.span_V
        protocol = standard_protocol(self.centre_V, self.span_V, first_V, self.seed)
        return tuple(replace(e, ts_s=e.ts_s * self.ts_factor) for e in protocol)

    def with_hidden(self, hidden: Sequence[Effect]) -> Truth:
        """Return the same with other effects hidden."""
        return replace(self, hidden=tuple(hidden))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``truth.json``."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "hidden": [effect.to_dict() for effect in self.hidden],
            "plant": self.plant.to_dict(),
            "noise_um": self.noise_um,
            "seed": self.seed,
            "ts_factor": self.ts_factor,
            "centre_V": self.centre_V,
            "span_V": self.span_V,
            "simulated": f"by rdpi_gym.virtual_lab.independent on a grid of {LARGEST_STEP_S * 1e6:g} µs or finer",
        }

    def save(self, path: Path | str) -> Path:
        """Write ``truth.json``, whole or not at all."""
        return write_json(path, self.to_dict())
