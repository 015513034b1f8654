import re

import pandas as pd
import pytest

from benchmarks.tracking.leaderboard import COLUMNS
from rdpi_gym.cli import main
from rdpi_gym.cli.bench import _print_top

SMALL = [
    "bench", "--controllers", "none,classical-static", "--references", "sine",
    "--plants", "P5", "--ts", "1e-3", "--seeds", "2", "--jobs", "1",
]  # fmt: skip


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench") / "out"
    assert main([*SMALL, "--out", str(folder)]) == 0
    return folder


def test_it_writes_table_text_page_and_picture(out):
    table = pd.read_csv(out / "leaderboard.csv")
    assert tuple(table.columns) == COLUMNS
    # sines of 1, 10, 25 and 50 Hz by two controllers and two seeds
    assert len(table) == 16
    assert not table.duplicated(
        ["controller", "plant", "reference", "frequency_hz", "ts_s", "seed"]
    ).any()
    assert "classical-static" in (out / "leaderboard.md").read_text()
    assert (out / "leaderboard.png").read_bytes().startswith(b"\x89PNG")


def test_the_page_is_self_contained_and_lets_the_reader_choose_a_pair(out):
    page = (out / "report.html").read_text()
    assert not re.search(r'<(script|link|img)[^>]+(src|href)="https?:', page)
    assert "Traces of any pair" in page
    assert '"A: classical-static"' in page
    assert '"B: none"' in page
    assert len(page) < 15e6


def test_a_second_run_computes_nothing_and_ends_with_what_it_wrote(out, capsys):
    assert main([*SMALL, "--out", str(out)]) == 0
    lines = capsys.readouterr().out.strip().splitlines()
    assert lines[0] == "24 rows, 0 of them computed now"
    assert lines[-2:] == [f"leaderboard: {out / 'leaderboard.md'}", f"page: {out / 'report.html'}"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--controllers", "pid"], "did you mean 'pi'"),
        (["--ts", "0"], "ts_s is 0.0; give a sampling time above 0 s"),
        (["--ts", "fast"], "--ts 'fast' is no number"),
        (["--jobs", "0"], "--jobs is 0"),
        (["--plant", "none.json"], "none.json does not exist"),
        (["--seeds", "0"], "--seeds"),
    ],
)
def test_bad_input_is_one_line_and_status_2(arguments, said, tmp_path, capsys):
    assert main([*SMALL, *arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_where_every_controller_fails_the_results_are_written_and_say_so(tmp_path, monkeypatch):
    (tmp_path / "mine_that_fails.py").write_text(
        "def make(belief, layout):\n    raise OSError('no')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    out = tmp_path / "out"
    arguments = [
        "bench", "--controllers", "", "--controller", "mine_that_fails:make", "--plants", "P5",
        "--references", "steps", "--ts", "1e-3", "--seeds", "1", "--jobs", "1", "--out", str(out),
    ]  # fmt: skip
    assert main(arguments) == 0
    table = pd.read_csv(out / "leaderboard.csv")
    assert table["status"].tolist() == ["failed: OSError: no"]
    assert "Failed rows" in (out / "report.html").read_text()


def test_the_oracle_alone_is_scored_as_any_other(tmp_path):
    out = tmp_path / "out"
    arguments = [
        "bench", "--controllers", "preview-oracle", "--plants", "P5", "--references", "sine",
        "--ts", "1e-3", "--seeds", "1", "--seed", "4", "--jobs", "1", "--out", str(out),
    ]  # fmt: skip
    assert main(arguments) == 0
    table = pd.read_csv(out / "leaderboard.csv")
    assert (table["optimality_gap"] == 1.0).all()
    assert (table["seed"] == 4).all()


def test_the_users_own_controller_is_printed_wherever_it_stands(capsys):
    names = [f"c{i}" for i in range(12)]
    columns = ["RMSE (%)", "RMSE, seed 0 (%)", "mean rank", "command variation"]
    ranked = pd.DataFrame({"controller": names} | dict.fromkeys(columns, "1"))
    _print_top(ranked, ["c10"])
    said = capsys.readouterr().out
    assert "The first 8 of 12 controllers, and yours" in said
    assert [name for name in names if f" {name} " in said] == [*names[:8], "c10"]
