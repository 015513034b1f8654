"""The page of `rdpi compare` with several models."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from rdpi_gym.diagnosis import FEW_HALF_CYCLES, ModelComparison, Trace
from rdpi_gym.report.comparison import models_figures
from rdpi_gym.report.comparison.page import MOST_RECORDS, checks_section
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.thin import DISPLAY_SAMPLES
from rdpi_gym.report.trace_figures import rms_um, worst_first

# Values of all traces on a page, and records of which bars are drawn.
_ALL_SAMPLES, _BARS = 24 * DISPLAY_SAMPLES, 30
_OPEN = f"Open circles rest on fewer than {FEW_HALF_CYCLES} half-cycles."
_NEAR = "Nearest are the models within 3 % of the least error."


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
        _sections(found),
        found.quantities,
    )


def _described(found: ModelComparison, k: int) -> str:
    plant = found.comparisons[k].model
    effects = ", ".join(effect.name for effect in plant.effects) or "no effects"
    return f"{plant.hysteresis.title}; {effects}"


def _sections(found: ModelComparison) -> list[Section]:
    # a record of which the last quarter is held out stands for two traces
    named: dict[str, dict[str, Trace]] = {}
    for name, comparison in zip(found.names, found.comparisons, strict=True):
        for trace in comparison.traces:
            named.setdefault(f"{trace.name} ({trace.role})", {})[name] = trace
    shown = worst_first(named, lambda each: min(map(rms_um, each.values())), most=MOST_RECORDS)
    samples = max(500, min(DISPLAY_SAMPLES, _ALL_SAMPLES // (len(shown) * len(found.names))))
    first = "" if len(shown) == 1 else " The record that the best model fits worst comes first."
    if len(shown) < len(named):
        first += f" Of {len(named)} traces {len(shown)} are here."
    link = "A click on a model in the legend hides it in both panels, a double click leaves it alone there."
    return [
        Section(
            "Error by record",
            f"{found.findings.get('records', '')}\n\n{_NEAR} Every record has one free offset for each model.",
            models_figures.errors(found, _BARS),
            _table(
                found, found.records, {"record": "Record", "role": "Role", "samples": "Samples"}
            ),
        ),
        Section(
            "Error by frequency",
            f"{found.findings.get('by_frequency', '')}\n\n{_NEAR} {_OPEN}",
            models_figures.error_by_frequency(found) if len(found.by_frequency) else None,
            _table(
                found,
                found.by_frequency,
                {"frequency_hz": "Frequency (Hz)", "half_cycles": "Half-cycles"},
            ),
        ),
        Section(
            "Error by amplitude",
            f"{found.findings.get('by_amplitude', '')}\n\n{_NEAR} {_OPEN}",
            models_figures.error_by_amplitude(found) if len(found.by_amplitude) else None,
            _table(
                found,
                found.by_amplitude,
                {"amplitude_V": "Amplitude ({input_unit})", "half_cycles": "Half-cycles"},
            ),
        ),
        Section(
            "Time traces",
            f"{link} Drag over a stretch to enlarge it in both, double-click to return.{first}",
            {name: models_figures.time_traces(each, samples) for name, each in shown.items()},
        ),
        Section(
            "Where the nearest model is worst",
            f"{link} Shown for each record: the half-cycle of the largest difference of the model "
            "that is nearest on it, the one before and the one after.",
            {name: models_figures.largest_error(each, samples) for name, each in shown.items()},
        ),
        Section(
            "Loops",
            f"{link} Of a long record, loops are picked evenly over its length.{first}",
            {name: models_figures.loops(each) for name, each in shown.items()},
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
