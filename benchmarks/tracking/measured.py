"""Real input: how far a feedforward's command is from the voltage that was really applied."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from baselines import FULL_PREVIEW, ControllerFactory, make_controller
from benchmarks.tracking.controllers import Made, is_learned
from benchmarks.tracking.episode import ERROR, one_line
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.measurement import Dataset, Record, example_folder, load
from rdpi_gym.plant import RDPI, Plant, PlantModel
from rdpi_gym.plant.cores.play import play_columns
from rdpi_gym.support.arrays import Array

BoolArray: TypeAlias = NDArray[np.bool_]

COLUMNS = (
    "controller", "belief", "record", "ts_s", "samples",
    "rms_V", "rms_percent", "max_V", "rms_um", "offset_um", "status",
)  # fmt: skip
MEMORY_S = 1.0
"""Time (s) at the beginning of a record that is simulated but not counted: the first cycle, in
which the compensator's memory becomes the plant's."""
SHOWN_S = 3.0


@dataclass(frozen=True)
class MeasuredScores:
    """The feedforwards on measured records."""

    note: str  # how they were made, or why there are none
    # columns :data:`COLUMNS`: difference between command and applied voltage (V, percent of the
    # applied peak to peak), the same times the local gain (µm), and the sensor's zero (µm)
    table: pd.DataFrame = field(default_factory=partial(pd.DataFrame, columns=list(COLUMNS)))
    # of each record, its last seconds: time (s), applied voltage and each command (V)
    traces: dict[str, dict[str, Array]] = field(default_factory=dict)


def score_measured(
    controllers: Sequence[str],
    belief: PlantModel,
    factories: Mapping[str, ControllerFactory] | None = None,
) -> MeasuredScores:
    """Score every feedforward among `controllers` on the measured PICMA records.

    The measured displacement is the reference, and no plant is scored. One constant of each record
    is free, the sensor's zero: the mean of what is measured above the belief's response to the
    applied voltage. It is taken out of the displacement before a controller sees it.
    """
    return score_records(load(example_folder("picma")), controllers, belief, factories)


def score_records(
    data: Dataset,
    controllers: Sequence[str],
    belief: PlantModel,
    factories: Mapping[str, ControllerFactory] | None = None,
) -> MeasuredScores:
    """Score feedforwards on the records of a data set, as :func:`score_measured` does."""
    made_by: Mapping[str, ControllerFactory] = factories or {}
    rows: list[dict[str, object]] = []
    traces: dict[str, dict[str, Array]] = {}
    for record in data.records:
        if record.is_quiet:
            continue
        layout = ObservationLayout.for_plant(belief, record.ts_s)
        gain = local_gain(belief.hysteresis, record.u_V, record.ts_s)
        counted = record.error_mask & (record.t_s >= record.t_s[0] + MEMORY_S)
        zero_um = _sensor_zero(belief, record, counted)
        reference = (record.y_um - zero_um)[:, None]
        kept = slice(max(0, record.t_s.size - round(SHOWN_S / record.ts_s)), None)
        shown = {"t_s": record.t_s[kept], "applied": record.u_V[kept]}
        for name in controllers:
            if name == FULL_PREVIEW or is_learned(name) or isinstance(made_by.get(name), Made):
                continue  # what answers observations has none here, and the bound no true plant
            row: dict[str, object] = {
                "controller": name, "belief": belief.name, "record": record.name, "ts_s": record.ts_s,
            }  # fmt: skip
            try:
                command_block = getattr(
                    make_controller(made_by.get(name, name), belief, layout), "command_block", None
                )
                if command_block is None:
                    continue
                command = np.asarray(command_block(reference))[:, 0]
                shown[name] = command[kept]
                rows.append(
                    row | _difference(command, record.u_V, gain, counted) | {"offset_um": zero_um}
                )
            except Exception as error:  # a user's controller may raise anything; the others go on
                reason = one_line(f"{type(error).__name__}: {error}")
                rows.append(row | {"status": f"{ERROR}: {reason}"})
        traces[record.name] = shown
    note = f"Records: {', '.join(traces)} of {data.title}."
    return MeasuredScores(note, pd.DataFrame(rows, columns=list(COLUMNS)), traces)


def _sensor_zero(belief: PlantModel, record: Record, counted: BoolArray) -> float:
    modelled = Plant(belief, record.ts_s).simulate(record.u_V)
    return float(np.mean((record.y_um - modelled)[counted]))


def _difference(
    command: Array, applied: Array, gain: Array, counted: BoolArray
) -> dict[str, object]:
    difference = (command - applied)[counted]
    if not np.isfinite(difference).all():
        raise ValueError("its command is not finite")
    rms = float(np.sqrt(np.mean(difference**2)))
    return {
        "samples": int(counted.sum()),
        "rms_V": rms,
        "rms_percent": 100.0 * rms / float(np.ptp(applied[counted])),
        "max_V": float(np.abs(difference).max()),
        "rms_um": float(np.sqrt(np.mean((gain[counted] * difference) ** 2))),
        "status": "ok",
    }


def local_gain(model: RDPI, u_V: Array, ts_s: float) -> Array:
    """Slope dy/du (µm/V) of the model along a record: a_0 plus the weights of the plays that slide."""
    u = np.ascontiguousarray(u_V, dtype=np.float64)
    rate = np.diff(u, prepend=u[0]) / ts_s
    columns = np.empty((model.n, u.size))
    memory = np.zeros(model.n)
    play_columns(u, rate, np.array(model.thresholds_V), model.delta2_s, memory, columns)
    slides = np.diff(columns, axis=1, prepend=0.0) != 0.0
    return np.asarray(model.a0 + np.array(model.weights[1:]) @ slides, dtype=np.float64)
