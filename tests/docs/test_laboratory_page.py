"""The laboratory's page says what the committed study says."""

import re
from pathlib import Path

import pandas as pd

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "studies" / "results" / "hidden"
PAGE = (ROOT / "docs" / "laboratory.md").read_text(encoding="utf-8")


def reached():
    """Rows of the study's first table, the variants left out: asked (%), reached (n of m)."""
    for line in (STUDY / "hidden_effects.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 5 and cells[0] in ("single", "pairs", "none", "outside"):
            yield cells[2], re.search(r"\d+ of \d+", cells[3]).group()


def test_the_figures_are_those_of_the_study():
    stated = re.findall(r"^  \| .* \| (\d+ %) \| (\d+ of \d+) \|$", PAGE, re.MULTILINE)
    assert sorted(stated) == sorted(reached())
    assert len(stated) == 6


def test_what_was_not_found_is_counted_rightly():
    cases = pd.read_csv(STUDY / "cases.csv")
    pairs = cases[(cases["study"] == "pairs") & (cases["variant"] == "plain")]
    missed = pairs[~pairs["found"].astype(bool)]
    lagging = missed["subject"].str.contains("actuator_lag")
    assert f"{lagging.sum()} of the {len(missed)} pairs not found" in PAGE
    assert set(missed.loc[lagging, "verdict"].dropna()) <= {"unexplained", "failed"}
