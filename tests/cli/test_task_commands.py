"""`rdpi bench --task`, `rdpi submit` and `rdpi score` through the command line, bad input included."""

import gzip
import json
import shutil
from dataclasses import replace

import pandas as pd
import pytest

pytest.importorskip("torch")

import rdpi_gym.cli as cli
from baselines import HORIZON_BOUND, make_controller
from baselines.learned.policy import SHIPPED
from benchmarks.stages import entries

OWN = """
from baselines import make_controller

def mine(belief, layout):
    return make_controller("classical-static", belief, layout)
"""


@pytest.fixture(autouse=True)
def a_bound_that_is_quick(monkeypatch):
    """Let a plain inverse stand for the bound, which takes seconds."""

    def make(lanes):
        return make_controller("classical-reference-rate", lanes.belief, lanes.layout())

    quick = replace(entries.BESIDE[HORIZON_BOUND], make=make)
    monkeypatch.setitem(entries.BESIDE, HORIZON_BOUND, quick)


@pytest.fixture(scope="module")
def submitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("submission")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        (folder / "my_stage_controller.py").write_text(OWN)
        words = ["submit", "my_stage_controller:mine", "--task", "Bare", "--draws", "2"]
        assert cli.main([*words, "--jobs", "1", "--out", str(folder / "entry")]) == 0
    return folder / "entry"


def refused(capsys, *words):
    assert cli.main(list(words)) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


@pytest.mark.slow
def test_a_submission_scored_twice_gives_equal_numbers(submitted, tmp_path, capsys):
    tables = []
    for name in ("first", "second"):
        words = ["score", str(submitted), "--jobs", "1", "--out", str(tmp_path / name)]
        assert cli.main(words) == 0
        said = capsys.readouterr().out
        assert "The submitted rows are reproduced, all 2." in said
        assert "public seed 2026" in said
        rows = (tmp_path / name / "tasks.csv").read_text().splitlines()
        head = rows[0].split(",")
        timed = head.index("microseconds_per_sample")
        tables.append([[c for i, c in enumerate(r.split(",")) if i != timed] for r in rows])
    assert tables[0] == tables[1]
    assert json.loads((submitted / "submission.json").read_text())["tasks"] == ["Bare"]


def test_a_private_seed_has_plants_of_its_own_and_every_table_says_so(submitted, tmp_path, capsys):
    (tmp_path / "seed").write_text("98765432109876543210")
    words = ["score", str(submitted), "--seed-file", str(tmp_path / "seed"), "--jobs", "1"]
    assert cli.main([*words, "--out", str(tmp_path / "out")]) == 0
    assert "private seed" in capsys.readouterr().out
    text = (tmp_path / "out" / "tasks.md").read_text()
    assert text.count("private seed") == 1
    assert "98765432109876543210" not in text


def changed(submitted, tmp_path, **values):
    folder = shutil.copytree(submitted, tmp_path / "entry")
    document = json.loads((folder / "submission.json").read_text())
    (folder / "submission.json").write_text(json.dumps(document | values))
    return folder


def test_a_submission_that_is_not_whole_is_refused_in_one_line(submitted, tmp_path, capsys):
    folder = changed(submitted, tmp_path, plants=3)
    assert "lacks 1 of 3 rows, the first that of task Bare, plant 2; run its command again" in (
        refused(capsys, "score", str(folder))
    )
    shutil.rmtree(folder)
    folder = changed(submitted, tmp_path, plants=10**12)  # no list of so many
    assert "lacks 999999999998 of 1000000000000 rows" in refused(capsys, "score", str(folder))
    shutil.rmtree(folder)
    folder = changed(submitted, tmp_path, suite=0)
    assert "is of task suite 0" in refused(capsys, "score", str(folder))
    shutil.rmtree(folder)
    folder = changed(submitted, tmp_path)
    (code,) = folder.glob("submitted_*.py")
    code.write_text(OWN + "#")
    assert "its hash differs" in refused(capsys, "score", str(folder))


def test_what_a_link_leads_to_is_not_handed_in(tmp_path, capsys):
    policy = shutil.copytree(SHIPPED / "ppo-correction", tmp_path / "policy")
    (tmp_path / "secret").write_text("of the user's own")
    (policy / "notes.txt").symlink_to(tmp_path / "secret")
    out = tmp_path / "entry"
    words = ["--task", "Bare", "--draws", "1", "--jobs", "1", "--out", str(out)]
    assert "notes.txt is a link" in refused(capsys, "submit", f"learned:{policy}", *words)
    assert not any("of the user" in f.read_text(errors="replace") for f in out.rglob("*.txt"))


def test_bad_words_are_answered_in_one_line(capsys, tmp_path_factory, monkeypatch, subtests):
    for words, said in [
        (["bench", "--task", "Stag"], "did you mean 'Stage'"),
        (["bench", "--task", "Stage", "--plants", "P5"], "--plants is not for registered tasks"),
        (["bench", "--draws", "3"], "--among are of registered tasks"),
        (["bench", "--full", "--task", "Stage"], "--full is every task"),
        (["bench", "--task", "Bare", "--seed-file", "no-such-file"], "no-such-file cannot be read"),
        (["submit", "pii"], "did you mean 'pi'"),
        (["score", "no-such-folder"], "does not exist"),
    ]:
        with subtests.test(words=words, said=said):
            tmp_path = tmp_path_factory.mktemp("case")
            monkeypatch.chdir(tmp_path)
            assert said in refused(capsys, *words)


def test_bench_ranks_on_a_task_and_goes_on(tmp_path, capsys):
    words = ["bench", "--task", "Bare", "--draws", "2", "--controllers", "none"]
    words += ["--jobs", "1", "--out", str(tmp_path)]
    assert cli.main(words) == 0
    first = capsys.readouterr().out
    assert first.startswith("Bare: none first")
    assert "4 rows, 4 of them computed now" in first
    assert cli.main(words) == 0
    assert "4 rows, 0 of them computed now" in capsys.readouterr().out
    assert cli.main([*words, "--no-bound", "--against", str(tmp_path / "task-rows.csv.gz")]) == 0
    said = capsys.readouterr().out
    assert "2 of 2 rows are as task-rows.csv.gz states them." in said
    assert "true-plant-horizon" not in said


def test_bench_ranks_a_controller_anew_among_those_of_a_table(tmp_path, capsys):
    def table(folder, controllers, *more):
        words = ["bench", "--task", "Bare", "--draws", "2", "--controllers", controllers, *more]
        assert cli.main([*words, "--jobs", "1", "--out", str(tmp_path / folder)]) == 0
        capsys.readouterr()
        text = gzip.decompress((tmp_path / folder / "task-rows.csv.gz").read_bytes()).decode()
        ranked = pd.read_csv(tmp_path / folder / "tasks.csv", keep_default_na=False)
        return text.splitlines(), ranked.set_index("controller")

    rows, ranked = table("all", "none,classical-static")
    again, merged = table("some", "none", "--no-bound", "--among", str(tmp_path / "all"))
    assert [row for row in again if ",none," not in row] == [
        row for row in rows if ",none," not in row
    ]
    timed = [",".join(row.split(",")[:8]) for row in rows]
    assert [",".join(row.split(",")[:8]) for row in again] == timed
    assert merged.index.tolist() == ranked.index.tolist()
    kept = ["rank", "sees", "certificate", "tuning_samples", "places", "failure"]
    assert merged[kept].equals(ranked[kept])
    assert "Scored now: `none`;" in (tmp_path / "some" / "tasks.md").read_text()
    words = ["bench", "--task", "Bare", "--draws", "1", "--controllers", "none", "--no-bound"]
    words += ["--jobs", "1", "--out", str(tmp_path / "one"), "--among", str(tmp_path / "all")]
    assert "holds not the plants of Bare" in refused(capsys, *words)
