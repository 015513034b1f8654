"""Tests without a model against what a fit says: a test that denies an effect vetoes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rdpi_gym.diagnosis.checks import Check, run_checks
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Dataset


def hear(
    dataset: Dataset,
    measured: Sequence[Check],
    variant: Variant,
    effect: str,
    noise_um: float,
    seed: int,
) -> str | None:
    """Compare the tests on the measurement with the same tests on the model with the effect.

    Parameters
    ----------
    dataset
        The measurement.
    measured
        Its tests.
    variant
        The model with the effect.
    effect
        Its name.
    noise_um
        White noise (µm rms) of the simulated records.
    seed
        Of that noise.

    Returns
    -------
    str or None
        A sentence where a test denies the effect that would have shown it.

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
    return f"a test without a model denies it: {said[denied[0].name].sentence}"
