"""Which sizes of effects can be seen on an experiment, and which effects it cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.foreign_effects.chain import Bench
from benchmarks.foreign_effects.forms import Form, Mechanism, Scale, mechanism
from rdpi_gym.diagnosis.search.separability import separability, typical_effects
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.draws import VISIBLE, MaskedError
from rdpi_gym.virtual_lab.visibility import left_over

_ATTEMPTS = 14
_WANTED = (3.5, 40.0)  # noise floors, of which one is drawn for each effect
_STEPS = (1.25, 3.0)  # least and largest factor on a size that is too small
_LOOKED_AT = 5_000  # samples of all records
_GROWN = 1.1  # the direction in which another effect may be refitted


def blank_records(bench: Bench) -> list[Record]:
    """Records of the commands; the displacement is a placeholder."""
    found = []
    for drive, start in zip(bench.taken.drives, bench.starts_s(), strict=True):
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
    """What a refit of the base model leaves of a difference, on the record that shows most (µm rms)."""
    every = max(1, sum(r.u_V.size for r in records) // _LOOKED_AT)
    plant, span = bench.plant.model(), bench.plant.span_V
    return max(left_over(plant, (), span, records, differences, others, every).values())


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
