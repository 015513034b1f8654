"""What the study asks: which plants, with what hidden in them, in which clothes."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from benchmarks.hidden_effects.outside import OUTSIDERS, draw_outsider
from benchmarks.hidden_effects.plants import random_plant
from benchmarks.hidden_effects.transform import PLAIN, VARIANTS, transform
from rdpi_gym.measurement import Dataset
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.dataset import simulate_dataset
from rdpi_gym.virtual_lab.draws import HIDEABLE, hide
from rdpi_gym.virtual_lab.truth import Truth

NUMBERS = {"single": 20, "pairs": 3, "none": 100, "outside": 20, "invariance": 2}
"""Studies, and how many plants each subject of one gets."""

_HALVED = "sampling time halved"


@dataclass(frozen=True)
class Case:
    """One data set to diagnose.

    Parameters
    ----------
    study
        One of :data:`NUMBERS`.
    subject
        What is in it: effects, one of :data:`~benchmarks.hidden_effects.outside.OUTSIDERS`, or nothing.
    number
        Of the plant: the same plant for every subject.
    seed
        Of the study.
    variant
        One of :data:`~benchmarks.hidden_effects.transform.VARIANTS`.
    """

    study: str
    subject: tuple[str, ...]
    number: int
    seed: int = 0
    variant: str = PLAIN

    @property
    def key(self) -> str:
        """What names the case in a store."""
        what = "+".join(self.subject) or "nothing"
        return f"{self.study}/{what}/{self.number}/seed {self.seed}/{self.variant}"


def make_cases(
    studies: Sequence[str],
    plants: int | None = None,
    seed: int = 0,
    effects: Sequence[str] = HIDEABLE,
) -> list[Case]:
    """List the cases of studies, plant by plant: what an interrupted run has done is a fair sample."""
    cases = []
    for study in studies:
        if study not in NUMBERS:
            raise InputError(f"no study is named {study!r}; give {', '.join(NUMBERS)}")
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


def prepare(case: Case) -> tuple[Dataset, dict[str, Any]]:
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
    return transform(dataset, case.variant, case.number), document
