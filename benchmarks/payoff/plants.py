"""Plants with hidden effects, as the payoff measures, discovers and tracks them."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace

from rdpi_gym.plant import P10, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect

NOISE_UM = 0.012
"""White noise (µm rms) of the records in which the effects are looked for."""


@dataclass(frozen=True)
class HiddenPlant:
    """A plant and the effects that a bare belief does not know.

    Parameters
    ----------
    hidden
        The effects.
    base
        The plant without them.

    Examples
    --------
    >>> HIDDEN_PLANTS[2].name, HIDDEN_PLANTS[2].slug
    ('P10 with creep and sensor_lag', 'p10-creep-sensor_lag')
    """

    hidden: tuple[Effect, ...]
    base: PlantModel = P10

    @property
    def plant(self) -> PlantModel:
        """The plant with its effects, literal rate as in :data:`~rdpi_gym.plant.P10`."""
        return replace(self.base, name=self.name, effects=self.hidden)

    @property
    def name(self) -> str:
        """What tables call it."""
        return f"{self.base.name} with {' and '.join(effect.full_name() for effect in self.hidden)}"

    @property
    def slug(self) -> str:
        """What its files are called."""
        words = [self.base.name.lower(), *(effect.full_name() for effect in self.hidden)]
        return "-".join(words).replace(", ", "-").replace(" ", "-")

    def stamp(self, seed: int) -> str:
        """Return a hash of all that its records depend on, the code aside."""
        content = json.dumps([self.plant.to_dict(), NOISE_UM, seed], sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()[:16]


def _hidden(**effects: dict[str, float]) -> HiddenPlant:
    return HiddenPlant(tuple(CATALOGUE[name](**values) for name, values in effects.items()))


HIDDEN_PLANTS: tuple[HiddenPlant, ...] = (
    _hidden(creep={"gain_per_decade": 0.015}),
    # The mode of the stage that the effect's file cites.
    _hidden(resonance={"f0_hz": 739.0, "damping": 0.03}),
    _hidden(creep={"gain_per_decade": 0.015}, sensor_lag={"time_constant_s": 2e-4}),
    # The pair that a diagnosis finds on the measured PICMA stack: an asymmetry of -8.6 % of the
    # stroke there, and creep whose amount those records do not fix.
    _hidden(
        asymmetry={"coefficient": -0.086, "span_um": 40.0}, creep={"gain_per_decade": 0.02}
    ),
    _hidden(resonance={"f0_hz": 739.0, "damping": 0.03}, delay={"delay_s": 2.2e-4}),
)  # fmt: skip
"""One effect or two that a laboratory meets, each at a common size."""
