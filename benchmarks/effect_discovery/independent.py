"""Truth of the virtual lab: plants like P10 with effects of the catalogue, integrated independently."""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from benchmarks.effect_discovery.cases import Case, Prepared, Source
from benchmarks.effect_discovery.outsiders import OUTSIDERS, draw_outsider
from rdpi_gym.measurement import Dataset, load, write_csv
from rdpi_gym.plant import P10, RDPI, PlantModel
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.virtual_lab.dataset import Truth, simulate_dataset
from rdpi_gym.virtual_lab.draws import HIDEABLE, hide

NUMBERS = {"single": 20, "pairs": 3, "none": 100, "outside": 20, "invariance": 2}
"""Studies, and how many plants each subject of one gets."""

NOISE_UM = (0.008, 0.020)
"""Range of the sensor's noise (µm rms) on a stroke of ±40 µm."""

PLAIN, _HALVED = "plain", "sampling time halved"
VARIANTS = (PLAIN, "order shuffled", _HALVED, "other units", "sign reversed")
"""As simulated, and the four changes; the sampling time is changed before the simulation."""

_MILLIVOLTS, _METRES = 1e3, 1e-6


def random_plant(rng: np.random.Generator, name: str = "random") -> tuple[PlantModel, float]:
    """Draw a plant like P10, and the noise of its sensor."""
    h = P10.hysteresis
    n = int(rng.integers(5, 13))
    shape = rng.uniform(0.65, 0.9) ** np.arange(n) * np.exp(rng.normal(0.0, 0.15, n))
    shape = np.sort(shape)[::-1]
    weights = h.S * rng.uniform(0.75, 1.25) * shape / shape.sum()
    a0 = h.a0 * rng.uniform(0.85, 1.15)
    hysteresis = RDPI.from_law(
        [a0, *weights.tolist()],
        delta1_V=h.thresholds_V[0] * rng.uniform(0.7, 1.3),
        delta2_s=h.delta2_s * 2.0 ** rng.uniform(-1.0, 1.0),
    )
    plant = PlantModel(hysteresis, name, P10.command_range_V, P10.reference_um)
    return plant, float(rng.uniform(*NOISE_UM))


def make_cases(
    studies: Sequence[str],
    plants: int | None = None,
    seed: int = 0,
    effects: Sequence[str] = HIDEABLE,
) -> list[Case]:
    """List the cases of studies, plant by plant: any beginning of them is a fair sample."""
    cases = []
    for study in studies:
        variants = [v for v in VARIANTS if v != PLAIN] if study == "invariance" else [PLAIN]
        for number in range(NUMBERS[study] if plants is None else plants):
            for subject in _subjects(study, effects):
                cases += [Case(study, subject, number, seed, variant) for variant in variants]
    return cases


def _subjects(study: str, effects: Sequence[str]) -> list[tuple[str, ...]]:
    single: list[tuple[str, ...]] = [(name,) for name in effects]
    outside: list[tuple[str, ...]] = [(name,) for name in OUTSIDERS]
    pairs: list[tuple[str, ...]] = [*combinations(effects, 2)]
    nothing: list[tuple[str, ...]] = [()]
    return {
        "single": single,
        "pairs": pairs,
        "none": nothing,
        "outside": outside,
        "invariance": [*single, *nothing, *outside],
    }[study]


def prepare(case: Case) -> Prepared:
    """Simulate a case."""
    plant, noise_um = random_plant(
        np.random.default_rng([case.seed, case.number]), f"plant {case.number}"
    )
    # the same draw in every study and every variant
    stream = zlib.crc32("+".join(case.subject).encode())
    rng = np.random.default_rng([case.seed, case.number, stream])
    truth = Truth(plant, (), noise_um, seed=int(rng.integers(2**31)))
    factor = 0.5 if case.variant == _HALVED else 1.0
    if case.subject and case.subject[0] in OUTSIDERS:
        outsider = draw_outsider(case.subject[0], truth, rng)
        truth = replace(truth, ts_factor=factor)
        dataset = simulate_dataset(truth, outsider.displacement)
        document = truth.to_dict() | outsider.to_dict()
    else:
        truth = replace(hide(case.subject, truth, rng), ts_factor=factor)
        dataset, document = simulate_dataset(truth), truth.to_dict()
    return Prepared(transform(dataset, case.variant, case.number), document)


def transform(dataset: Dataset, variant: str, seed: int) -> Dataset:
    """Return the same data set with its records shuffled, in other units, or upside down."""
    if variant in (PLAIN, _HALVED):
        return dataset
    if variant == "order shuffled":
        order = np.random.default_rng(seed).permutation(len(dataset.records))
        return replace(dataset, records=tuple(dataset.records[k] for k in order))
    if variant == "sign reversed":
        return replace(dataset, records=tuple(replace(r, y_um=-r.y_um) for r in dataset.records))
    if variant == "other units":
        return _through_files(dataset)
    raise InputError(f"no variant is named {variant!r}; give {', '.join(VARIANTS)}")


def _through_files(dataset: Dataset) -> Dataset:
    """Write y in metres and u in millivolts to files with these units, and read them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for record in dataset.records:
            other = replace(record, u_V=_MILLIVOLTS * record.u_V, y_um=_METRES * record.y_um)
            write_csv(other, folder / f"{record.name}.csv")
        write_atomic(folder / "dataset.toml", '[units]\nu = "mV"\ny = "m"\n')
        return replace(load(folder), title=dataset.title)


INDEPENDENT = Source(
    "independent", "hidden_effects", Path("studies/results/hidden"), NUMBERS, HIDEABLE,
    make_cases, prepare,
)  # fmt: skip
