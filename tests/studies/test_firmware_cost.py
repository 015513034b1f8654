import re
from pathlib import Path

import pandas as pd
import pytest

from studies.bare_metal import missing
from studies.firmware_cost import RESULTS, main

needs_tools = pytest.mark.skipif(
    missing() is not None, reason=f"{missing()} is not installed: nothing runs on emulated boards"
)


@needs_tools
def test_the_table_is_written_and_rows_of_other_programs_stay(tmp_path, capsys):
    measured = pd.read_csv(RESULTS / "firmware_cost.csv")
    measured[measured["program"] == "none"].to_csv(tmp_path / "firmware_cost.csv", index=False)
    lack = "- none, M0+, double, -O2: it ends in a fault"
    (tmp_path / "firmware_cost.md").write_text(f"## Without\n\n{lack}\n")
    assert (
        main(["--only", "classical-reference-rate", "--samples", "50", "--out", str(tmp_path)]) == 0
    )
    page = (tmp_path / "firmware_cost.md").read_text()
    assert "-O2" in page
    assert lack in page
    counts = pd.read_csv(tmp_path / "firmware_cost.csv")["program"].value_counts(sort=False)
    cases = 2 * 3 * 2  # cores, precisions, options
    assert counts.to_dict() == {"none": cases, "classical-reference-rate": cases}


def test_an_unknown_row_is_named(capsys):
    assert main(["--only", "nothing"]) == 2
    assert "no program is named 'nothing'; known are none," in capsys.readouterr().err


def test_the_pages_numbers_are_those_of_the_table():
    page = (Path(__file__).parents[2] / "docs" / "firmware.md").read_text(encoding="utf-8")
    table = pd.read_csv(RESULTS / "firmware_cost.csv")
    table = table[table["option"] == "-O2"]
    program, core, seen = "", "", 0
    for row in re.findall(r"^\|(.*?)\| (`\w+`.*|Q31) \| (\d+) \| (\d+) \| (\d+) \|$", page, re.M):
        where, numbers, *shown = row
        if "asked" in where:
            continue
        if named := re.search(r"`([\w:-]+)`", where):
            program = named[1]
        core = where.partition("Cortex-")[2].strip() or core
        numbers = numbers.partition(",")[0].strip("`").lower()
        measured = table[
            table["program"].str.partition(",")[0].eq(program)
            & (table["core"] == core)
            & (table["numbers"].str.lower() == numbers)
        ]
        [found] = measured[["code_bytes", "state_bytes", "most_instructions"]].round().to_numpy()
        assert [int(each) for each in shown] == found.astype(int).tolist(), row
        seen += 1
    assert seen == 8
