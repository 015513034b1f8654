"""Cases of the third study, their draws and the sums of their records."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from benchmarks.effect_discovery.cases import Case, Prepared, Sampled
from benchmarks.effect_discovery.forms import CORE, Form, Mechanism, UnfitError, mechanism
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.support.arrays import Array
from rdpi_gym.virtual_lab.draws import VISIBLE, MaskedError
from studies.third_effects.faults import CLOCKS, EXCUSED, FAULTS
from studies.third_effects.forms import EFFECTS, FORMS
from studies.third_effects.plants import (
    KINDS,
    NOISES,
    OUTSIDE,
    BaseModel,
    Bench,
    close_loops,
    draw_core,
    draw_elements,
)
from studies.third_effects.protocols import draw_experiment

SEED = 20_271_136
NUMBERS: Mapping[str, int] = {
    "none": 15, "single": 30, "double": 18, "triple": 9, "outside": 10, "kind": 11, "fault": 10,
}  # fmt: skip
"""Cases of each stratum."""
ROUNDING = 1e-6
"""Difference of sums, as a part of the rms, that other machines and libraries may make."""
_REDRAWS, _ATTEMPTS = 60, 8
_WANTED = (3.6, 30.0)  # noise floors that an effect is to leave
_GROWN = 1.1  # the direction in which another effect may be refitted
_BETWEEN = 1.0  # noise floors that the plant without effects may move between its samples
_ALIKE = 0.95  # cosine of what a refit leaves of two effects


def make_cases() -> list[Case]:
    """List all cases; subjects take turns in an order that the seed fixes."""
    rng, cases = np.random.default_rng(SEED), []
    for stratum, count in NUMBERS.items():
        subjects = _subjects(stratum)
        order = rng.permutation(len(subjects))
        cases += [Case(stratum, subjects[order[k % len(subjects)]], k, SEED) for k in range(count)]
    return cases


def _subjects(stratum: str) -> list[tuple[str, ...]]:
    sizes = {"none": 0, "single": 1, "double": 2, "triple": 3}
    if stratum in sizes:
        return list(combinations(EFFECTS, sizes[stratum]))
    names: Mapping[str, Any] = {"outside": OUTSIDE, "kind": KINDS, "fault": FAULTS}[stratum]
    return [(name,) for name in names]


def prepare(case: Case) -> Prepared:
    """Draw a plant and an experiment that show what is hidden, and take the records."""
    index = list(NUMBERS).index(case.study)
    for redraw in range(_REDRAWS):
        rng = np.random.default_rng([case.seed, index, case.number, redraw])
        try:
            return _drawn(case, rng)
        except (UnfitError, MaskedError):
            continue
    raise MaskedError(f"{' and '.join(case.subject)} cannot be seen in {_REDRAWS} experiments")


def _hidden(case: Case, rng: np.random.Generator) -> tuple[str, ...]:
    """Effects of a case: of a kind and of a fault, one effect in half of the cases."""
    if case.study in ("none", "single", "double", "triple"):
        return case.subject
    if case.study == "outside" or rng.random() < 0.5:
        return ()
    behind = ("creep", "resonance", "sensor_lag", "delay", "thermal_drift", "actuator_lag")
    return (str(rng.choice(behind if case.study == "kind" else EFFECTS)),)


def _drawn(case: Case, rng: np.random.Generator) -> Prepared:
    names = _hidden(case, rng)
    experiment = draw_experiment(rng)
    plant = draw_elements(experiment, rng, False if "rate_law" in names else None)
    noise = [
        plant.noise_um * NOISES[plant.noise](d.samples.size, rng) for d in experiment.drives
    ]  # fmt: skip
    bench = close_loops(Bench(plant, experiment), noise, rng)
    kind = case.subject[0] if case.study == "kind" else ""
    if kind:
        usual = float(np.median(np.abs(np.diff(experiment.drives[0].fine)))) / experiment.span_V
        bench = replace(bench, core=draw_core(kind, plant.stroke_um, max(usual, 1e-9), rng))
    if max(_between(bench)) > _BETWEEN * plant.noise_um:
        raise MaskedError("the turns lie between the samples")
    base = BaseModel(bench)
    floors: dict[str, float] = {}
    alike: dict[str, list[str]] = {}
    if names:
        chosen = [_form(name, rng, bool(kind)) for name in names]
        bench, floors = _sized(bench, base, chosen, rng)
        alike = _alike(bench, base)
    outside: dict[str, Any] = {}
    clean, by_input = bench.displacements(), bench.by_input()
    if case.study == "outside":
        size = plant.noise_um * math.exp(rng.uniform(math.log(5.0), math.log(25.0)))
        clean, by_input, outside = OUTSIDE[case.subject[0]](bench, rng, size)
        floors = {"outside": base.left_um(clean) / plant.noise_um}
    elif kind:
        floors |= {"kind": base.left_um(bench.displacements(())) / plant.noise_um}
    if floors and min(floors.values()) < VISIBLE:
        raise MaskedError("the base model takes it up")
    records = [
        Sampled(
            Record(d.name, t, d.samples, y + n, ts_s=d.ts_s, role=d.role), y, part,
            np.ones(y.size, dtype=np.bool_),
        )
        for d, t, y, part, n in zip(
            bench.experiment.drives, bench.clocks_s(), clean, by_input, noise, strict=True
        )
    ]  # fmt: skip
    fault = case.subject[0] if case.study == "fault" else ""
    if fault:
        before = [s.record.y_um for s in records]
        records = FAULTS[fault](records, rng, plant.noise_um)
        changes = [float(np.std(s.record.y_um - y)) for s, y in zip(records, before, strict=True)]
        if max(changes) < plant.noise_um:
            raise MaskedError("the fault changes less than the noise")
    truth = {
        "hidden": [m.to_dict() for m in bench.hidden],
        "outside": outside,
        "kind": kind,
        "kinds": list(KINDS.get(kind, ())),
        "degraded": fault,
        "is_clock": fault in CLOCKS,
        "floors": floors,
        "alike": alike,
        "excused": sorted({*EXCUSED.get(fault, ())} - set(names)),
        "protocol": experiment.protocol,
        "noise_um": plant.noise_um,
        "noise": plant.noise,
        "stroke_um": plant.stroke_um,
        "samples": sum(s.clean_um.size for s in records),
        "rates_hz": [1.0 / d.ts_s for d in experiment.drives],
        "has_validation": any(d.role == "validation" for d in experiment.drives),
        "sampling_um": max(_between(bench)),
    }
    dataset = Dataset(f"records of plant {case.number}", tuple(s.record for s in records))
    return Prepared(dataset, truth, tuple(records))


def _between(bench: Bench) -> list[float]:
    """Displacement that a command in straight lines between the samples misses (µm rms), by record."""
    pairs = zip(bench.displacements(), bench.displacements(straight=True), strict=True)
    return [float(np.std(a - b)) for a, b in pairs]


def _form(name: str, rng: np.random.Generator, behind: bool) -> Form:
    forms = [f for f in FORMS if f.effect == name and not (behind and f.form == "of the plays alone")]  # fmt: skip
    return forms[int(rng.integers(len(forms)))]


def _differences(
    bench: Bench, full: Sequence[Array], without: Mechanism, instead: Sequence[Mechanism] = ()
) -> list[Array]:
    """Difference that it makes to leave a mechanism out, or to have others in its place (µm)."""
    chosen = [*instead, *(m for m in bench.hidden if m is not without)]
    chosen.sort(key=lambda m: m.form.place)
    return [y - x for y, x in zip(full, bench.displacements(chosen), strict=True)]


def _sized(
    bench: Bench, base: BaseModel, forms: Sequence[Form], rng: np.random.Generator
) -> tuple[Bench, dict[str, float]]:
    """Hide forms, each large enough to leave 3 noise floors beside a refit and the others."""
    scale, noise = bench.scale(), bench.plant.noise_um
    seeds = [int(s) for s in rng.integers(2**31, size=len(forms))]
    sizes = np.exp(rng.uniform(-0.4, 1.0, len(forms)))
    wanted = np.exp(rng.uniform(math.log(_WANTED[0]), math.log(_WANTED[1]), len(forms)))
    best: tuple[Bench, dict[str, float]] | None = None
    for _ in range(_ATTEMPTS):
        made, grown = (
            [
                mechanism(f, scale, s, float(x) * growth)
                for f, s, x in zip(forms, seeds, sizes, strict=True)
            ]
            for growth in (1.0, _GROWN)
        )
        trial = replace(bench, hidden=tuple(sorted(made, key=lambda m: m.form.place)))
        full = trial.displacements()
        beside = [_differences(trial, full, m, [g]) for m, g in zip(made, grown, strict=True)]
        found = np.array(
            [
                base.left_um(_differences(trial, full, m), beside[:k] + beside[k + 1 :]) / noise
                for k, m in enumerate(made)
            ]
        )
        if np.all(found >= VISIBLE):
            best = trial, dict(zip((m.effect for m in made), found.tolist(), strict=True))
        small = found < (1.0 - ROUNDING) * wanted  # grown to it, it is not decided by rounding
        if not small.any():
            break
        sizes[small] *= np.clip(wanted / np.maximum(found, 1e-9), 1.25, 3.0)[small]
    if best is None:
        raise MaskedError("no size of the effects shows them all on this experiment")
    return best


def _alike(bench: Bench, base: BaseModel) -> dict[str, list[str]]:
    """Effects that the records cannot tell from a hidden one: what a refit leaves has one direction."""
    scale, alone = bench.scale(), replace(bench, hidden=())
    still, typical = alone.displacements(), {}
    names = {m.effect for m in bench.hidden}
    for form in {f.effect: f for f in reversed(FORMS)}.values():
        if form.effect in names or (bench.core is not None and form.place == CORE):
            continue
        try:
            one = mechanism(form, scale, 0, 1.0)
        except UnfitError:
            continue
        moved = [x - y for x, y in zip(alone.displacements([one]), still, strict=True)]
        typical[form.effect] = base.left(moved)
    full, found = bench.displacements(), {}
    for m in bench.hidden:
        own = base.left(_differences(bench, full, m))
        cosines = {
            name: abs(float(own @ x)) / max(float(np.linalg.norm(own) * np.linalg.norm(x)), 1e-300)
            for name, x in typical.items()
        }
        found[m.effect] = sorted(name for name, cosine in cosines.items() if cosine > _ALIKE)
    return found


def sums(dataset: Dataset) -> dict[str, float]:
    """Return the rms over all records and the last sample, of the command (V) and the displacement (µm)."""
    u_V, y_um = (
        np.concatenate([getattr(r, of) for r in dataset.records]) for of in ("u_V", "y_um")
    )
    return {
        "u_rms_V": float(np.sqrt(np.mean(u_V**2))),
        "y_rms_um": float(np.sqrt(np.mean(y_um**2))),
        "u_last_V": float(u_V[-1]),
        "y_last_um": float(y_um[-1]),
    }


def is_drawn_as(drawn: Mapping[str, float], stored: Mapping[str, float]) -> bool:
    """Tell whether sums are the stored ones, up to the rounding of another machine."""
    return all(
        abs(drawn[name] - stored[name]) <= ROUNDING * stored[rms]
        for rms, last in (("u_rms_V", "u_last_V"), ("y_rms_um", "y_last_um"))
        for name in (rms, last)
    )
