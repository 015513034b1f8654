"""What the study asks: how many plants, what is hidden in each, and the records that are made."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from benchmarks.foreign_effects.chain import Bench, close_loop
from benchmarks.foreign_effects.degradations import (
    CLOCKS,
    EXCUSED,
    KINDS,
    Sampled,
    degrade,
    through_files,
)
from benchmarks.foreign_effects.forms import EFFECTS, UnfitError, draw_form, scale_of
from benchmarks.foreign_effects.outside import OUTSIDE
from benchmarks.foreign_effects.plants import draw_plant, noise_of
from benchmarks.foreign_effects.protocols import PROTOCOLS, take
from benchmarks.foreign_effects.visible import alike, blank_records, remaining_um, sized
from rdpi_gym.measurement import Dataset
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.draws import VISIBLE, MaskedError

NUMBERS = {"single": 450, "double": 250, "triple": 100, "none": 100, "outside": 100}
"""Studies, and how many plants each has."""

_REDRAWS = 12
_COARSE, _DEGRADED, _REMANENT = 0.04, 0.25, 0.1  # shares of the plants
# Plays behind plays are plays again (a Prandtl-Ishlinskii operator of one is one), if a part of the
# motion passes the second at once: only the memory at the start is another.
_ONE_BY_LAW = {("backlash", "compliant gap"): "initial_memory"}
# All that a row says follows from these words and the case: another study draws other plants.
_STREAM = zlib.crc32(b"foreign effects")


@dataclass(frozen=True)
class Case:
    """One data set to diagnose.

    Parameters
    ----------
    study
        One of :data:`NUMBERS`.
    subject
        What is in it: effects, one of :data:`~benchmarks.foreign_effects.outside.OUTSIDE`, or nothing.
    number
        Of the plant, within the study.
    seed
        Of the study: 0 to tune on, another to report.
    """

    study: str
    subject: tuple[str, ...]
    number: int
    seed: int = 0

    @property
    def key(self) -> str:
        """What names the case in a store."""
        return f"{self.study}/{'+'.join(self.subject) or 'nothing'}/{self.number}/seed {self.seed}"


@dataclass(frozen=True, eq=False)
class Prepared:
    """A case with its records.

    Parameters
    ----------
    case
        The case.
    dataset
        What the laboratory gets.
    truth
        What is true of it, as JSON.
    records
        Its records as simulated, with what is true at every sample.
    """

    case: Case
    dataset: Dataset
    truth: dict[str, Any]
    records: tuple[Sampled, ...]


def make_cases(
    studies: Sequence[str], per_study: int | None = None, seed: int = 0
) -> list[Case]:  # fmt: skip
    """List the cases of studies; subjects take turns, so that any beginning is a fair sample."""
    cases = []
    for study in studies:
        if study not in NUMBERS:
            raise InputError(f"no study is named {study!r}; give {', '.join(NUMBERS)}")
        subjects = _subjects(study)
        for number in range(NUMBERS[study] if per_study is None else per_study):
            cases.append(Case(study, subjects[number % len(subjects)], number, seed))
    return cases


def _subjects(study: str) -> list[tuple[str, ...]]:
    """Subjects in an order that is mixed, and the same for every seed."""
    sizes = {"single": 1, "double": 2, "triple": 3, "none": 0}
    if study == "outside":
        return [(name,) for name in OUTSIDE]
    every = list(combinations(EFFECTS, sizes[study]))
    order = np.random.default_rng(_STREAM).permutation(len(every))
    return [every[k] for k in order]


def prepare(case: Case) -> Prepared:
    """Draw a plant and an experiment that show what is hidden, and take the records."""
    stream = zlib.crc32("+".join((case.study, *case.subject)).encode())
    for redraw in range(_REDRAWS):
        rng = np.random.default_rng([_STREAM, case.seed, case.number, stream, redraw])
        try:
            return _drawn(case, rng)
        except (UnfitError, MaskedError):
            continue
    raise MaskedError(f"{' and '.join(case.subject)} cannot be seen in {_REDRAWS} experiments")


def _drawn(case: Case, rng: np.random.Generator) -> Prepared:
    names = case.subject if case.study != "outside" else ()
    protocol = list(PROTOCOLS)[int(rng.integers(len(PROTOCOLS)))]
    taken = take(protocol, rng)
    plant = draw_plant(taken, rng, False if "rate_law" in names else None)
    is_coarse = bool(rng.random() < _COARSE)
    remanent = rng.uniform(0.4, 1.0) if rng.random() < _REMANENT else 0.0
    bench = Bench(plant, (), taken, 0.0 if "initial_memory" in names else remanent)
    noise = [noise_of(plant, d.command_V.size, rng) for d in taken.drives]
    is_closed = protocol == "closed loop"
    references = taken
    if is_closed:
        bench = close_loop(bench, noise)
    floors: dict[str, float] = {}
    if names:
        forms = [draw_form(name, rng) for name in names]
        bench, floors = sized(bench, forms, scale_of(bench.taken, plant, is_coarse), rng)
        if is_closed:  # around the whole plant
            bench = close_loop(replace(bench, taken=references), noise)
    outside: dict[str, Any] = {}
    if case.study == "outside":
        clean, by_input, outside = OUTSIDE[case.subject[0]](bench, rng)
        _check_visible(bench, clean, by_input)
    else:
        clean, by_input = bench.displacements(), bench.by_input()
    records = [
        Sampled(replace(r, y_um=y + n[d.cut :]), y, part, np.ones(y.size, dtype=np.bool_))
        for r, d, y, part, n in zip(
            blank_records(bench), bench.taken.drives, clean, by_input, noise, strict=True
        )
    ]
    degraded = KINDS[int(rng.integers(len(KINDS)))] if rng.random() < _DEGRADED else ""
    records = degrade(degraded, records, rng)
    dataset = Dataset(f"records of plant {case.number}", tuple(s.record for s in records))
    straight = bench.displacements(linear=True)
    excused = {*EXCUSED.get(degraded, ())}
    if bench.history_ratio or taken.in_motion:
        excused.add("initial_memory")
    truth = {
        "hidden": [m.to_dict() for m in bench.hidden],
        "outside": outside,
        "floors": floors,
        "protocol": protocol,
        "degraded": degraded,
        "noise_um": plant.noise_um,
        "stroke_um": plant.stroke_um,
        "samples": bench.taken.samples,
        "rates_hz": [1.0 / d.ts_s for d in taken.drives],
        "has_validation": taken.has_validation,
        "in_motion": taken.in_motion,
        "remanent": bench.history_ratio,
        "is_coarse": is_coarse,
        "excused": sorted(excused - set(names)),
        "alike": _with_laws(alike(dataset, bench, names), bench),
        # what the motion between the samples alone makes unknowable from them
        "sampling_um": max(
            float(np.std(a - b)) for a, b in zip(bench.displacements(), straight, strict=True)
        ),
    }
    if degraded in CLOCKS:
        dataset = through_files(degraded, dataset, rng)
    return Prepared(case, dataset, truth, tuple(records))


def _with_laws(found: dict[str, list[str]], bench: Bench) -> dict[str, list[str]]:
    """Add what no record can tell apart, by :data:`_ONE_BY_LAW`."""
    for m in bench.hidden:
        other = _ONE_BY_LAW.get((m.effect, m.form.form))
        if other is not None:
            found[m.effect] = list(dict.fromkeys((*found.get(m.effect, []), other)))
    return found


def _check_visible(bench: Bench, clean: Sequence[Array], by_input: Sequence[Array]) -> None:
    """Refuse what the base model could take up."""
    same = all(a is b for a, b in zip(clean, by_input, strict=True))
    differences = list(clean) if same else [a - b for a, b in zip(clean, by_input, strict=True)]
    if remaining_um(bench, blank_records(bench), differences) < VISIBLE * bench.plant.noise_um:
        raise MaskedError("the base model takes it up")
