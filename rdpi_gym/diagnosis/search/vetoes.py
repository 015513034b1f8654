"""Tests without a model against a fit: one that denies an effect vetoes it, a blind one caps its confidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rdpi_gym.diagnosis.checks import Check, run_checks
from rdpi_gym.diagnosis.results import Candidate
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import Effect

MOST_UNSEEN = 0.5
"""Largest confidence in an effect that no test without a model can see in the records."""


def capped(
    candidate: Candidate, measured: Sequence[Check], catalogue: Mapping[str, type[Effect]]
) -> Candidate:
    """Return a candidate no surer than it can be where no test without a model can see its effect.

    Notes
    -----
    A fit names an effect from its trace among everything else. Where each test that could show
    that trace by itself says ``cannot tell``, or that the command does not hold what would show
    it, a wrong form of something else may leave the same trace.
    """
    said = {check.name: check for check in measured}
    kind = catalogue.get(candidate.effect)
    tests = [said[name] for name in (kind.seen_by if kind else ()) if name in said]
    if not tests or candidate.confidence <= MOST_UNSEEN or any(map(_sees, tests)):
        return candidate
    remark = template(
        "unseen", percent=100.0 * MOST_UNSEEN, effect=candidate.effect, reason=tests[0].found
    )
    return replace(candidate, confidence=MOST_UNSEEN, remarks=(*candidate.remarks, remark))


def _sees(check: Check) -> bool:
    """Whether a test tells an effect's presence or absence.

    A test of the commands says yes where something is missing.
    """
    return check.zone == "no" or (check.zone == "yes" and bool(check.suggests))


def hear(
    dataset: Dataset,
    measured: Sequence[Check],
    variant: Variant[Core],
    effect: str,
    noise_um: float,
    seed: int,
) -> str | None:
    """Compare the tests on the measurement with the same tests on the model with the effect.

    Notes
    -----
    A threshold alone would veto an effect that is there and small. So the model with the effect
    goes through the same tests: only where they say yes to what the fit claims, and no to what was
    measured, do they contradict the fit.
    """
    said = {check.name: check for check in measured}
    rng = np.random.default_rng(seed)
    records = []
    for record in dataset.records:
        if record.is_quiet:
            records.append(record)
            continue
        y = simulate_effects([variant], record)[:, 0]
        y += float(np.mean((record.y_um - y)[record.error_mask]))
        records.append(replace(record, y_um=y + noise_um * rng.standard_normal(y.size)))
    claimed = run_checks(replace(dataset, records=tuple(records)))
    own = [c for c in claimed if c.zone == "yes" and c.suggests[:1] == (effect,)]
    denied = [c for c in own if said[c.name].zone == "no"]
    agreed = [c for c in own if said[c.name].zone == "yes"]
    if not denied or agreed:
        return None
    return template("vetoed", effect=effect, reason=said[denied[0].name].found)
