"""Foreign truth: plants, effects and protocols in other forms than the package's own, and degraded records."""

from __future__ import annotations

import math
import tempfile
import time
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.effect_discovery.cases import Case, Prepared, Sampled, Source
from benchmarks.effect_discovery.forms import (
    EFFECTS,
    TIMED,
    Form,
    Mechanism,
    Scale,
    UnfitError,
    draw_form,
    mechanism,
    scale_of,
)
from benchmarks.effect_discovery.plants import OUTSIDE, Bench, close_loop, draw_plant, noise_of
from benchmarks.effect_discovery.protocols import PROTOCOLS, draw_experiment
from rdpi_gym.diagnosis.results import SearchResult, View
from rdpi_gym.diagnosis.search.separability import separability, typical_effects
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record, load
from rdpi_gym.measurement.record import BoolArray
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.virtual_lab.draws import VISIBLE, MaskedError, refit_residuals

# --- degradations by instruments and files ---

Degrade = Callable[[Sampled, np.random.Generator], Sampled]


def _changed(s: Sampled, y: Array, bad: BoolArray) -> Sampled:
    return replace(s, record=replace(s.record, y_um=y), is_sound=s.is_sound & ~bad)


def _spikes(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let one sample in a hundred be far off, by up to half of the stroke."""
    y = s.record.y_um.copy()
    bad = rng.random(y.size) < 0.01
    far = np.ptp(y) * np.exp(rng.uniform(np.log(0.01), np.log(0.5), y.size))
    y[bad] += (far * rng.choice([-1.0, 1.0], y.size))[bad]
    return _changed(s, y, bad)


def _dropouts(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let the sensor hold its value, or show zero, one to three times for 5 to 50 ms."""
    y, bad = s.record.y_um.copy(), np.zeros(s.record.y_um.size, dtype=np.bool_)
    is_zero = bool(rng.random() < 0.5)
    for _ in range(int(rng.integers(1, 4))):
        length = max(3, round(rng.uniform(0.005, 0.05) / s.record.ts_s))
        length = min(length, y.size // 20)
        start = int(rng.integers(y.size // 10, y.size - length))
        y[start : start + length] = 0.0 if is_zero else y[start]
        bad[start : start + length] = True
    return _changed(s, y, bad)


def _clipped_output(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let the sensor's converter end within the stroke, on one side or both."""
    y = s.record.y_um
    low, high = np.quantile(y, [rng.uniform(0.0, 0.06), 1.0 - rng.uniform(0.01, 0.08)])
    clipped = np.clip(y, low, high)
    return _changed(s, clipped, clipped != y)


def _clipped_input(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let the converter that records the command end within its range; the plant saw the whole."""
    u = s.record.u_V
    high = float(np.quantile(u, 1.0 - rng.uniform(0.01, 0.06)))
    clipped = np.minimum(u, high)
    sound = s.is_sound & (clipped == u)
    return replace(s, record=replace(s.record, u_V=clipped), is_sound=sound)


def _apart(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let u and y be one sample apart, either way round."""
    return _shifted(s, 1.0 if rng.random() < 0.5 else -1.0, 0.0)


def _skew(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let the clock of y run fast or slow by 5 to 50 ppm, in steps of whole samples."""
    return _shifted(s, 0.0, rng.uniform(5e-6, 5e-5) * (1.0 if rng.random() < 0.5 else -1.0))


def _shifted(s: Sampled, samples: float, skew: float) -> Sampled:
    k = np.arange(s.record.y_um.size)
    at = np.clip(np.round(k - samples - skew * k), 0, k[-1]).astype(np.int64)
    return replace(
        s, record=replace(s.record, y_um=s.record.y_um[at]), clean_um=s.clean_um[at],
        by_input_um=s.by_input_um[at],
    )  # fmt: skip


def _differ(a: Sampled, b: Sampled) -> bool:
    """Whether two records differ at any sample."""
    return not all(
        np.array_equal(getattr(a.record, name), getattr(b.record, name)) for name in ("u_V", "y_um")
    )


DEGRADATIONS: Mapping[str, Degrade] = {
    "spikes": _spikes,
    "dropouts": _dropouts,
    "clipped output": _clipped_output,
    "clipped input": _clipped_input,
    "one sample apart": _apart,
    "clock skew": _skew,
}
"""Degradations of a record's samples, by name."""

CLOCKS: tuple[str, ...] = ("rounded stamps", "jittered stamps", "missing rows")
"""Degradations on the way through a file."""

KINDS: tuple[str, ...] = (*DEGRADATIONS, *CLOCKS)
"""All degradations."""

# What may be named without being wrong, as it describes what was done.
EXCUSED: Mapping[str, tuple[str, ...]] = {"one sample apart": ("delay",)}


def degrade(kind: str, records: list[Sampled], rng: np.random.Generator) -> list[Sampled]:
    """Do one of :data:`DEGRADATIONS` to every record; of a clock shift, the same to all."""
    if kind not in DEGRADATIONS:
        return records
    seed = int(rng.integers(2**31))
    is_clock = kind in ("one sample apart", "clock skew")
    return [
        DEGRADATIONS[kind](s, np.random.default_rng(seed if is_clock else [seed, k]))
        for k, s in enumerate(records)
    ]


def through_files(kind: str, dataset: Dataset, rng: np.random.Generator) -> Dataset:
    """Write records to files whose stamps or rows are not sound, and read them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        roles = "".join(f'[records."{r.name}"]\nrole = "{r.role}"\n' for r in dataset.records)
        write_atomic(folder / "dataset.toml", roles)
        for r in dataset.records:
            t, y, kept = r.t_s.copy(), r.y_um.copy(), np.ones(r.t_s.size, dtype=np.bool_)
            if kind == "jittered stamps":
                t[1:-1] += rng.uniform(-0.1, 0.1, t.size - 2) * r.ts_s
            if kind == "missing rows":
                bad = rng.integers(10, t.size - 10, max(4, t.size // 400))
                kept[bad[::2]] = False
                y[bad[1::2]] = np.nan
            # rounded stamps have the fewest digits of which no two are the same
            digits = int(np.ceil(-np.log10(r.ts_s) - 1e-9)) if kind == "rounded stamps" else 9
            columns = zip(t[kept], r.u_V[kept], y[kept], strict=True)
            rows = [f"{a:.{digits}f},{b:.9g},{c:.9g}" for a, b, c in columns]
            write_atomic(folder / f"{r.name}.csv", "\n".join(["t,u,y", *rows, ""]))
        return replace(load(folder), title=dataset.title)


# --- the residual of a model against the truth ---

_GAIN = "gain_drift"
_MOST_MOVED = 4  # samples


def true_residual(
    discovery: SearchResult, records: Sequence[Sampled], hidden: Collection[str] = ()
) -> dict[str, float | None]:
    """Compare a final model with the displacement that no sensor has read, on validation records."""
    plant, by_name = discovery.plant, {s.record.name: s for s in records}
    timed = any(e.name in TIMED for e in plant.effects)
    clean, by_input, count = 0.0, 0.0, 0
    for view in discovery.views:
        if view.role != "validation" or view.name not in by_name:
            continue
        s = by_name[view.name]
        clock = _clock(view, s)
        t = clock - s.record.ts_s * _moved_samples(view, s, clock)
        sound = np.interp(view.t_s, t, s.is_sound.astype(np.float64)) > 0.99
        known = (view.t_s > t[0] - 0.1 * s.record.ts_s) & (view.t_s < t[-1] + 0.1 * s.record.ts_s)
        counted = (view.counted > 0.5) & sound & known
        if not counted.any():
            continue
        model = view.models_um[list(view.models_um)[-1]]
        truth, part = (np.interp(view.t_s, t, y) for y in (s.clean_um, s.by_input_um))
        clean += _square(truth - model, counted)
        if _GAIN in hidden:
            part = _at_mean_gain(truth, part, counted)
        by_clock = _by_clock(plant, view, s.record.ts_s, counted) if timed else np.zeros_like(model)
        by_input += _square(part - (model - by_clock), counted)
        count += int(counted.sum())
    if not count:
        return {"clean_um": None, "by_input_um": None}
    return {"clean_um": math.sqrt(clean / count), "by_input_um": math.sqrt(by_input / count)}


def _clock(view: View, s: Sampled) -> Array:
    """Times of the samples as the result counts them (s): stamps that were rounded run otherwise."""
    return view.t_s if view.t_s.size == s.record.t_s.size else s.record.t_s


def _moved_samples(view: View, s: Sampled, clock: Array) -> float:
    """Return by how many samples preprocessing moved y ahead, u left alone."""
    counted = view.counted > 0.5
    given = np.interp(view.t_s, clock, s.record.y_um)
    if not counted.any() or np.allclose(view.y_um[counted], given[counted]):
        return 0.0
    shifts = np.linspace(-_MOST_MOVED, _MOST_MOVED, 20 * _MOST_MOVED + 1)
    left = [
        _square(view.y_um - np.interp(view.t_s + d * s.record.ts_s, clock, s.clean_um), counted)
        for d in shifts
    ]
    return float(shifts[int(np.argmin(left))])


def _by_clock(plant: PlantModel, view: View, ts_s: float, counted: BoolArray) -> Array:
    """Contribution of a model's time-driven effects to its displacement (µm)."""
    record = Record(view.name, view.t_s, view.u_V, view.y_um, ts_s=ts_s)

    def simulated(left_out: Sequence[str]) -> Array:
        effects = tuple(e for e in plant.effects if e.name not in left_out)
        return np.asarray(simulate_effects([Variant(plant.hysteresis, effects)], record)[:, 0])

    still = simulated(TIMED)
    if any(e.name == _GAIN for e in plant.effects):
        still = _at_mean_gain(simulated([name for name in TIMED if name != _GAIN]), still, counted)
    return np.asarray(simulated(()) - still)


def _at_mean_gain(whole: Array, still: Array, counted: BoolArray) -> Array:
    """Displacement without a drift of the gain, at the gain that it has in the middle of a record.

    Without it, a gain that has drifted before the record would count as a function of the clock.
    """
    x, y = still[counted] - still[counted].mean(), whole[counted] - whole[counted].mean()
    return np.asarray(still * float(x @ y) / max(float(x @ x), 1e-300))


def _square(error: Array, counted: BoolArray) -> float:
    """Sum of squares about the mean, over the samples that count."""
    e = error[counted]
    return float(np.sum((e - e.mean()) ** 2))


# --- draws ---

_ATTEMPTS = 14
_WANTED = (3.5, 40.0)  # noise floors, of which one is drawn for each effect
_STEPS = (1.25, 3.0)  # least and largest factor on a size that is too small
_LOOKED_AT = 5_000  # samples of all records
_GROWN = 1.1  # the direction in which another effect may be refitted


def blank_records(bench: Bench) -> list[Record]:
    """Records of the commands; the displacement is a placeholder."""
    return [
        Record(d.name, t, u, u, ts_s=d.ts_s, role=d.role)
        for d, t in zip(bench.experiment.drives, bench.clocks_s(), strict=True)
        for u in [d.command_V[d.cut :]]
    ]


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
        bench, floors = sized(
            bench, forms, scale_of(bench.experiment, plant.stroke_um, is_coarse), rng
        )
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
    made = degrade(degraded, records, rng)
    if degraded in DEGRADATIONS and not any(map(_differ, records, made)):
        degraded = ""  # such as a skew of less than half a sample
    records = made
    dataset = Dataset(f"records of plant {case.number}", tuple(s.record for s in records))
    straight = bench.displacements(linear=True)
    excused = {*EXCUSED.get(degraded, ())}
    # where the hysteresis of outsiders is at rest (V): not at 0, it has a memory of what was before
    rest_V = {
        "bouc-wen": [drive.fine_V[0] for drive in bench.experiment.drives],
        "duhem": [plant.centre_V],
    }
    if bench.history_ratio or experiment.in_motion or any(rest_V.get("".join(case.subject), ())):
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
    """Return what reading and a result say about data, sampling, residual, and the true residual."""
    document = discovery.to_dict()
    names = ("left", "findings", "sampling", "undecided")
    fields = {name: document[name] for name in names if name in document}
    forms = {step["effect"]: step["form"] for step in document.get("steps", []) if step.get("form")}
    return fields | {
        "numerical_floor_um": discovery.numerical_floor_um,
        "core": discovery.core.kind,
        # records of which reading states that their times or rows are not sound
        "remarked": sum(bool(r.remarks) for r in prepared.dataset.records),
        "forms": forms,
        "true_left": true_residual(discovery, prepared.records, case.subject),
    }


FOREIGN = Source(
    "foreign", "foreign_effects", Path("studies/results/foreign"), NUMBERS, EFFECTS, make_cases,
    prepare, further_fields, time.process_time,
)  # fmt: skip
