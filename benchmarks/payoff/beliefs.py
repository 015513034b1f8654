"""Plants with hidden effects, and beliefs about them: nothing, a fit, a discovery, the truth."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.effect_discovery.cases import study_fingerprint
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.identification import fit
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant import P10, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab import Truth, simulate_dataset

NOISE_UM = 0.012
"""White noise (µm rms) of the records in which the effects are looked for."""


@dataclass(frozen=True)
class HiddenPlant:
    """A plant and the effects that a bare belief does not know.

    Examples
    --------
    >>> HIDDEN_PLANTS[2].name, HIDDEN_PLANTS[2].slug
    ('P10 with creep and sensor_lag', 'p10-creep-sensor_lag')
    """

    hidden: tuple[Effect, ...]  # the effects
    base: PlantModel = P10  # the plant without them

    @property
    def plant(self) -> PlantModel:
        """The plant with its effects, literal rate as in :data:`~rdpi_gym.plant.P10`."""
        return replace(self.base, name=self.name, effects=self.hidden)

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.base.name} with {' and '.join(effect.full_name() for effect in self.hidden)}"

    @property
    def slug(self) -> str:
        """Stem of its files' names."""
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


MEASURED = ("fitted", "discovered")
BELIEFS = ("bare", *MEASURED, "true")
"""``bare``: the true hysteresis without the effects, which no data show; ``fitted``: the RDPI model
fitted to records of the plant; ``discovered``: what ``rdpi discover`` makes of the same records;
``true``: the plant itself."""


FOLDER = Path(__file__).parent / "beliefs"
"""Folder of the beliefs of this release."""


def make_beliefs(hidden: HiddenPlant, folder: Path, seed: int = 0) -> dict[str, PlantModel]:
    """Return every belief about a plant, from files where they hold."""
    kept = {name: _kept(_path(hidden, name, folder), hidden, seed, True) for name in MEASURED}
    found = {name: model for name, model in kept.items() if model is not None}
    if len(found) < len(kept):
        truth = Truth(hidden.base, hidden.hidden, noise_um=NOISE_UM, seed=seed)
        for name, model in _measured(simulate_dataset(truth), hidden.base, seed).items():
            marks = {"records": hidden.stamp(seed), "code": study_fingerprint()}
            found[name] = replace(model, identification={**model.identification, **marks})
            found[name].save(_path(hidden, name, folder))
    return _all(hidden, found)


def stored_beliefs(
    hidden: HiddenPlant, folder: Path = FOLDER, seed: int = 0
) -> dict[str, PlantModel]:
    """Return every belief about a plant without looking for any; older code's files count."""
    found = {}
    for name in MEASURED:
        model = _kept(_path(hidden, name, folder), hidden, seed, False)
        if model is None:
            raise InputError(
                f"{_path(hidden, name, folder)} holds no belief about {hidden.name}; run python -m benchmarks.payoff"
            )
        found[name] = model
    return _all(hidden, found)


def _measured(dataset: Dataset, base: PlantModel, seed: int) -> Mapping[str, PlantModel]:
    """Identify and discover: all that is asked of the laboratory."""
    fitted = fit(dataset, n=base.hysteresis.n, name="fitted").plant
    return {"fitted": fitted, "discovered": discover(dataset, seed=seed).plant}


def _all(hidden: HiddenPlant, measured: Mapping[str, PlantModel]) -> dict[str, PlantModel]:
    base = hidden.base
    every = {"bare": base, **measured, "true": hidden.plant}
    return {
        name: replace(
            every[name],
            name=name,
            command_range_V=base.command_range_V,
            reference_um=base.reference_um,
        )
        for name in BELIEFS
    }


def _path(hidden: HiddenPlant, name: str, folder: Path) -> Path:
    return folder / f"{hidden.slug}-{name}.json"


def _kept(path: Path, hidden: HiddenPlant, seed: int, same_code: bool) -> PlantModel | None:
    if not path.exists():
        return None
    model = PlantModel.load(path)
    if model.identification.get("records") != hidden.stamp(seed):
        return None
    if same_code and model.identification.get("code") != study_fingerprint():
        return None
    return model
