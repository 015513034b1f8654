"""How long the laboratory lets a user wait, measured in a browser: `python -m studies.lab_speed`.

A record of 100,000 samples, of a stage with creep, is dropped on the page of a laboratory that was
started as a user starts it; times are those that pass before the browser shows what is waited for.
They are of the wall clock: where that is permitted all processes go ahead of other work on the
machine, and its load stands beside the times.
"""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import time
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import rdpi_gym as rg
from rdpi_gym.measurement import Record, write_csv
from rdpi_gym.plant import Plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.signals.experiments import polyline
from rdpi_gym.support.markdown import frame_table
from studies.chromium import LabPage, LabProcess, chromium
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results"
SAMPLES, TS_S, NOISE_UM = 100_000, 1e-4, 0.01
ASKED_S = {
    "command to page": 2.0,
    "command to a place to drop": None,
    "dropped record drawn": 1.0,
    "base fit": 2.0,
    "first card": 5.0,
    "all cards": 30.0,
    "parameter drag, median": 0.1,
    "parameter drag, largest": 0.1,
    "cancel": 0.5,
}
"""What is waited for, and how long it may take (s); None: nothing is asked."""
_DRAGS = 12
_CHOOSING_MS = 10_000  # a user looks for the file
_AHEAD = -15
_DRAG = """async ([at]) => {
  const slider = [...document.querySelectorAll("input[type=range]")].find((s) => s.offsetParent);
  const path = () => document.querySelector("#residual .scatterlayer path.js-line")?.getAttribute("d");
  const before = path();
  const began = performance.now();
  slider.value = at;
  slider.dispatchEvent(new Event("input", {bubbles: true}));
  while (path() === before && performance.now() - began < 5000)
    await new Promise((next) => requestAnimationFrame(next));
  return (performance.now() - began) / 1000;
}"""


def _run(asked: Namespace) -> Files:
    ahead = go_ahead()
    with chromium() as browser, tempfile.TemporaryDirectory() as scratch:
        file = write_csv(dropped_record(SAMPLES), Path(scratch) / "record.csv")
        rounds = [_round(browser, file, Path(scratch) / f"s{k}") for k in range(asked.rounds)]
    text = report(pd.DataFrame(rounds), os.cpu_count() or 1, os.getloadavg()[0], ahead)
    return {"lab_speed.md": text}


def go_ahead() -> bool:
    """Let this process, and what it starts, go ahead of others; say whether that was permitted."""
    if not hasattr(os, "nice"):
        return False
    with contextlib.suppress(PermissionError):
        return os.nice(_AHEAD) < 0
    return False


def dropped_record(samples: int) -> Record:
    """Return a record of a stage with creep: loops of many sizes, then steps."""
    plant = replace(
        rg.plants["P10"], effects=(CATALOGUE["creep"]().with_values({"gain_per_decade": 0.02}),)
    )
    t_s = np.arange(samples, dtype=np.float64) * TS_S
    turns = 40.0 * np.linspace(1.0, 0.1, 40) * (-1.0) ** np.arange(40)
    loops = polyline([0.0, *turns, 0.0], rate_V_s=300.0)
    u_V = np.where(t_s < 0.7 * t_s[-1], loops(t_s), 20.0 * np.round(2.0 * np.sin(4.0 * t_s)) / 2.0)
    noise = NOISE_UM * np.random.default_rng(0).standard_normal(samples)
    y_um = Plant(plant, TS_S).simulate(u_V) + noise
    return Record("record", t_s, u_V, y_um, ts_s=TS_S)


def _round(browser: Any, file: Path, session: Path) -> dict[str, float]:
    found = {}
    began = time.monotonic()
    with LabProcess(session) as lab, LabPage(browser) as page:
        page.arrive(lab)
        found["command to page"] = time.monotonic() - began
        page.tab.get_by_test_id("drop").wait_for()
        found["command to a place to drop"] = time.monotonic() - began
        page.tab.wait_for_timeout(_CHOOSING_MS)
        began = time.monotonic()
        page.drop([file])
        page.until("Boolean(document.querySelector('#trace .scatterlayer path.js-line'))")
        found["dropped record drawn"] = time.monotonic() - began
        page.until_steps(1)
        found["base fit"] = time.monotonic() - began
        page.until_told("s.ranking && s.ranking.cards.some(c => c.validation_um !== null)")
        found["first card"] = time.monotonic() - began
        page.until_tried()
        found["all cards"] = time.monotonic() - began
        page.until_ranked()
        page.click(f"add-{page.first_card}")
        page.until_steps(2)
        page.until("Boolean(document.querySelector('input[type=range]'))")
        page.tab.wait_for_timeout(1000)
        began = time.monotonic()
        page.click("cancel")
        page.until("document.getElementById('job').hidden")
        found["cancel"] = time.monotonic() - began
        drags = []
        for at in np.linspace(300, 700, _DRAGS):
            drags.append(float(page.tab.evaluate(_DRAG, [str(round(at))])))
            page.tab.wait_for_timeout(150)
        found["parameter drag, median"] = float(np.median(drags))
        found["parameter drag, largest"] = max(drags)
    return found


def report(rounds: pd.DataFrame, cores: int, load: float, ahead: bool) -> str:
    """Return the table as Markdown."""
    lines = [
        {
            "what is waited for": name,
            "median (s)": f"{rounds[name].median():.2f}",
            "longest (s)": f"{rounds[name].max():.2f}",
            "asked (s)": "" if asked is None else f"{asked:g}",
            "within": "" if asked is None else "yes" if rounds[name].median() <= asked else "no",
        }
        for name, asked in ASKED_S.items()
    ]
    within = [line["within"] == "yes" for line in lines if line["within"]]
    return (
        "# How long the laboratory lets a user wait\n\n"
        f"{sum(within)} of {len(within)} are within what is asked, by the median of {len(rounds)} rounds on "
        f"{cores} cores with {load:.1f} processes that wanted one"
        f"{', those that were measured ahead of the others' if ahead else ''}.\n\n"
        f"{frame_table(pd.DataFrame(lines))}\n\n"
        f"One dropped CSV file of {SAMPLES:,} samples; it is dropped {_CHOOSING_MS // 1000} s after the page is there, and "
        "the times down to that of all cards count from the drop.\n\n"
        f"Made by `python -m studies.lab_speed --rounds {len(rounds)}`.\n"
    )


_MEANING = "how often everything is measured; the median counts"
main = Study("lab_speed", __doc__, _run, RESULTS, numbers=(("--rounds", 3, _MEANING),))

if __name__ == "__main__":
    sys.exit(main())
