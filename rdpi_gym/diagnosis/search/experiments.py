"""The next experiment: what would settle what these records leave open, in the order of worth."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

from rdpi_gym.diagnosis.hygiene import Finding
from rdpi_gym.diagnosis.results import Candidate
from rdpi_gym.diagnosis.search.separability import next_experiment
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect

# By what a limit of the records is about: what lifts it.
_LIFTS = (
    (
        "samples to fit",
        "Record longer, or faster: a few thousand samples while the command moves.",
    ),
    (
        "half-cycles",
        "Record a slow triangle that decays from the full range to zero in twenty turns.",
    ),
    (
        "frequency",
        "Record sines at four rates, up to ten times this one, their amplitude lower in proportion "
        "as they are faster.",
    ),
    ("amplitude", "Record a slow triangle that decays from the full range, and loops at three biases."),
    ("No rest", "Record steps up and down with holds from 0.05 to 50 s."),
    ("small signals", "Record a small multisine, below the first threshold, where every play sticks."),
    ("No repetition", "Record the same thing twice, at the beginning and at the end."),
    ("1 record", "Record another kind of motion in a second file, to be held out."),
)  # fmt: skip

_SINES = ("sine-10hz", "sine-50hz", "sine-100hz-half", "sine-200hz-quarter")
ASKED_FOR: Mapping[str, tuple[str, ...]] = {
    "slow triangle that decays from the full range, and loops": ("triangle-slow", "minor-loops"),
    "slow triangle that decays": ("triangle-slow",),
    "sines at four rates": _SINES,
    "one loop at four rates": _SINES,
    "steps up and down with holds": ("stairs",),
    "small multisine": ("multisine-small",),
    "the same thing twice": ("triangle-slow-again", "triangle-slow"),
    "loops within a loop": ("minor-loops",),
    "nested loops": ("minor-loops",),
    "another kind of motion": ("validation-loops",),
    "Record the standard protocol": (
        "triangle-slow", "sine-10hz", "sine-50hz", "sine-100hz-half", "multisine", "stairs",
    ),
}  # fmt: skip
"""Words of an advice, and the records of the standard protocol that it asks for."""


def asked_for(advice: str | None) -> tuple[str, ...]:
    """Return the records of the standard protocol that an advice asks for; none where it is another."""
    if advice is None:
        return ()
    named = re.search(r"of the standard protocol, ([\w-]+) \(", advice)
    if named:
        return (named[1],)
    return next((records for words, records in ASKED_FOR.items() if words in advice), ())


def what_to_measure(
    chosen: Sequence[Candidate],
    effects: Sequence[Effect],
    typical: Mapping[str, Effect],
    groups: Sequence[Sequence[str]],
    hysteresis: Core,
    scale: DataScale,
    again: str | None,
    findings: Sequence[Finding],
    limits: Sequence[str],
    is_settled: bool,
    probable: Sequence[str] = (),
    made: Collection[str] = (),
) -> str | None:
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
    steps = [finding.next_step for finding in findings if finding.next_step]
    lifted = [text for about, text in _LIFTS for limit in limits if about in limit]
    if is_settled:
        return lifted[0] if lifted else None
    return next(iter((*lifted, *steps)), None)
