"""The next experiment: what would settle what these records leave open, in the order of worth."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from rdpi_gym.diagnosis.hygiene import Finding
from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.diagnosis.results import Candidate
from rdpi_gym.diagnosis.search.separability import next_experiment
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect

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
"""What lifts a limit of the records, in the order of worth."""


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
