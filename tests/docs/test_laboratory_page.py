"""The laboratory's page says what the committed study says."""

import re
from pathlib import Path

import pandas as pd

from benchmarks.rows import ROWS_FILE
from rdpi_gym.diagnosis.beam.constants import TABLE
from rdpi_gym.support.store import named_rows
from studies.third_effects.plants import KINDS

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "studies" / "results" / "hidden"
FOREIGN = ROOT / "studies" / "results" / "foreign"
PAGE = (ROOT / "docs" / "laboratory.md").read_text(encoding="utf-8")
FIRST, FURTHER = PAGE.split("### This search")[1].split("**The second study**")
SECOND, THIRD = FURTHER.split("**The third study**")


def reached():
    """Rows of the study's first table, the variants left out: asked, reached, falsely added."""
    for line in (STUDY / "hidden_effects.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 6 and cells[0] in ("single", "pairs", "none", "outside"):
            yield cells[2], re.search(r"\d+ of \d+", cells[3]).group(), cells[5]


def test_the_figures_are_those_of_the_study():
    line = r"^\| .* \| (\d+ %) \| (\d+ of \d+) \| ([\d onf]+) \|$"
    stated = re.findall(line, FIRST, re.MULTILINE)
    assert sorted(stated) == sorted(reached())
    assert len(stated) == 6


def test_the_figures_are_those_of_the_second_study():
    table = (FOREIGN / "foreign_effects.md").read_text(encoding="utf-8")
    reached = re.findall(
        r"^\| (?:single|double|triple|none) .*\((\d+ of \d+)\)", table, re.MULTILINE
    )
    assert len(reached) == 5
    for figure in reached:
        assert f"| {figure} |" in SECOND
    cases = pd.read_csv(FOREIGN / "cases.csv")
    for study, rows in cases[cases["study"] != "none"].groupby("study"):
        assert f"on {int((rows['additions'] > 0).sum())} of {len(rows)} |" in SECOND, study
    flowing = " ".join(SECOND.split())
    assert f"every eighth of a thousand plants of a seed, {len(cases)} in all" in flowing
    assert cases.loc[cases["study"] == "single", "subject"].nunique() == 15
    stated = re.search(r"a clock fault stated .* \((\d+) of (\d+)\)", table)
    assert f"a clock fault is stated of {stated[1]} of {stated[2]} sound data sets" in flowing
    assert "--seed 2034 --part 8/8" in SECOND
    found, either = (100.0 * (cases[n] > 0).mean() for n in ("wrong_found", "additions"))
    assert (
        f"found on {found:.1f} % of them (asked: 5 %), found or likely on {either:.1f} %" in flowing
    )
    said = re.search(r"left is true .*\((\d+ of \d+)\)", table)
    assert f"| {said[1]} | |" in SECOND


def shares(folder):
    """Figures of a draw of the third study: of the second study, of its own."""
    table = (ROOT / "studies/results" / folder / "third_effects.md").read_text(encoding="utf-8")
    lines = [line for line in table.splitlines() if line.endswith(("| yes |", "| no |"))]
    return table, [tuple(re.findall(r"\((\d+ of \d+)\)", line)) for line in lines]


def test_the_figures_are_those_of_the_third_study():
    (table, now), (_, before) = shares("third"), shares("third/first_draw")
    figures = re.findall(
        r"^\| .* \| (\d+ of \d+) \| (\d+ of \d+) \| (\d+ of \d+) \|$", THIRD, re.MULTILINE
    )
    assert figures == [(s, old, own) for (s, own), (_, old) in zip(now, before, strict=True)]
    assert len(figures) == 12
    flowing = " ".join(THIRD.split())
    kind = re.search(r"^\| kind \| (\d+) .*$", table, re.MULTILINE)
    wrong = round(float(kind[0].split("|")[7]) * int(kind[1]) / 100)
    assert f"found on {wrong} of {kind[1]} plants of other kinds" in flowing
    section = table.split("## Kinds of hysteresis")[1].split("##")[0]
    kinds = re.findall(r"^\| (\w+) \| (\d+) \| (\d+|no name) \|$", section, re.MULTILINE)
    assert {name for name, *_ in kinds} == set(KINDS)
    assert {name for name, _, right in kinds if right == "no name"} == {
        n for n in KINDS if not KINDS[n]
    }
    own = [(int(cases), int(right)) for name, cases, right in kinds if KINDS[name]]
    right, cases = sum(r for _, r in own), sum(c for c, _ in own)
    assert f"right on {right} of the {cases} plants of another kind" in flowing


def names_found(folder):
    """Names found on a draw of the third study, those that are there or not told apart from it first."""
    right = wrong = 0
    for row in named_rows(ROOT / "studies/results" / folder / ROWS_FILE).rows.values():
        truth = row["truth"]
        there = {*truth["excused"], *(h["effect"] for h in truth["hidden"])}
        there |= {name for names in truth["alike"].values() for name in names}
        found = [
            step["effect"] in there for step in row.get("steps", ()) if step["grade"] == "found"
        ]
        right, wrong = right + sum(found), wrong + len(found) - sum(found)
    return right, wrong


def test_of_the_names_found_on_both_draws_as_many_are_right_as_the_page_states():
    (right, wrong), (before, wrong_before) = map(names_found, ("third", "third/first_draw"))
    shares = (f"{100 * r / (r + w):.0f} %" for r, w in ((right, wrong), (before, wrong_before)))
    stated = "of the names found {} are right (first draw: {})".format(*shares)
    assert stated in " ".join(THIRD.split())


def test_false_additions_are_said_where_the_verdict_is_right():
    cases = pd.read_csv(STUDY / "cases.csv")
    outside = cases[(cases["study"] == "outside") & (cases["variant"] == "plain")]
    added = outside.groupby("subject")["additions"].sum()
    assert dict(added[added > 0]) == {"bouc-wen": 3, "preisach": 12}
    spoiled = outside.loc[outside["additions"] > 0, "subject"].value_counts()
    assert dict(spoiled) == {"preisach": 5, "bouc-wen": 3}
    assert f"{added.sum()} on {spoiled.sum()} of {len(outside)}" in FIRST
    minutes = outside.loc[outside["subject"] == "preisach", "seconds"] / 60.0
    assert f"takes {minutes.min():.0f} to {minutes.max():.0f} minutes" in FIRST


def test_the_figures_on_kinds_are_those_of_their_tables():
    tables = {
        "kind_choice/kind_choice": r"alike, in (\d+ of \d+) \(",
        "kind_choice/silence/silence": r"preferred on (\d+ of \d+) plants",
        "effects_on_cores/effects_on_cores": r"alike, in (\d+ of \d+)\.",
    }
    for name, figure in tables.items():
        table = ROOT / "studies" / "results" / f"{name}.md"
        said = re.search(figure, table.read_text(encoding="utf-8"))[1]
        assert re.search(rf"on {said}\s+plants", PAGE), name


def test_the_calibration_is_that_of_its_table():
    table = (ROOT / "studies/results/calibration/calibration.md").read_text(encoding="utf-8")
    lines = [[c.strip() for c in line.strip("|").split("|")] for line in table.splitlines()]
    errors = [line[5] for line in lines if len(line) == 6 and line[1] == "an effect that was added"]
    third = next(line for line in lines if line[:2] == ["third study", "an effect that was added"])
    assert f"{third[3]} % of the added effects are there, and {third[4]} % is stated" in PAGE
    held = {line[0]: line[2] for line in lines if len(line) == 4}
    assert f"are off by {errors[0]}, {errors[1]} and {errors[2]} % (asked: 3 %" in PAGE
    flowing = " ".join(PAGE.split())
    assert f"is hidden on {held['second study']} % of the plants" in flowing
    assert f"and on {held['third study']} % of the third's" in flowing


def table_of(name):
    """A table of the search on drawn, long or measured records, by its first column."""
    return pd.read_csv(ROOT / "studies/results/one_law" / f"{name}.csv", dtype=str)


def test_the_figures_on_measured_records_are_those_of_their_table():
    rows = table_of("measured").set_index("records")
    flowing = " ".join(PAGE.split("**Measured records**")[1].split("###")[0].split())
    *others, last = re.findall(r"[\d.]+", rows.loc["picma", "error over the splits"])
    assert f"{', '.join(others)} and {last} µm are left" in flowing
    seconds = sorted(map(int, rows.loc["picma", "processor s"].split()))
    assert f"after {seconds[0]} to {seconds[-1]} s" in flowing
    assert f"{rows.loc['friction_damper', 'of peak to peak %']} % of the peak to peak" in flowing
    explained = rows["test records explained %"]
    for name, text in (("friction_damper", "of two earthquakes are"), ("mr_damper", "are")):
        assert f"{' and '.join(explained[name].split())} % {text} explained" in flowing
    neighbours = ("mr_damper", "pneumatic_friction", "ferroelectric_forc")
    ratios = [float(rows.loc[n, "error"]) / float(rows.loc[n, "by hand"]) for n in neighbours]
    assert "the error is {:.2f}, {:.2f} and {:.2f} times".format(*ratios) in flowing


def test_the_times_on_long_records_are_those_of_their_table():
    flowing = " ".join(PAGE.split())
    rows = table_of("long").set_index(["name", "samples"])["processor s"].astype(float)
    assert f"on 100,000 samples take {rows['two effects', '100000']:.0f} s" in flowing
    assert f"a million {rows['two effects', '1000000']:.0f} s" in flowing
    assert f"100,000 at their floor {rows['at its floor', '100000']:.1f} s" in flowing


def test_the_figures_on_forty_plants_are_those_of_their_table():
    text = (ROOT / "studies/results/one_law/one_law.md").read_text(encoding="utf-8")
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines()]
    heads = next(line for line in cells if line[0] == "stratum")
    every = dict(zip(heads, next(line for line in cells if line[0] == "all"), strict=True))
    flowing = " ".join(PAGE.split())
    right = (
        f"exactly right {every['exact, beam']} % (before: {float(every['exact, before']):.0f} %)"
    )
    assert right in flowing
    assert f"in a median of {every['time ratio']} times the processor time" in flowing


def test_the_figures_on_constants_are_those_of_their_table():
    rows = pd.read_csv(ROOT / "studies/results/constants/search_constants.csv")
    assert (set(rows["plants"]), rows["constant"].nunique()) == ({10}, 1 + len(TABLE))
    assert set(rows["exact"]) == {100.0, 90.0}
    assert (rows["other names"].max(), rows["wrong"].max()) == (10.0, 0.0)
    times = rows.loc[rows["times"] != 1.0, "time"]
    flowing = " ".join(PAGE.split())
    assert f"Each of the search's {len(TABLE)} numbers halved and doubled" in flowing
    assert f"processor time is {times.min()} to {times.max()} times as much" in flowing
