"""The pages of `rdpi compare`: one model against measurement, or several."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from rdpi_gym.diagnosis import FEW_HALF_CYCLES, Comparison, ModelComparison, Trace
from rdpi_gym.diagnosis.checks import Check
from rdpi_gym.report import comparison as charts
from rdpi_gym.report.chart import Chart
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.tables import format_number
from rdpi_gym.report.traces import DISPLAY_SAMPLES, loops, one_model, peak_um, rms_um, worst_first

MOST_RECORDS = 40
"""Records whose traces stand on the page; of more, those with the largest errors."""
_OPEN = f"Open circles rest on fewer than {FEW_HALF_CYCLES} half-cycles."
_ALL_SAMPLES = 8 * DISPLAY_SAMPLES
# Values of all traces on a page, and records of which bars are drawn.
_MODELS_SAMPLES, _BARS = 24 * DISPLAY_SAMPLES, 30
_NEAR = "Nearest are the models within 3 % of the least error."


def write_compare_page(path: Path | str, comparison: Comparison) -> Path:
    """Write a comparison as a self-contained page."""
    found = comparison.findings
    count = len({trace.name for trace in comparison.traces})
    answer, *heads = [found[key] for key in ("overall", "far", "range") if key in found]
    summary = "\n\n".join(
        [
            f"{answer} Model {comparison.model.name}, {count} "
            f"record{'s' if count > 1 else ''} of {comparison.title}.",
            *heads,
        ]
    )
    return write_page(
        path,
        f"Model {comparison.model.name} against measurement",
        summary,
        _in_order(_sections(comparison), comparison.leading),
        comparison.quantities,
    )


def _sections(comparison: Comparison) -> dict[str, Section]:
    """Return the sections, each by the finding that it shows."""
    found = comparison.findings
    # a record of which a quarter is held out stands for two traces
    named = {f"{trace.name} ({trace.role})": trace for trace in comparison.traces}
    shown = worst_first(named, rms_um, most=MOST_RECORDS)
    samples = max(500, min(DISPLAY_SAMPLES, _ALL_SAMPLES // len(shown)))
    several = len(comparison.traces)
    chosen = "" if several == 1 else " The record with the largest RMS error comes first."
    if len(shown) < several:
        chosen += f" Of {several} traces the {len(shown)} with the largest errors are here."
    return {
        "records": Section(
            "Error by record",
            f"{found['records']}\n\nEvery record has one free offset, removed over the samples "
            "that count. The systematic share is the part of the squared error above the noise floor. "
            "Scatter is the change of the residual from sample to sample, over √2: white sensor noise "
            "cannot be larger. A gain ratio above 1 means that the measured stroke is larger than the "
            "model's.",
            charts.record_errors(comparison.records) if several > 1 else None,
            comparison.records,
        ),
        "checks": checks_section(comparison.checks),
        "drift": Section(
            "Time traces",
            f"{found['drift']}\n\nDrag over a stretch to enlarge it, double-click to return."
            f"{chosen}",
            {name: charts.time_traces(trace, samples) for name, trace in shown.items()},
        ),
        "largest": Section(
            "Where the error is largest",
            f"{found['largest']}\n\nShown for each record: the half-cycle of its largest "
            "difference, the one before and the one after."
            f"{'' if several == 1 else ' The record with the largest difference comes first.'}",
            {
                name: charts.largest_error(trace, samples)
                for name, trace in worst_first(shown, peak_um).items()
            },
        ),
        "gain": Section(
            "Loops",
            f"{found['gain']}\n\nWhere the two loops differ, the model's shape is wrong; on the "
            "right the difference, enlarged. Of a long record, loops are picked evenly over its length.",
            {n: loops(one_model(trace), 2 * samples, settled=True) for n, trace in shown.items()},
        ),
        "by_direction": Section(
            "Error by direction",
            f"{found['by_direction']}\n\nA line above zero means that the measured {{output}} "
            "is above the model's there. Rising above falling: the measured loop is narrower than "
            "the model's; rising below falling: it is wider. Both away from zero together: gain or "
            "curvature.",
            charts.error_by_command(comparison.by_command),
            comparison.by_direction,
        ),
        "by_frequency": Section(
            "Error by frequency",
            f"{found['by_frequency']}\n\nEvery stretch from one reversal of the command to the "
            "next has a frequency, one over twice its duration; the stretches are grouped into "
            f"third-octave bands. {_OPEN}",
            *_if_any(charts.error_by_frequency, comparison.by_frequency),
        ),
        "by_amplitude": Section(
            "Error by amplitude",
            f"{found['by_amplitude']}\n\nThe amplitude of a stretch is half of the way between its "
            "two reversals. An error that grows with amplitude at a constant percentage is one of "
            f"gain. {_OPEN}",
            *_if_any(charts.error_by_amplitude, comparison.by_amplitude),
        ),
        "distortion": Section(
            "Harmonics",
            f"{found['distortion']}\n\nWhere the command repeats, the error is split into parts: at the "
            "command's own frequencies in step with the model (its gain is wrong) or a quarter of a "
            "period from it (its loop is too wide, too narrow or late), odd and even harmonics, and "
            "what differs from period to period. Play operators are odd functions: they cause no even "
            "harmonics.",
            *_if_any(charts.distortion_parts, comparison.distortion),
        ),
        "spectrum": Section(
            "Spectrum and coherence",
            f"{found['spectrum']}\n\nThe error over its own frequency, all records together, beside "
            "white noise at the noise floor. The coherent part is what a linear filter of the command "
            "could remove.",
            _if_any(charts.error_spectrum, comparison.spectrum)[0],
        ),
        "since_rest": Section(
            "Since the last rest",
            f"{found['since_rest']}\n\nOn the left, measured minus model while the command rests, "
            "positive in the direction of the last move: creep that the model lacks is a straight line "
            "over the logarithm of time.",
            charts.error_since_rest(comparison.since_rest, comparison.noise_floor_um)
            if len(comparison.since_rest)
            else None,
        ),
        "clock": Section(
            "Drift over the experiment",
            f"{found['clock']}\n\nMeans over up to eight pieces of each record, by the "
            "experiment's clock.",
            charts.error_over_clock(comparison.clock),
        ),
        "plane": Section(
            "Residual over command and rate",
            f"{found['plane']}\n\nOrange: the measured {{output}} is above the model's, blue: "
            "below, grey: no sample. The upper half is a rising command, the lower half a falling "
            "one.",
            charts.residual_plane(comparison.plane),
        ),
        "left out": Section(
            "What was left out, and assumed",
            "\n".join(f"- {line}" for line in comparison.left_out) or "Every sample counts.",
        ),
    }


def _in_order(sections: Mapping[str, Section], leading: Sequence[str]) -> list[Section]:
    """Return the sections, those of the leading findings first."""
    return [sections[key] for key in dict.fromkeys((*leading, *sections))]


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


def _if_any(
    draw: Callable[[pd.DataFrame], Chart], table: pd.DataFrame
) -> tuple[Chart | None, pd.DataFrame | None]:
    """Return the chart of a table and the table; nothing where it has no rows."""
    return (draw(table), table) if len(table) else (None, None)


def write_models_page(path: Path | str, found: ModelComparison) -> Path:
    """Write a comparison of several models as a self-contained page."""
    said = found.findings
    lines = [f"- {said[key]}" for key in ("records", "by_frequency", "by_amplitude") if key in said]
    names = [f"- {name}: {_described(found, k)}" for k, name in enumerate(found.names)]
    summary = "\n\n".join(
        [said["overall"], *(["\n".join(lines)] if lines else []), "The models:", "\n".join(names)]
    )
    return write_page(
        path,
        f"{len(found.names)} models against measurement",
        summary,
        _models_sections(found),
        found.quantities,
    )


def _described(found: ModelComparison, k: int) -> str:
    plant = found.comparisons[k].model
    effects = ", ".join(effect.name for effect in plant.effects) or "no effects"
    return f"{plant.hysteresis.title}; {effects}"


def _models_sections(found: ModelComparison) -> list[Section]:
    # a record of which a quarter is held out stands for two traces
    named: dict[str, dict[str, Trace]] = {}
    for name, comparison in zip(found.names, found.comparisons, strict=True):
        for trace in comparison.traces:
            named.setdefault(f"{trace.name} ({trace.role})", {})[name] = trace
    shown = worst_first(named, lambda each: min(map(rms_um, each.values())), most=MOST_RECORDS)
    samples = max(500, min(DISPLAY_SAMPLES, _MODELS_SAMPLES // (len(shown) * len(found.names))))
    first = "" if len(shown) == 1 else " The record that the best model fits worst comes first."
    if len(shown) < len(named):
        first += f" Of {len(named)} traces {len(shown)} are here."
    link = "A click on a model in the legend hides it in both panels, a double click leaves it alone there."
    return [
        Section(
            "Error by record",
            f"{found.findings.get('records', '')}\n\n{_NEAR} Every record has one free offset for each model.",
            charts.models_errors(found, _BARS),
            _table(
                found, found.records, {"record": "Record", "role": "Role", "samples": "Samples"}
            ),
        ),
        Section(
            "Error by frequency",
            f"{found.findings.get('by_frequency', '')}\n\n{_NEAR} {_OPEN}",
            charts.models_by_frequency(found) if len(found.by_frequency) else None,
            _table(
                found,
                found.by_frequency,
                {"frequency_hz": "Frequency (Hz)", "half_cycles": "Half-cycles"},
            ),
        ),
        Section(
            "Error by amplitude",
            f"{found.findings.get('by_amplitude', '')}\n\n{_NEAR} {_OPEN}",
            charts.models_by_amplitude(found) if len(found.by_amplitude) else None,
            _table(
                found,
                found.by_amplitude,
                {"amplitude_V": "Amplitude ({input_unit})", "half_cycles": "Half-cycles"},
            ),
        ),
        Section(
            "Time traces",
            f"{link} Drag over a stretch to enlarge it in both, double-click to return.{first}",
            {name: charts.models_time_traces(each, samples) for name, each in shown.items()},
        ),
        Section(
            "Where the nearest model is worst",
            f"{link} Shown for each record: the half-cycle of the largest difference of the model "
            "that is nearest on it, the one before and the one after.",
            {name: charts.models_largest_error(each, samples) for name, each in shown.items()},
        ),
        Section(
            "Loops",
            f"{link} Of a long record, loops are picked evenly over its length.{first}",
            {name: charts.models_loops(each) for name, each in shown.items()},
        ),
        *(_one(found, k) for k in range(len(found.names))),
        checks_section(found.comparisons[0].checks),
    ]


def _table(
    found: ModelComparison, table: pd.DataFrame, heads: dict[str, str]
) -> pd.DataFrame | None:
    if not len(table):
        return None
    own = {name: f"{name} ({{output_unit}})" for name in found.names}
    return table.rename(
        columns={**heads, **own, "noise_floor": "Noise floor ({output_unit})", "best": "Nearest"}
    )


def _one(found: ModelComparison, k: int) -> Section:
    comparison = found.comparisons[k]
    left = [line for key, line in comparison.findings.items() if key != "overall"]
    return Section(
        f"Where {found.names[k]} fails",
        f"{comparison.findings['overall']}\n\n" + "\n".join(f"- {line}" for line in left),
    )
