"""Effects that data can tell apart: directions beside the base model, and the experiment that would decide."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.diagnosis.preprocessing import Finding
from rdpi_gym.diagnosis.results import Candidate
from rdpi_gym.identification.jacobian import Neighbours, Variant, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, in_chain_order
from rdpi_gym.signals.experiments import Experiment, standard_protocol
from rdpi_gym.support.arrays import Array

# Above this cosine two effects are one class on the data.
ALIKE = 0.95
RATE = "rate-dependent threshold (δ2)"

# Experiments that show no effect which others do not show.
_NO_ADVICE = ("quiet", "triangle-slow-again")


@dataclass(frozen=True)
class Separability:
    """Directions of effects after the gains and offsets have taken what they can."""

    names: tuple[str, ...]  # effects, and the rate-dependent threshold where the core has any
    cosines: Array  # float64[E, E]: between the directions; 1 is the same
    visible_um: Array  # float64[E]: size (µm rms) of what is left of each

    def alike(self, name: str, limit: float = ALIKE) -> tuple[str, ...]:
        """Return what cannot be told from an effect at a cosine, itself left out."""
        if name not in self.names:
            return ()
        row = np.abs(self.cosines[self.names.index(name)])
        return tuple(n for n, c in zip(self.names, row, strict=True) if c > limit and n != name)

    def groups(self, noise_um: float) -> tuple[tuple[str, ...], ...]:
        """Return the classes of effects that leave a trace but not one of their own."""
        seen = [n for n, s in zip(self.names, self.visible_um, strict=True) if s > 1e-4 * noise_um]
        found: list[tuple[str, ...]] = []
        for name in seen:
            if any(name in group for group in found):
                continue
            group = (name, *(other for other in self.alike(name) if other in seen))
            if len(group) > 1:
                found.append(group)
        return tuple(found)

    def cosine(self, first: str, second: str) -> float:
        """Return the size of the cosine between two effects."""
        return float(abs(self.cosines[self.names.index(first), self.names.index(second)]))


def separability(
    records: Sequence[Record],
    hysteresis: Core,
    present: Sequence[Effect],
    effects: Mapping[str, Effect],
) -> Separability:
    """Return the angles between effects, as far as the base model does not absorb them."""
    base: Variant[Core] = Variant(hysteresis.static(), tuple(present))
    fastest = max(float(np.max(np.abs(np.diff(r.u_V)))) / r.ts_s for r in records)
    widened = hysteresis.rated_at(fastest)
    names = tuple(effects) if widened is None else (*effects, RATE)
    rated = base if widened is None else Variant(widened, base.effects)
    count = len(hysteresis.gains)
    gram, samples = np.zeros((count + len(names),) * 2), 0
    lanes = Neighbours(base, [], np.zeros(0), np.full(count, 0.1 * hysteresis.A))
    for record in records:
        counted = np.flatnonzero(record.error_mask)
        columns = lanes.derivatives(record, counted)[:, :-1]
        still = simulate_effects([base], record)[:, 0]
        moved = [_with(rated if e.slot == "rate" else base, e) for e in effects.values()]
        if widened is not None:
            moved.append(rated)
        directions = [simulate_effects([v], record)[:, 0] - still for v in moved]
        rows = np.column_stack([columns, *(d[counted] for d in directions)])
        rows -= rows.mean(axis=0)
        gram += rows.T @ rows
        samples += len(rows)
    return _angles(gram, count, names, samples)


def typical_effects(catalogue: Mapping[str, type[Effect]], scale: DataScale) -> dict[str, Effect]:
    """Return every effect at the upper end of its typical range, scaled to the data."""
    found: dict[str, Effect] = {}
    for name, kind in catalogue.items():
        start = kind.starts(scale)[0]
        sizes = {p.name: p.typical[1] for p in kind.parameters if p.neutral == 0.0}
        if kind.slot != "memory":
            found[name] = start.with_values(sizes)
    return found


def _with(base: Variant[Core], effect: Effect) -> Variant[Core]:
    others = [e for e in base.effects if e.name != effect.name]
    return replace(base, effects=in_chain_order([*others, effect]))


def _angles(gram: Array, weights: int, names: tuple[str, ...], samples: int) -> Separability:
    inner = gram[:weights, :weights]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    inverse = np.linalg.pinv(inner / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    cross = gram[:weights, weights:] / scale[:, None]
    left = gram[weights:, weights:] - cross.T @ inverse @ cross
    size = np.sqrt(np.maximum(np.diag(left), 0.0))
    norm = np.maximum(size, 1e-12)
    return Separability(names, left / np.outer(norm, norm), size / np.sqrt(max(samples, 1)))


def next_experiment(
    first: Effect,
    second: Effect,
    hysteresis: Core,
    scale: DataScale,
    made: Collection[str] = (),
) -> Notice | None:
    """Name the experiment of the standard protocol that tells two effects apart best."""
    best: tuple[float, Experiment] | None = None
    smallest_V = max(hysteresis.first_threshold_V, 0.02 * scale.span_V)
    protocol = standard_protocol(scale.centre_V, scale.span_V, smallest_V, slowness=scale.slowness)
    for experiment in protocol:
        if experiment.role == "validation" or experiment.name in (*_NO_ADVICE, *made):
            continue
        u = experiment.command_V()
        record = Record(experiment.name, experiment.times_s(), u, u, experiment.ts_s)
        found = separability([record], hysteresis, (), {first.name: first, second.name: second})
        apart = np.sqrt(max(1.0 - found.cosine(first.name, second.name) ** 2, 0.0))
        seen = apart * float(np.min(found.visible_um[:2]))
        if best is None or seen > best[0]:
            best = (seen, experiment)
    if best is None or best[0] <= 0.0:
        return None
    names = (best[1].name, first.name, second.name)
    return Notice(Code.EFFECTS_APART, names, (scale.slowness,))


_LIFTS: Mapping[Code, Code] = {
    Code.FEW_SAMPLES: Code.LONGER,
    Code.FEW_HALF_CYCLES: Code.DECAYING,
    Code.ONE_FREQUENCY: Code.RATES,
    Code.ONE_AMPLITUDE: Code.BIASES,
    Code.NO_REST: Code.HOLDS,
    Code.NO_SMALL_SIGNALS: Code.SMALL,
    Code.NO_REPETITION: Code.TWICE,
    Code.ONE_RECORD: Code.OTHER_MOTION,
}
"""Experiments that lift a limit of the records, in the order of worth."""


def what_to_measure(
    chosen: Sequence[Candidate],
    effects: Sequence[Effect],
    typical: Mapping[str, Effect],
    groups: Sequence[Sequence[str]],
    hysteresis: Core,
    scale: DataScale,
    again: Notice | None,
    findings: Sequence[Finding],
    limits: Sequence[Notice],
    is_settled: bool,
    probable: Sequence[str] = (),
    made: Collection[str] = (),
) -> Notice | None:
    """Name the experiment that would decide what these data cannot."""
    if again is not None:
        return again
    own = {effect.name: effect for effect in effects}
    pairs = [
        (own[c.effect], typical[rival])
        for c in chosen
        for rival in c.indistinguishable
        if c.effect in own and rival in typical
    ]
    # what is there against the most probable of what may stand in its place
    rivals = [typical[name] for name in probable if name in typical and name not in own]
    pairs += [(own[name], rivals[0]) for name in probable if name in own and rivals]
    if not pairs and not is_settled:
        alike = [[typical[n] for n in group if n in typical] for group in groups]
        pairs = [(group[0], group[1]) for group in alike if len(group) > 1]
    if pairs and (found := next_experiment(*pairs[0], hysteresis, scale, made)) is not None:
        return found
    if is_settled and not effects:
        return None
    steps = [finding.advice for finding in findings if finding.advice is not None]
    told = {limit.code for limit in limits}
    lifted = [Notice(lifts) for limit, lifts in _LIFTS.items() if limit in told]
    if is_settled:
        return lifted[0] if lifted else None
    return next(iter((*lifted, *steps)), None)
