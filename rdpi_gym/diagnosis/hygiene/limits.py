"""What records cannot tell in principle, however good the model is."""

from __future__ import annotations

import numpy as np

from rdpi_gym.diagnosis.features.half_cycles import half_cycles, vary
from rdpi_gym.diagnosis.features.noise import repeat_noise
from rdpi_gym.diagnosis.features.rests import find_rests
from rdpi_gym.identification.plausibility import LITTLE, linear_share
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.support.words import digits

FEW_SAMPLES = 500
"""Fewer samples to fit than this, and small effects are lost in the freedom of the fit."""
_FEWEST_OTHERS = 3  # fewer are how a record begins and ends
_SMALL = 0.1  # of the widest swing
_LONG_S, _LONG = 0.05, 20.0  # a rest: seconds, or moves of a record


def limits(dataset: Dataset) -> tuple[str, ...]:
    """Say what these records cannot tell, one sentence each; none where they can tell everything."""
    records = [r for r in dataset.records if not r.is_quiet and r.role != "test"]
    if not records:
        return ("No record moves: nothing can be told of any effect.",)
    said = []
    train = dataset.train
    samples = sum(int(r.error_mask.sum()) for r in train)
    if samples < FEW_SAMPLES:
        said.append(
            f"{samples} samples to fit: small effects cannot be told from the freedom of the fit "
            f"({FEW_SAMPLES} or more would do)."
        )
    if train and (follows := linear_share(train)) < LITTLE:
        share = digits(100.0 * max(follows, 0.0))
        said.append(
            f"{share} % of the displacement's power follows the command: check the columns and the "
            "sensor before any effect is believed."
        )
    if len(records) == 1:
        said.append(
            "1 record: nothing is held out but a part of it, so what differs between experiments "
            "cannot be told."
        )
    return (*said, *_of_commands(records))


def _of_commands(records: list[Record]) -> list[str]:
    cycles = [half_cycles(r.u_V, r.ts_s) for r in records]
    swings = np.concatenate([c.amplitude_V[c.whole] for c in cycles])
    paces = np.concatenate([c.frequency_hz[c.whole] for c in cycles])
    span_V = max(float(np.ptp(r.u_V)) for r in records)
    rests = any(
        rest.move_V and rest.duration_s > max(_LONG_S, _LONG * rest.record.ts_s)
        for r in records
        for rest in find_rests(r, span_V)
    )
    said = []
    if swings.size < _FEWEST_OTHERS and not rests:
        said.append(
            f"{swings.size} whole half-cycles: memory at several depths cannot be told from the "
            "shape of one branch."
        )
    elif swings.size:
        if not vary(paces):
            pace = digits(float(np.median(paces)), 3)
            said.append(
                f"1 frequency ({pace} Hz): a lag, a delay, a resonance and the rate law look alike."
            )
        if not vary(swings):
            said.append(
                "1 amplitude: whether the gain depends on amplitude or on bias, and memory at "
                "other depths, cannot be told."
            )
    if not rests:
        said.append("No rest after a move: creep, drift and slow recovery cannot be told apart.")
    if min(float(np.ptp(r.u_V)) for r in records) > _SMALL * span_V:
        said.append("No small signals: lags cannot be told from the motion of plays.")
    if all(repeat_noise(r) is None for r in records):
        said.append(
            "No repetition: what does not follow from the command cannot be told from what the "
            "model lacks."
        )
    return said
