"""What is believed of a plant with hidden effects: nothing, a fit, what was discovered, the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from benchmarks.effect_discovery.row import study_fingerprint
from benchmarks.payoff.plants import NOISE_UM, HiddenPlant
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.identification import fit
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab import Truth, simulate_dataset

MEASURED = ("fitted", "discovered")
BELIEFS = ("bare", *MEASURED, "true")
"""``bare``: the true hysteresis without the effects, which no data show; ``fitted``: the RDPI model
fitted to records of the plant; ``discovered``: what ``rdpi discover`` makes of the same records;
``true``: the plant itself."""


FOLDER = Path(__file__).parent / "beliefs"
"""Where the beliefs of this release lie."""


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
