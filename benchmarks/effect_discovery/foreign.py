"""Foreign truth: plants, effects and protocols in other forms than the package's own."""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.effect_discovery.bench import Bench, close_loop
from benchmarks.effect_discovery.cases import Case, Prepared, Sampled, Source
from benchmarks.effect_discovery.forms import (
    EFFECTS,
    Form,
    Mechanism,
    Scale,
    UnfitError,
    draw_form,
    mechanism,
    scale_of,
)
from benchmarks.effect_discovery.outsiders import BoucWen
from benchmarks.effect_discovery.physics import duhem, stuck_and_slipped
from benchmarks.effect_discovery.plants import draw_plant, noise_of
from benchmarks.effect_discovery.protocols import PROTOCOLS, draw_experiment
from benchmarks.effect_discovery.sampled import (
    CLOCKS,
    EXCUSED,
    KINDS,
    degrade,
    through_files,
    true_residual,
)
from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.diagnosis.search.separability import separability, typical_effects
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.draws import VISIBLE, MaskedError, refit_residuals

_ATTEMPTS = 14
_WANTED = (3.5, 40.0)  # noise floors, of which one is drawn for each effect
_STEPS = (1.25, 3.0)  # least and largest factor on a size that is too small
_LOOKED_AT = 5_000  # samples of all records
_GROWN = 1.1  # the direction in which another effect may be refitted


def blank_records(bench: Bench) -> list[Record]:
    """Records of the commands; the displacement is a placeholder."""
    found = []
    for drive, start in zip(bench.experiment.drives, bench.starts_s(), strict=True):
        u = drive.command_V
        t = start + drive.ts_s * np.arange(u.size, dtype=np.float64)
        kept = slice(drive.cut, None)
        found.append(
            Record(drive.name, t[kept], u[kept], u[kept], ts_s=drive.ts_s, role=drive.role)
        )
    return found


def remaining_um(
    bench: Bench, records: Sequence[Record], differences: Sequence[Array],
    others: Sequence[Array] = (),
) -> float:  # fmt: skip
    """Residual of a difference after a refit of the base model, on the record with most (µm rms)."""
    every = max(1, sum(r.u_V.size for r in records) // _LOOKED_AT)
    plant, span = bench.plant.model(), bench.plant.span_V
    return max(refit_residuals(plant, (), span, records, differences, others, every).values())


def sized(
    bench: Bench, forms: Sequence[Form], scale: Scale, rng: np.random.Generator
) -> tuple[Bench, dict[str, float]]:
    """Hide forms, each large enough to leave 3 to 40 noise floors beside the others."""
    seeds = rng.integers(2**31, size=len(forms))
    sizes = np.exp(rng.uniform(np.log(0.7), np.log(3.0), len(forms)))
    wanted = np.exp(rng.uniform(np.log(_WANTED[0]), np.log(_WANTED[1]), len(forms)))
    records, best, before = blank_records(bench), None, np.zeros(len(forms))
    for _ in range(_ATTEMPTS):
        made = [
            mechanism(f, scale, int(s), float(x))
            for f, s, x in zip(forms, seeds, sizes, strict=True)
        ]
        hidden = tuple(sorted(made, key=lambda m: m.form.place))
        trial = replace(bench, hidden=hidden)
        full = trial.displacements()
        grown = [
            _without_one(trial, full, m, mechanism(f, scale, int(s), float(x) * _GROWN))
            for m, f, s, x in zip(made, forms, seeds, sizes, strict=True)
        ]
        floors: dict[str, float] = {}
        for k, m in enumerate(made):
            difference = _without_one(trial, full, m, None)
            others = [
                np.column_stack([g[r] for j, g in enumerate(grown) if j != k])
                if len(made) > 1 else np.empty((full[r].size, 0))
                for r in range(len(full))
            ]  # fmt: skip
            noise = bench.plant.noise_um
            floors[m.effect] = max(float(np.std(d)) for d in difference) / noise
            if floors[m.effect] >= VISIBLE:  # before a refit; else none can leave it
                floors[m.effect] = remaining_um(bench, records, difference, others) / noise
        found = np.array([floors[f.effect] for f in forms])
        if np.all(found >= VISIBLE):
            best = trial, floors
        small = found < wanted
        if not small.any() or np.all(found[small] <= 1.001 * before[small]):
            break  # all that is wanted, or all that can be
        before = found
        sizes[small] *= np.clip(wanted / np.maximum(found, 1e-9), *_STEPS)[small]
    if best is not None:
        return best
    raise MaskedError("no size of the effects shows them all on this experiment")


def _without_one(
    bench: Bench, full: Sequence[Array], one: Mechanism, other: Mechanism | None
) -> list[Array]:
    """Difference that it makes to leave an effect out, or to have another in its place (µm)."""
    changed = tuple(
        other if m is one and other is not None else m
        for m in bench.hidden
        if m is not one or other is not None
    )
    return [y - x for y, x in zip(full, bench.displacements(changed), strict=True)]


def alike(dataset: Dataset, bench: Bench, names: Sequence[str]) -> dict[str, list[str]]:
    """Effects of the catalogue that these records cannot tell from some others."""
    effects = typical_effects(CATALOGUE, data_scale(dataset.train))
    known = [name for name in names if name in effects]
    if not known:
        return {}
    try:
        found = separability(dataset.train, bench.plant.model().hysteresis, (), effects)
    except (InputError, np.linalg.LinAlgError):
        return {}
    return {name: [n for n in found.alike(name) if n in effects] for name in known}


Displaced = tuple[list[Array], list[Array], dict[str, Any]]
"""Displacement at the recorded samples (µm), the part that follows from the input, the numbers."""


def _force(bench: Bench, rng: np.random.Generator) -> Displaced:
    """Push with band-limited noise: twenty lines that go by the clock."""
    still = bench.displacements()
    size = bench.plant.noise_um * rng.uniform(3.0, 12.0)
    fastest = 0.2 / min(d.ts_s for d in bench.experiment.drives)
    hz = np.exp(rng.uniform(math.log(0.005 * fastest), math.log(fastest), 20))
    phases = rng.uniform(0.0, 2.0 * math.pi, hz.size)
    pushed = []
    for y, t in zip(still, _clocks(bench), strict=True):
        force = sum(np.sin(2.0 * math.pi * f * t + p) for f, p in zip(hz, phases, strict=True))
        pushed.append(y + size * math.sqrt(2.0 / hz.size) * force)
    return pushed, still, {"rms_um": size, "low_hz": float(hz.min()), "high_hz": float(hz.max())}


def _second_input(bench: Bench, rng: np.random.Generator) -> Displaced:
    """Move another axis, which nobody recorded, in steps that couple into this one."""
    still = bench.displacements()
    size = bench.plant.noise_um * rng.uniform(6.0, 25.0)
    moved = []
    for y, t in zip(still, _clocks(bench), strict=True):
        ends = np.sort(rng.uniform(t[0], t[-1], int(rng.integers(8, 30))))
        levels = rng.uniform(-1.0, 1.0, ends.size + 1)
        moved.append(y + size * levels[np.searchsorted(ends, t)])
    return moved, still, {"peak_um": size}


def _bouc_wen(bench: Bench, rng: np.random.Generator) -> Displaced:
    p = bench.plant
    width = p.span_V * rng.uniform(0.1, 0.3)
    depth = float(p.weights.sum()) * width * rng.uniform(0.7, 1.5)
    model = BoucWen(
        p.gain_um_V, depth, width, exponent=rng.uniform(1.0, 2.0), share=rng.uniform(0.5, 0.9)
    )
    y = _of_commands(bench, model.of_command)
    return y, y, model.to_dict()


def _duhem(bench: Bench, rng: np.random.Generator) -> Displaced:
    p = bench.plant
    alpha = rng.uniform(1.5, 6.0) / p.span_V
    numbers = {"alpha": alpha, "slope_um_V": p.gain_um_V, "initial_um_V": p.a0_um_V}
    y = _of_commands(bench, lambda u: np.asarray(duhem(u, alpha, p.gain_um_V, p.a0_um_V)))
    return y, y, numbers


def _stick_slip(bench: Bench, rng: np.random.Generator) -> Displaced:
    sticks = bench.plant.noise_um * rng.uniform(8.0, 30.0)
    slips = sticks * rng.uniform(0.1, 0.5)
    y = [np.asarray(stuck_and_slipped(x, sticks, slips)) for x in bench.displacements()]
    return y, y, {"sticks_um": sticks, "slips_um": slips}


def _clocks(bench: Bench) -> list[Array]:
    return [
        start + d.ts_s * np.arange(d.cut, d.command_V.size, dtype=np.float64)
        for d, start in zip(bench.experiment.drives, bench.starts_s(), strict=True)
    ]


def _of_commands(bench: Bench, respond: Callable[[Array], Array]) -> list[Array]:
    """Displacement of a core that stands in the place of the plays, by record."""
    found = []
    for drive in bench.experiment.drives:
        about = drive.fine_V - bench.plant.centre_V  # symmetric about the middle of the range
        found.append(respond(about)[:: drive.parts][drive.cut :])
    return found


OUTSIDE: Mapping[str, Callable[[Bench, np.random.Generator], Displaced]] = {
    "force": _force,
    "second input": _second_input,
    "bouc-wen": _bouc_wen,
    "duhem": _duhem,
    "stick-slip": _stick_slip,
}
"""Phenomena outside the catalogue, by name."""


NUMBERS = {"single": 450, "double": 250, "triple": 100, "none": 100, "outside": 100}
"""Studies, and how many plants each has."""

_REDRAWS = 12
_COARSE, _DEGRADED, _REMANENT = 0.04, 0.25, 0.1  # shares of the plants
# Plays behind plays are plays again (a Prandtl-Ishlinskii operator of one is one), if a part of the
# motion passes the second at once: only the memory at the start is another.
_ONE_BY_LAW = {("backlash", "compliant gap"): "initial_memory"}
# All that a row says follows from these words and the case: another study draws other plants.
_STREAM = zlib.crc32(b"foreign effects")


def make_cases(
    studies: Sequence[str],
    plants: int | None = None,
    seed: int = 0,
    effects: Sequence[str] = EFFECTS,
) -> list[Case]:
    """List the cases of studies; subjects take turns, so that any beginning is a fair sample."""
    cases = []
    for study in studies:
        subjects = _subjects(study, effects)
        for number in range(NUMBERS[study] if plants is None else plants):
            cases.append(Case(study, subjects[number % len(subjects)], number, seed))
    return cases


def _subjects(study: str, effects: Sequence[str]) -> list[tuple[str, ...]]:
    """Subjects in an order that is mixed, and the same for every seed."""
    sizes = {"single": 1, "double": 2, "triple": 3, "none": 0}
    if study == "outside":
        return [(name,) for name in OUTSIDE]
    every = list(combinations(effects, sizes[study]))
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
    experiment = draw_experiment(protocol, rng)
    plant = draw_plant(experiment, rng, False if "rate_law" in names else None)
    is_coarse = bool(rng.random() < _COARSE)
    remanent = rng.uniform(0.4, 1.0) if rng.random() < _REMANENT else 0.0
    bench = Bench(plant, (), experiment, 0.0 if "initial_memory" in names else remanent)
    noise = [noise_of(plant, d.command_V.size, rng) for d in experiment.drives]
    is_closed = protocol == "closed loop"
    references = experiment
    if is_closed:
        bench = close_loop(bench, noise)
    floors: dict[str, float] = {}
    if names:
        forms = [draw_form(name, rng) for name in names]
        bench, floors = sized(bench, forms, scale_of(bench.experiment, plant, is_coarse), rng)
        if is_closed:  # around the whole plant
            bench = close_loop(replace(bench, experiment=references), noise)
    outside: dict[str, Any] = {}
    if case.study == "outside":
        clean, by_input, outside = OUTSIDE[case.subject[0]](bench, rng)
        _check_visible(bench, clean, by_input)
    else:
        clean, by_input = bench.displacements(), bench.by_input()
    records = [
        Sampled(replace(r, y_um=y + n[d.cut :]), y, part, np.ones(y.size, dtype=np.bool_))
        for r, d, y, part, n in zip(
            blank_records(bench), bench.experiment.drives, clean, by_input, noise, strict=True
        )
    ]
    degraded = KINDS[int(rng.integers(len(KINDS)))] if rng.random() < _DEGRADED else ""
    records = degrade(degraded, records, rng)
    dataset = Dataset(f"records of plant {case.number}", tuple(s.record for s in records))
    straight = bench.displacements(linear=True)
    excused = {*EXCUSED.get(degraded, ())}
    if bench.history_ratio or experiment.in_motion:
        excused.add("initial_memory")
    truth = {
        "hidden": [m.to_dict() for m in bench.hidden],
        "outside": outside,
        "floors": floors,
        "protocol": protocol,
        "degraded": degraded,
        "noise_um": plant.noise_um,
        "stroke_um": plant.stroke_um,
        "samples": bench.experiment.samples,
        "rates_hz": [1.0 / d.ts_s for d in experiment.drives],
        "has_validation": experiment.has_validation,
        "in_motion": experiment.in_motion,
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
    return Prepared(dataset, truth, tuple(records))


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


def further_fields(discovery: SearchResult, prepared: Prepared, case: Case) -> dict[str, Any]:
    """Return what a result says about the residual, sampling and the data, and the true residual."""
    document = discovery.to_dict()
    names = ("left", "findings", "sampling", "undecided")
    fields = {name: document[name] for name in names if name in document}
    forms = {step["effect"]: step["form"] for step in document.get("steps", []) if step.get("form")}
    return fields | {
        "numerical_floor_um": discovery.numerical_floor_um,
        "forms": forms,
        "true_left": true_residual(discovery, prepared.records, case.subject),
    }


FOREIGN = Source(
    "foreign", "foreign_effects", Path("studies/results/foreign"), NUMBERS, EFFECTS, make_cases,
    prepare, further_fields, time.process_time,
)  # fmt: skip
