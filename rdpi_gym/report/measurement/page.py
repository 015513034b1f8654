"""The page of measured records, before any model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from plotly.subplots import make_subplots

from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.style import MEASURED, MUTED, styled
from rdpi_gym.report.thin import thin_index

_MOST_SAMPLES = 60_000


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
            {record.name: _traces(record, samples) for record in dataset.records},
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


def _traces(record: Record, samples: int) -> Any:
    figure = make_subplots(
        rows=2,
        cols=2,
        specs=[[{}, {"rowspan": 2}], [{}, None]],
        column_widths=[0.58, 0.42],
        horizontal_spacing=0.11,
        vertical_spacing=0.08,
    )
    k = thin_index(record.u_V, record.y_um, samples=samples)
    t, u, y = record.t_s[k], record.u_V[k], record.y_um[k]
    lines = ((t, y, MEASURED, 1, 1), (t, u, MUTED, 2, 1), (u, y, MEASURED, 1, 2))
    for x, values, colour, row, col in lines:
        figure.add_scatter(
            x=x, y=values, line={"color": colour, "width": 1}, showlegend=False, row=row, col=col
        )
    figure.update_xaxes(title_text="Time (s)", row=2, col=1)
    figure.update_xaxes(title_text="{Input} ({input_unit})", row=1, col=2)
    figure.update_yaxes(title_text="{Output} ({output_unit})", row=1)
    figure.update_yaxes(title_text="{Input} ({input_unit})", row=2, col=1)
    return styled(figure, 460)
