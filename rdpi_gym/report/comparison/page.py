"""The page of `rdpi compare`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from rdpi_gym.diagnosis import FEW_HALF_CYCLES, Comparison
from rdpi_gym.diagnosis.checks import Check
from rdpi_gym.report import trace_figures
from rdpi_gym.report.comparison import figures, views
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.tables import format_number
from rdpi_gym.report.thin import DISPLAY_SAMPLES

MOST_RECORDS = 40
"""Records whose traces stand on the page; of more, those with the largest errors."""
_OPEN = f"Open circles rest on fewer than {FEW_HALF_CYCLES} half-cycles."
_ALL_SAMPLES = 8 * DISPLAY_SAMPLES


def write_compare_page(path: Path | str, comparison: Comparison) -> Path:
    """Write a comparison as a self-contained page."""
    found = comparison.findings
    count = len({trace.name for trace in comparison.traces})
    answer, *heads = [found[key] for key in ("overall", "far", "range") if key in found]
    points = [f"- {text}" for key, text in found.items() if key not in ("far", "range", "overall")]
    noticed = [f"- {c.sentence}" for c in comparison.checks if c.zone == "yes"]
    summary = "\n\n".join(
        [
            f"{answer} Model {comparison.model.name}, {count} "
            f"record{'s' if count > 1 else ''} of {comparison.title}.",
            *heads,
            "Where the model fails:",
            "\n".join(points),
            *(["What the data show without any model:", "\n".join(noticed)] if noticed else []),
        ]
    )
    return write_page(
        path,
        f"Model {comparison.model.name} against measurement",
        summary,
        _sections(comparison),
        comparison.quantities,
    )


def _sections(comparison: Comparison) -> list[Section]:
    found = comparison.findings
    # a record of which the last quarter is held out stands for two traces
    named = {f"{trace.name} ({trace.role})": trace for trace in comparison.traces}
    shown = trace_figures.worst_first(named, trace_figures.rms_um, most=MOST_RECORDS)
    samples = max(500, min(DISPLAY_SAMPLES, _ALL_SAMPLES // len(shown)))
    several = len(comparison.traces)
    chosen = "" if several == 1 else " The record with the largest RMS error comes first."
    if len(shown) < several:
        chosen += f" Of {several} traces the {len(shown)} with the largest errors are here."
    return [
        Section(
            "Error by record",
            f"{found['records']}\n\nEvery record has one free offset, removed over the samples "
            "that count. The systematic share is the part of the squared error above the noise floor. "
            "Scatter is the change of the residual from sample to sample, over √2: white sensor noise "
            "cannot be larger. A gain ratio above 1 means that the measured stroke is larger than the "
            "model's.",
            figures.record_errors(comparison.records) if several > 1 else None,
            comparison.records,
        ),
        checks_section(comparison.checks),
        Section(
            "Time traces",
            f"{found['drift']}\n\nDrag over a stretch to enlarge it, double-click to return."
            f"{chosen}",
            {name: trace_figures.time_traces(trace, samples) for name, trace in shown.items()},
        ),
        Section(
            "Where the error is largest",
            f"{found['largest']}\n\nShown for each record: the half-cycle of its largest "
            "difference, the one before and the one after."
            f"{'' if several == 1 else ' The record with the largest difference comes first.'}",
            {
                name: trace_figures.largest_error(trace, samples)
                for name, trace in trace_figures.worst_first(shown, trace_figures.peak_um).items()
            },
        ),
        Section(
            "Loops",
            f"{found['gain']}\n\nWhere the two loops differ, the model's shape is wrong; on the "
            "right the difference, enlarged. Of a long record, loops are picked evenly over its length.",
            {name: trace_figures.loops(trace, 2 * samples) for name, trace in shown.items()},
        ),
        Section(
            "Error by direction",
            f"{found['by_direction']}\n\nA line above zero means that the measured {{output}} "
            "is above the model's there. Rising above falling: the measured loop is narrower than "
            "the model's; rising below falling: it is wider. Both away from zero together: gain or "
            "curvature.",
            figures.error_by_command(comparison.by_command),
            comparison.by_direction,
        ),
        Section(
            "Error by frequency",
            f"{found['by_frequency']}\n\nEvery stretch from one reversal of the command to the "
            "next has a frequency, one over twice its duration; the stretches are grouped into "
            f"third-octave bands. {_OPEN}",
            figures.error_by_frequency(comparison.by_frequency)
            if len(comparison.by_frequency)
            else None,
            comparison.by_frequency if len(comparison.by_frequency) else None,
        ),
        Section(
            "Error by amplitude",
            f"{found['by_amplitude']}\n\nThe amplitude of a stretch is half of the way between its "
            "two reversals. An error that grows with amplitude at a constant percentage is one of "
            f"gain. {_OPEN}",
            figures.error_by_amplitude(comparison.by_amplitude)
            if len(comparison.by_amplitude)
            else None,
            comparison.by_amplitude if len(comparison.by_amplitude) else None,
        ),
        Section(
            "Harmonics",
            f"{found['distortion']}\n\nWhere the command repeats, the error is split into parts: at the "
            "command's own frequencies in step with the model (its gain is wrong) or a quarter of a "
            "period from it (its loop is too wide, too narrow or late), odd and even harmonics, and "
            "what differs from period to period. Play operators are odd functions: they cause no even "
            "harmonics.",
            views.distortion_parts(comparison.distortion) if len(comparison.distortion) else None,
            comparison.distortion if len(comparison.distortion) else None,
        ),
        Section(
            "Spectrum and coherence",
            f"{found['spectrum']}\n\nThe error over its own frequency, all records together, beside "
            "white noise at the noise floor. The coherent part is what a linear filter of the command "
            "could remove.",
            views.error_spectrum(comparison.spectrum) if len(comparison.spectrum) else None,
        ),
        Section(
            "Since the last rest",
            f"{found['since_rest']}\n\nOn the left, measured minus model while the command rests, "
            "positive in the direction of the last move: creep that the model lacks is a straight line "
            "over the logarithm of time.",
            views.error_since_rest(comparison.since_rest, comparison.noise_floor_um)
            if len(comparison.since_rest)
            else None,
        ),
        Section(
            "Drift over the experiment",
            f"{found['clock']}\n\nMeans over up to eight pieces of each record, by the "
            "experiment's clock.",
            views.error_over_clock(comparison.clock),
        ),
        Section(
            "Residual over command and rate",
            f"{found['plane']}\n\nOrange: the measured {{output}} is above the model's, blue: "
            "below, grey: no sample. The upper half is a rising command, the lower half a falling "
            "one.",
            figures.residual_plane(comparison.plane),
        ),
        Section(
            "What was left out, and assumed",
            "\n".join(f"- {line}" for line in comparison.left_out) or "Every sample counts.",
        ),
    ]


def checks_section(checks: Sequence[Check]) -> Section:
    """Return the section of what the data say without a model."""
    order = {"yes": 0, "cannot tell": 1, "no": 2}
    rows = sorted(checks, key=lambda check: order[check.zone])
    table = pd.DataFrame(
        {
            "Looked for": [check.name for check in rows],
            "Found": [check.zone for check in rows],
            "Measured": [_amount(check.value, check.unit) for check in rows],
            "Counts from": [_amount(check.threshold, check.unit) for check in rows],
            "What the data say": [check.sentence for check in rows],
            "Next step": [check.next_step for check in rows],
        }
    )
    return Section(
        "Tests without a model",
        "These tests use the measurement alone, so that no fit can hide what they find. Each looks "
        "for an effect that play operators do not have, or for a weakness of the data. Yes: it is "
        "there. No: the data would show it and do not. Cannot tell: the data lack what the test "
        "needs; the next step names it.",
        table=table,
    )


def _amount(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{format_number(value)} {unit}".strip()
