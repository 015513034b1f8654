"""Sections of a page that show records: measured, and as each model sees them."""

from __future__ import annotations

import numpy as np

from rdpi_gym.diagnosis.comparison.residual_views import residual_profiles, view_trace
from rdpi_gym.diagnosis.comparison.traces import Trace
from rdpi_gym.diagnosis.results import SearchResult, View
from rdpi_gym.report.discovery import view_figures
from rdpi_gym.report.page import Section
from rdpi_gym.report.thin import DISPLAY_SAMPLES
from rdpi_gym.report.trace_figures import peak_um, rms_um, worst_first

MOST_VIEWS = 24
"""Records whose traces stand on the page; of more, those with the largest errors."""
_ALL_SAMPLES = 8 * DISPLAY_SAMPLES


def view_sections(result: SearchResult) -> list[Section]:
    """Show the records over time, as loops, and what is left of them; none without views."""
    views = [view for view in result.views if view.models_um and np.any(view.counted)]
    if not views:
        return []
    floor = result.noise_floor_um
    # the held-out part of a record has the role beside its name
    every = {f"{view.name} ({view.role})": view for view in views}
    names = worst_first(every, lambda view: rms_um(_first_trace(view)), most=MOST_VIEWS)
    samples = max(600, min(DISPLAY_SAMPLES, _ALL_SAMPLES // len(names)))
    labels = list(views[0].models_um)
    pair = (
        f"Orange is the model “{labels[0]}”, blue is “{labels[-1]}”"
        if len(labels) > 1
        else f"Blue is the model “{labels[0]}”"
    )
    chosen = (
        f" The record that the model “{labels[0]}” fits worst comes first."
        if len(every) > 1
        else ""
    )
    if len(names) < len(every):
        chosen += f" Of {len(every)} records the {len(names)} with the largest errors are here."
    residuals = {}
    for name, view in names.items():
        traces = {label: view_trace(view, label) for label in view.models_um}
        residuals[name] = view_figures.residuals(
            {label: residual_profiles(trace) for label, trace in traces.items()},
            floor,
            next(iter(traces.values())).ts_s,
        )
    return [
        Section(
            "Measurement against model",
            f"{pair}. Below stands the error of each, measured minus model, with the noise floor as a "
            "band: the error of the last model should stay within about three times the band and show "
            f"no pattern. Click on the legend to show other models.{chosen}",
            {n: view_figures.over_time(v, floor, samples) for n, v in names.items()},
        ),
        Section(
            f"Where the model “{labels[0]}” was farthest off",
            "The half-cycle of its largest error, with the one before and the one after. What the "
            "added effects change is seen best here.",
            {
                n: view_figures.largest_error(v, floor, samples // 2)
                for n, v in worst_first(names, lambda view: peak_um(_first_trace(view))).items()
            },
        ),
        Section(
            "Loops",
            "On the left {output} over command, on the right measured minus model along the same "
            "loops. A shape that repeats there is physics that the model lacks.",
            {n: view_figures.loops(v, floor, samples) for n, v in names.items()},
        ),
        Section(
            "Where the remaining error is",
            "Mean error of each model over the command (solid: rising, dotted: falling), over its rate "
            "and, in a record with holds, over the time since the command last moved, positive in the "
            "direction of that move: creep climbs steadily there. In the spectrum, beside that of the "
            "noise (dashed), resonances and hum are peaks.",
            residuals,
        ),
    ]


def _first_trace(view: View) -> Trace:
    return view_trace(view, next(iter(view.models_um)))
