"""`rdpi reproduce`: files, columns, reproducibility, bad input, and the committed results."""

import csv
from pathlib import Path

import pytest

from benchmarks.paper import (
    implementation_rows,
    paper_cases,
    paper_rows,
    reproduce_paper,
    sweep_rows,
    to_csv,
)
from benchmarks.paper.claims import section_iii
from rdpi_gym.cli import main
from rdpi_gym.support.errors import InputError

COLUMNS = (
    "case,reading,plant,frequency_hz,ts_s,max_error_um,rms_error_um,max_command_rate_V_s,"
    "paper_value,unit,verdict,series_verdict"
)
FIGURES = ("fig3", "fig4", "fig5", "fig7", "fig8", "stability", "limit", "irreproducible")
COMMITTED = Path(__file__).parents[2] / "studies" / "results" / "paper"
CHATTERING = ("literal", "closed-form own-rate")
NUMBERS = ("max_error_um", "rms_error_um", "max_command_rate_V_s")


def read(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduce") / "paper"
    assert main(["reproduce", "--out", str(out), "--realisations", "2"]) == 0
    return out


def test_files_are_written_and_the_page_shows_every_figure_and_verdict(folder):
    assert (folder / "paper.csv").read_text(encoding="utf-8").splitlines()[0] == COLUMNS
    page = (folder / "paper.md").read_text(encoding="utf-8")
    for name in FIGURES:
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert f"({name}.png)" in page
    assert {p.name for p in folder.iterdir()} == {
        "paper.md", "paper.csv", "sweep.csv", "implementation.csv",
        *(f"{name}.png" for name in FIGURES),
    }  # fmt: skip
    opening = page.partition("## How to read")[0]
    for words in (
        "static plant with g = 2 the command is up to 3 times as fast", "has 1.23", "0.252 ms",
        "0.382 ms", "*given* and *low-passed in both*",
    ):  # fmt: skip
        assert words in opening


HEADLINES = (
    "The first holds at 25 Hz and 50 Hz",
    "At 1 Hz the largest error grows again",
    "a largest error of 0.35 µm is left, 3.5 % of the amplitude",
    "on a static plant with g = 2 the command is up to 3 times as fast",
)
IN_README = (
    "to 0.35 µm at 1 µs, 3.5 % of the amplitude, and no further",
    "above 0.252 ms (Section III-B) and 0.382 ms (Section IV-B)",
    "with g = 2 the command has spikes of three times the smooth rate",
    "record has g = 1.23",
)


def test_committed_headlines_agree_with_the_readme():
    page = (COMMITTED / "paper.md").read_text(encoding="utf-8")
    readme = " ".join((COMMITTED.parents[2] / "README.md").read_text(encoding="utf-8").split())
    assert [words for words in HEADLINES if words not in page] == []
    assert [words for words in IN_README if words not in readme] == []


def test_rows_hold_the_paper_values_and_a_verdict_each(folder):
    rows = read(folder / "paper.csv")
    assert {"literal", "given", "none"} <= {row["reading"] for row in rows}
    assert all(row["verdict"] for row in rows)
    bounds = [row for row in rows if row["case"].startswith("Fig. 8")]
    assert {float(row["paper_value"]) for row in bounds} == {3.0}
    smallest = [row for row in rows if row["case"] == "Fig. 5c"]
    verdicts = {row["reading"]: row["verdict"].split(":")[0] for row in smallest}
    assert verdicts["literal"] == "does not hold"
    assert verdicts["given"] == verdicts["low-passed in both"] == "holds"
    printed = {
        row["case"]: row["paper_value"] for row in rows if row["verdict"] == "used as printed"
    }
    assert float(printed["Section III-B, a_0"]) == 0.729
    assert float(printed["Section IV-B, δ2"]) == 3.948e-4
    assert all(row["unit"] for row in rows if row["paper_value"])
    assert all(row["plant"] for row in rows if row["max_error_um"])
    derived = {row["case"]: row["verdict"] for row in rows if row["verdict"].startswith("follows")}
    assert derived["Section III-B, A"] == "follows: 1.2170 µm/V"


def test_committed_results_are_not_stale(folder):
    fresh, committed = read(folder / "paper.csv"), read(COMMITTED / "paper.csv")
    keys = ("case", "reading", "plant", "frequency_hz", "ts_s", "paper_value", "unit")
    assert [[row[k] for k in keys] for row in fresh if row["reading"] not in CHATTERING] == [
        [row[k] for k in keys] for row in committed if row["reading"] not in CHATTERING
    ]
    for new, old in zip(fresh, committed, strict=True):
        if new["reading"] in CHATTERING and float(new["ts_s"]) < 1e-3:
            continue
        for name in NUMBERS:
            if new[name]:
                assert float(new[name]) == pytest.approx(float(old[name]), rel=1e-4, abs=1e-9)
        if new["max_error_um"]:
            assert new["verdict"].partition(":")[0] == old["verdict"].partition(":")[0]


def test_the_same_seed_gives_the_same_files():
    cases = [case for case in paper_cases() if case.sine.ts_s >= 5e-5 and "Fig." in case.label]
    sweep = [section_iii(50.0, ts) for ts in (1e-3, 1e-4)]

    def files(seed):
        results = reproduce_paper(seed, 3, cases, sweep)
        parts = (paper_rows(results), sweep_rows(results), implementation_rows(results))
        return [to_csv(part) for part in parts]

    first = files(1)
    assert first == files(1)
    assert first[2] != files(2)[2]  # the sensor's noise


def test_progress_goes_from_0_to_1():
    seen = []
    cases = [case for case in paper_cases() if case.label.startswith("Fig. 4")]
    reproduce_paper(0, 2, cases, [], progress=lambda *step: seen.append(step))
    shares = [done / total for _, done, total in seen]
    assert len(seen) == len(cases)
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    assert shares[-1] < 1.0


def test_bad_options_and_arguments_are_refused(tmp_path, capsys):
    taken = tmp_path / "taken"
    taken.write_text("kept")
    for words, expected in (
        (["--seed", "-1"], "--seed"),
        (["--realisations", "1"], "--realisations"),
        (["--realisations", "many"], "--realisations"),
        (["--speed", "9"], "--speed"),
        (["--out", str(taken)], str(taken)),  # before anything is computed
    ):
        assert main(["reproduce", "--out", str(tmp_path / "x"), *words]) == 2, words
        line = capsys.readouterr().err
        assert expected in line
        assert line.count("\n") == 1
        assert not (tmp_path / "x").exists()
    assert taken.read_text() == "kept"
    for seed, realisations in ((-1, 16), (0, 1)):
        with pytest.raises(InputError):
            reproduce_paper(seed, realisations, [], [])
