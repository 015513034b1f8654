"""`rdpi bench`: files, belief and core, refusals before anything runs, controllers that fail."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from baselines import FULL_PREVIEW, needed_core
from benchmarks.rows import Outcome
from benchmarks.tracking.controllers import own_of
from benchmarks.tracking.evaluation import (
    CASE,
    COLUMNS,
    evaluate,
    ranking,
    ranking_view,
    score_table,
)
from benchmarks.tracking.report import write_benchmark_page
from benchmarks.tracking.run import TRACE_SAMPLES, benchmark
from benchmarks.tracking.selection import select
from rdpi_gym.cli import main
from rdpi_gym.cli.tables import print_table
from rdpi_gym.face.benchmarking import first_of
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.cores.duhem import Duhem
from rdpi_gym.plant.cores.stop import Stop
from rdpi_gym.support.markdown import LEADING_ROWS, leading_rows
from tests.looping import over
from tests.test_house import LONGEST_PAGE_WORDS
from tests.unpacked import read_page, words_of

TABLES = Path(__file__).parents[2] / "studies" / "results"
SMALL = [
    "bench", "--controllers", "none,classical-static", "--references", "sine",
    "--plants", "P5", "--ts", "1e-3", "--seeds", "2", "--jobs", "1",
]  # fmt: skip


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench") / "out"
    assert main([*SMALL, "--out", str(folder)]) == 0
    return folder


def test_numbers_come_while_it_runs_and_few_lines_are_printed(tmp_path, capsys):
    assert main([*SMALL, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr()
    told = printed.err.strip().splitlines()
    assert [line.split()[0] for line in told] == ["none", "classical-static"]
    ranked = pd.read_csv(tmp_path / "ranking.csv").set_index("controller")["rmse_percent"]
    for name, plant, error, _ in map(str.split, told):
        assert plant == "P5"
        assert float(error) == pytest.approx(ranked[name], rel=5e-3)
    lines = printed.out.strip().splitlines()
    assert len(lines) + 8 <= 25
    assert "No scores on measured records" not in printed.out
    assert main([*SMALL, "--out", str(tmp_path), "--verbose"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""  # nothing was computed
    assert "No scores on measured records" in printed.out
    assert len(printed.out.strip().splitlines()) > len(lines)


def test_it_writes_table_text_picture_and_a_page_that_lets_the_reader_choose_a_pair(out):
    table = pd.read_csv(out / "leaderboard.csv")
    assert tuple(table.columns) == COLUMNS
    # sines of 1, 10, 25 and 50 Hz by two controllers and two seeds
    assert len(table) == 16
    assert not table.duplicated(["controller", *CASE, "seed"]).any()
    assert "classical-static" in (out / "leaderboard.md").read_text()
    assert (out / "leaderboard.png").read_bytes().startswith(b"\x89PNG")
    page = read_page(out / "report.html")
    assert not re.search(r'<(script|link|img)[^>]+(src|href)="https?:', page)  # self-contained
    for words in ("Traces of any pair", '"A: classical-static"', '"B: none"'):
        assert words in page
    assert (out / "report.html").stat().st_size < 3e6


@pytest.mark.slow
def test_the_page_of_all_controllers_is_ten_minutes_of_reading(tmp_path):
    """Written from the committed scores, of two seeds at two sampling times; traces are made up."""
    selection = select(seeds=range(2))
    plants = [stage.plant.name for stage in selection.stages]
    scores = pd.read_csv(TABLES / "tracking" / "leaderboard.csv")
    kept = scores["plant"].isin(plants) & scores["seed"].isin(selection.seeds)
    scores = scores[kept & scores["ts_s"].isin([1e-4, *scores.groupby("plant")["ts_s"].min()])]
    rows = scores.assign(command_variation_V_s=scores["command_total_variation"]).to_dict("records")
    rng = np.random.default_rng(0)
    signals = ("reference_um", "displacement_um", "error_um", "command_V")
    for row in rows:
        samples = {name: rng.standard_normal(TRACE_SAMPLES).tolist() for name in signals}
        row["trace"] = {"step_s": row["ts_s"], **samples}
    results = evaluate(selection, Outcome(rows, 0, ()))
    payoff = pd.read_csv(TABLES / "payoff" / "payoff.csv")
    page = write_benchmark_page(tmp_path / "report.html", results, payoff)
    assert page.stat().st_size < 3e6
    text = page.read_text(encoding="utf-8")
    assert text.count("<tr>") > len(results.order) > LEADING_ROWS
    first = text.partition("</section>")[0]
    assert first.count("<tr>") == 1 + LEADING_ROWS
    assert 500 < len(words_of(text)) <= LONGEST_PAGE_WORDS


def test_a_second_run_computes_nothing_and_ends_with_what_it_wrote(out, capsys):
    assert main([*SMALL, "--out", str(out)]) == 0
    lines = capsys.readouterr().out.strip().splitlines()
    assert lines[0].startswith("Smallest error: classical-static, RMSE 0.")
    assert "µm), 95 %" not in lines[0]  # one drawn seed has no interval
    assert "24 rows, 0 of them computed now" in lines
    assert lines[-2:] == [f"leaderboard: {out / 'leaderboard.md'}", f"page: {out / 'report.html'}"]


FRICTION = PlantModel(
    Stop((2.0, 1.0, 0.5), (1.0, 4.0, 8.0), 0.3), "friction", (-30.0, 30.0), (0.0, 8.0)
)
SLOW = ["--references", "sine", "--ts", "5e-3", "--jobs", "1", "--seeds", "1"]


def test_a_plant_with_one_core_is_scored_with_a_belief_of_another(tmp_path, capsys):
    """On its own belief the search is exact; on a belief with another core it is not."""
    truth = str(FRICTION.save(tmp_path / "friction.json"))
    belief = PlantModel(Duhem(0.6, 3.5, 3.0), "smooth", (-30.0, 30.0), (0.0, 8.0))
    told = str(belief.save(tmp_path / "smooth.json"))
    command = ["bench", "--plants", truth, "--belief", told, "--controllers", "none,core-inverse"]
    out = tmp_path / "out"
    assert main([*command, *SLOW, "--out", str(out)]) == 0
    table = pd.read_csv(out / "leaderboard.csv")
    assert set(table["belief"]) == {"smooth"}
    wrong = table.groupby("controller")["rmse_um"].max()
    own = benchmark(
        select(["core-inverse"], [FRICTION], ["sine"], [5e-3], [0]), tmp_path / "own", 1
    )
    right = max(row["rmse_um"] for row in own.rows)
    stroke_um = 16.0
    assert right < 1e-4 * stroke_um < 1e-3 * stroke_um < wrong["core-inverse"] < wrong["none"]
    capsys.readouterr()
    assert main([*command, *SLOW, "--controllers", "pi-classical-static", "--out", str(out)]) == 2
    assert capsys.readouterr().err == (
        "rdpi: pi-classical-static inverts the core rdpi, and the core that is believed of the plant "
        "is duhem; core-inverse inverts any\n"
    )


def test_by_default_only_controllers_that_suit_the_core_run_and_one_line_says_which_do_not(
    monkeypatch,
):
    monkeypatch.setattr("benchmarks.tracking.selection.shipped_policies", lambda: ([], ()))
    selection = select(None, [FRICTION], ["sine"], [1e-3], [0])
    assert set(selection.controllers) >= {
        "adaptive-feedforward", "core-inverse", "none", "pi", "pi-core-inverse", "pi-none",
        "preview-inversion", FULL_PREVIEW,
    }  # fmt: skip
    assert not any(needed_core(name) is RDPI for name in selection.controllers)
    assert len(selection.notes) == 1
    assert selection.notes[0].startswith(
        "Left out, since they invert the core rdpi and the belief has stop: classical-literal,"
    )
    told = select(None, [FRICTION], ["sine"], [1e-3], [0], belief="P5")
    assert "classical-static" in told.controllers
    assert "core-inverse" not in told.controllers
    mixed = select(["classical-static", "pi"], [FRICTION, "P5"], ["sine"], [1e-3], [0])
    runs = [mixed.runs_at("classical-static", stage, 1e-3) for stage in mixed.stages]
    assert runs == [False, True]
    assert [mixed.is_ranked(name) for name in mixed.controllers] == [False, True]


@over(
    "arguments, said",
    [
        (["--plants", "P5,P10", "--belief", "P5"], "2 plants and a belief; give the one plant"),
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


BROKEN = """
import numpy as np

class Broken:
    def __init__(self, belief, layout):
        self.ts_s = layout.ts_s

class Raises(Broken):
    def predict(self, *arguments, **keywords):
        raise OSError("no\\nway")

def answering(answer):
    return type("Answering", (Broken,), {"predict": lambda self, o, *_, **__: answer(len(o))})

Alone = answering(lambda lanes: np.zeros((lanes, 1)))
Shape = answering(lambda lanes: (np.zeros(3), None))
NaN = answering(lambda lanes: (np.full((lanes, 1), np.nan), None))
Words = answering(lambda lanes: (["up", "down"], None))

class Later(Broken):
    def predict(self, observation, state=None, *arguments, **keywords):
        k = 0 if state is None else state
        if self.ts_s < 5e-4 and k > 50:
            raise OSError("no")
        return np.zeros((len(observation), 1)), k + 1

def make(belief, layout):
    raise ZeroDivisionError("none made")

number = 3
"""


@pytest.fixture
def broken(tmp_path, monkeypatch, request):
    name = f"broken_{abs(hash(request.node.name)) % 10**6}"
    (tmp_path / f"{name}.py").write_text(BROKEN)
    monkeypatch.syspath_prepend(tmp_path)
    return name


@over(
    "name, said",
    [
        ("Broken", "makes a Broken without predict"),
        ("Raises", r"raises OSError: no way \(broken\w*.py, line 10\)"),
        ("Alone", r"its predict returns a ndarray; give \(action, state\)"),
        ("Shape", r"2 observations with an action of shape \(3,\); give \(2, 1\)"),
        ("NaN", "its action is not finite"),
        ("Words", "its action is a list; give an array of numbers"),
        ("make", "raises ZeroDivisionError: none made"),
        ("number", "makes a int without predict"),
        ("missing", "has no 'missing'"),
    ],
)
def test_what_does_not_control_is_one_line_before_anything_is_computed(
    name, said, broken, tmp_path, capsys
):
    out = tmp_path / "out"
    assert main([*SMALL, "--controller", f"{broken}:{name}", "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert re.search(said, error)
    assert error.count("\n") == 1
    assert len(error) < 400
    assert not out.exists()


def test_one_that_fails_later_has_rows_that_say_so_and_the_others_are_ranked(
    broken, tmp_path, capsys
):
    out, name = tmp_path / "out", f"{broken}:Later"
    arguments = [
        "bench", "--controllers", "none", "--controller", name, "--plants", "P5", "--references",
        "steps", "--ts", "1e-3,2e-4", "--seeds", "1", "--jobs", "1", "--out", str(out),
    ]  # fmt: skip
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert f"{name} has no score in 1 of 2 rows; the first says 'error: OSError: no'" in said.err
    assert said.err.count("rdpi: ") == 1
    assert "error 1/2" in said.out
    assert said.out.startswith("Smallest error: none")
    table = pd.read_csv(out / "leaderboard.csv").set_index(["controller", "ts_s"])["status"]
    assert table[name].to_dict() == {1e-3: table[name, 1e-3], 2e-4: "error: OSError: no"}
    assert "error" not in table[name, 1e-3]
    ranked = pd.read_csv(out / "ranking.csv").set_index("controller")
    assert ranked.loc[name, "rank"] == "–"
    assert ranked.loc[name, "status"].startswith("error 1/2")


def bench(out, *words):
    """Run the command on sines on P5 and return its table."""
    fixed = ["--plants", "P5", "--references", "sine", "--jobs", "1", "--out", str(out)]
    assert main(["bench", *fixed, *words]) == 0
    return pd.read_csv(out / "leaderboard.csv")


def test_status_is_a_column_everywhere(tmp_path, capsys):
    names = "inversion-free-literal,none,full-preview-inversion"
    bench(tmp_path, "--controllers", names, "--ts", "2e-4", "--seeds", "2")
    unstable = "unstable 14/14"
    assert unstable in capsys.readouterr().out
    assert unstable in (tmp_path / "leaderboard.md").read_text()
    ranked = pd.read_csv(tmp_path / "ranking.csv").set_index("controller")
    assert ranked.loc["inversion-free-literal", "status"].startswith(unstable)
    assert ranked.loc["full-preview-inversion", ["rank", "status"]].tolist() == ["bound", "bound"]
    page = (tmp_path / "report.html").read_text()
    assert unstable in page


def test_the_bound_alone_is_scored(tmp_path):
    words = ["--controllers", "full-preview-inversion", "--ts", "1e-3", "--seeds", "1"]
    table = bench(tmp_path, *words, "--seed", "4")
    assert (table["optimality_gap"] == 1.0).all()
    assert (table["seed"] == 4).all()


def test_the_users_own_controller_is_printed_wherever_it_stands(capsys):
    names = [f"c{i}" for i in range(12)]
    rows = [
        {
            "controller": name, "plant": "P5", "belief": "P5", "reference": "sine", "ts_s": 1e-3,
            "frequency_hz": 1.0, "seed": seed, "rmse_um": 1.0 + i, "rmse_percent": 1.0 + i,
            "microseconds_per_sample": 1.0, "command_variation_V_s": 1.0, "status": "ok",
        }
        for i, name in enumerate(["full-preview-inversion", *names])
        for seed in (1, 2)
    ]  # fmt: skip
    ranked = ranking(score_table(rows))
    title, table = first_of(ranked, ["c10"])
    print_table(table, title)
    said = capsys.readouterr().out
    assert "The first 8 of 12 controllers, and yours" in said
    assert [name for name in names if f" {name} " in said] == [*names[:8], "c10"]
    assert "bound" not in said
    *_, ninth, _, last = leading_rows(ranking_view(ranked), "ranking.csv", own=["c10"]).splitlines()
    assert ninth.startswith("| 11 | c10 |")
    assert last == "The first 8 of 13 rows of `ranking.csv`, and yours."
    asked = ["pi", "learned:ppo-increment", "guarded:ppo-increment", "learned:of/mine", "mine:make"]
    assert own_of([*asked, "full-preview-inversion"]) == asked[3:]
