"""Residuals of a model on records, one free offset a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rdpi_gym.identification.jacobian import Variant, free_response, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.plant import Plant, PlantModel, settled_memory
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


@dataclass(frozen=True, eq=False)
class RecordResidual:
    """Residual of a model on a record, with one free offset."""

    record: Record
    simulated_um: Array  # Displacement of the model (µm), its own offset included, ``(T,)``
    offset_um: float  # Offset added to it (µm): the mean difference over the samples that count
    error_um: Array  # measured - simulated - offset (µm) at every sample, ``(T,)``
    rmse_um: float  # Its root mean square (µm) over the samples that count

    @property
    def counted(self) -> int:
        """Number of samples that count."""
        return int(np.count_nonzero(self.record.error_mask))


def simulate_record(
    model: PlantModel, record: Record, extremum_V: float | None = None
) -> RecordResidual:
    """Run a model over a record's command and compare, one offset free.

    Where nobody recorded what came before, slow elements begin as the record shows.

    Parameters
    ----------
    model
        The model.
    record
        The record; its masked samples are simulated and not counted.
    extremum_V
        Command (V) at which the plant had turned before the record began; None is the model's
        own initial memory, by default the paper's: it has never moved.

    Raises
    ------
    InputError
        No sample of the record counts.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> u = 10 * np.sin(np.linspace(0, 12, 500))
    >>> y = Plant(named_plant("P5"), 1e-3).simulate(u) + 3.0
    >>> left = simulate_record(named_plant("P5"), Record("a", np.arange(500) * 1e-3, u, y, ts_s=1e-3))
    >>> round(left.offset_um, 6), left.rmse_um < 1e-12
    (3.0, True)
    """
    mask = record.error_mask
    if not mask.any():
        raise InputError(
            f"record {record.name} has no sample that counts; shorten skip_s or mask_s"
        )
    plant = Plant(model, record.ts_s)
    if extremum_V is not None:
        plant.reset(memory=settled_memory(model.hysteresis.thresholds_V, [extremum_V]))
    simulated = plant.simulate(record.with_history.u_V)[record.before_V.size :]
    simulated = simulated + free_response(record.y_um - simulated, record, model.effects)
    difference = record.y_um - simulated
    offset = float(difference[mask].mean())
    error = difference - offset
    return RecordResidual(
        record=record,
        simulated_um=simulated,
        offset_um=offset,
        error_um=error,
        rmse_um=float(np.sqrt(np.mean(error[mask] ** 2))),
    )


def rms_over(rmse_um: Sequence[float], counted: Sequence[int]) -> float:
    """Return the error (µm rms) over records from that of each, weighted by its samples that count.

    The training and the validation error, wherever they are stated, are this of the records of their
    role: measured minus model, simulated from a record's first sample, one offset free in each record,
    its noise included.
    """
    return float(np.sqrt(np.average(np.square(rmse_um), weights=counted)))


def pooled_rmse(residuals: Sequence[RecordResidual]) -> float:
    """Root mean square error (µm) of several records, each weighted by its samples.

    Raises
    ------
    InputError
        No record.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> u = np.linspace(0, 1, 100)
    >>> record = Record("a", u, u, 0.729 * u, ts_s=0.01)  # below the first threshold of P5
    >>> round(pooled_rmse([simulate_record(named_plant("P5"), record)]), 9)
    0.0
    """
    if not residuals:
        raise InputError("no record to compare; give at least one")
    return rms_over([each.rmse_um for each in residuals], [each.counted for each in residuals])


def validation_rmse(
    model: PlantModel, records: Sequence[Record], extrema_V: Mapping[str, float] | None = None
) -> float:
    """Root mean square error (µm) of a model on records, one offset free in each.

    Parameters
    ----------
    model
        The model.
    records
        The records.
    extrema_V
        Memory extremum (V) by record name, where one is known.

    Raises
    ------
    InputError
        No record, or one of which no sample counts.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> u = 10 * np.sin(np.linspace(0, 12, 500))
    >>> record = Record("a", np.arange(500) * 1e-3, u, np.zeros(500), ts_s=1e-3)
    >>> validation_rmse(named_plant("P5"), [record]) > 1
    True
    """
    extrema = extrema_V or {}
    return pooled_rmse([simulate_record(model, r, extrema.get(r.name)) for r in records])


def with_validated(
    rmse_um: Mapping[str, float], validated: Sequence[RecordResidual]
) -> dict[str, float]:
    """Return errors of records that were fitted with those of others, a held-out part under its name."""
    rmse = dict(rmse_um)
    for left in validated:
        name = left.record.name
        rmse[f"{name} (validation)" if name in rmse else name] = left.rmse_um
    return rmse


PIECES = 8
"""Pieces that a record is cut into: what the spread of an improvement is judged by."""
_DRAWS = 400


def model_output(variant: Variant[Any], record: Record) -> Array:
    """Return what a model makes of a record (µm), ``(T,)``, free responses of unknown states included."""
    y_um = simulate_effects([variant], record)[:, 0]
    return np.asarray(y_um + free_response(record.y_um - y_um, record, variant.effects))


def centred_residual(variant: Variant[Any], record: Record) -> Array:
    """Return what a model leaves of the samples that count (µm), offset free."""
    left = (record.y_um - model_output(variant, record))[record.error_mask]
    return np.asarray(left - left.mean())


def pieces_of(lefts: Sequence[Array]) -> Array:
    """Return the mean squares (µm²) of the pieces of records, ``(R, PIECES)``."""
    pieces = []
    for left in lefts:
        squares = left**2
        parts = np.array_split(squares, PIECES)  # empty ones where there are few samples
        pieces.append([(part if part.size else squares).mean() for part in parts])
    return np.array(pieces)


def beats(loser: Array, winner: Array, rng: np.random.Generator) -> float:
    """Return the share of bootstrap draws of pieces in which the winner is better."""
    difference = (loser - winner).ravel()
    draws = rng.integers(0, difference.size, (_DRAWS, difference.size))
    return float(np.mean(difference[draws].mean(axis=1) > 0.0))
