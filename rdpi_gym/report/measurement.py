"""Measured records before any model: their chart and their page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.report.chart import Axis, Chart, Panel, Series, side_by_side
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.style import MEASURED, MUTED, PALETTE
from rdpi_gym.report.thin import thin_index
from rdpi_gym.report.traces import DISPLACEMENT_UM, TIME
from rdpi_gym.support.arrays import Array

_MOST_SAMPLES = 60_000
_INPUT = Axis("{Input} ({input_unit})")
_OUTPUT = Axis(DISPLACEMENT_UM)
_NAMED = 8
"""Most records that the legend names."""


def records_chart(records: Sequence[Record]) -> Chart:
    """Draw displacement over time and over voltage, all records in the same panels."""
    moving = [record for record in records if not record.is_quiet]
    several = len(moving) > 1
    over_time, loops = [], []
    for i, record in enumerate(moving):
        k = thin_index(record.u_V, record.y_um)
        colour = PALETTE[i % len(PALETTE)] if several else MEASURED
        name = record.name if several and len(moving) <= _NAMED else ""
        y = record.y_um[k]
        over_time.append(Series(record.t_s[k], y, name, colour, width=1.1))
        loops.append(Series(record.u_V[k], y, colour=colour, width=1.1))
    return side_by_side([Panel(over_time, TIME, _OUTPUT), Panel(loops, _INPUT)])


def write_data_page(path: Path | str, dataset: Dataset) -> Path:
    """Write the records of a data set as a self-contained page."""
    samples = max(500, min(3000, _MOST_SAMPLES // len(dataset.records)))
    table = pd.DataFrame(
        [
            {
                "record": r.name,
                "role": "quiet" if r.is_quiet else r.role,
                "samples": r.t_s.size,
                "ts_s": r.ts_s,
                "duration_s": float(r.t_s[-1] - r.t_s[0]),
                "lowest_u_V": float(np.min(r.u_V)),
                "highest_u_V": float(np.max(r.u_V)),
                "lowest_y_um": r.y_range_um[0],
                "highest_y_um": r.y_range_um[1],
                "note": r.note,
            }
            for r in dataset.records
        ]
    )
    keep = (dataset.title, dataset.quantities.words, *(r.name for r in dataset.records))
    keep = (*keep, *(r.note for r in dataset.records))
    described = dataset.quantities.said(dataset.describe(), keep).splitlines()[1:]
    sections = [
        Section(
            "Each record",
            "{Input} and {output} over time, and the loops that they make. "
            "Drag over a stretch to enlarge it, double-click to return.",
            {record.name: _record_chart(record, samples) for record in dataset.records},
            table,
        ),
        Section(
            "How the records were read",
            "\n".join(f"- {line.strip()}" for line in described),
        ),
    ]
    moving = sum(not record.is_quiet for record in dataset.records)
    summary = (
        f"{len(dataset.records)} records, {moving} of them with a {{input}} that moves; "
        f"{len(dataset.train)} to fit, {len(dataset.validation)} to validate on."
    )
    return write_page(path, dataset.title, summary, sections, dataset.quantities)


def _record_chart(record: Record, samples: int) -> Chart:
    k = thin_index(record.u_V, record.y_um, samples=samples)
    t, u, y = record.t_s[k], record.u_V[k], record.y_um[k]

    def line(x: Array, values: Array, colour: str) -> list[Series]:
        return [Series(x, values, colour=colour, width=1.0)]

    panels = [
        Panel(line(t, y, MEASURED), y=_OUTPUT),
        Panel(line(u, y, MEASURED), _INPUT, _OUTPUT, column=2, rows=2),
        Panel(line(t, u, MUTED), TIME, _INPUT, row=2),
    ]
    return Chart(panels, 460, widths=(0.58, 0.42), row_gap=0.08)
