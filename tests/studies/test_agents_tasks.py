"""The page of agents: what it says of the registered tasks is what a fresh scoring gives."""

from pathlib import Path

import pandas as pd
import pytest

pytest.importorskip("torch")

from benchmarks.stages.ranking import ranking
from benchmarks.stages.run import run_tasks
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import number
from studies.agents.page import standing_view, strangest, task_leaders
from studies.training_race import TABLE, read_rankings

PAGE = Path(__file__).parents[2] / "docs" / "agents.md"


@pytest.mark.slow
def test_the_shipped_policys_number_on_the_page_is_that_of_a_fresh_scoring(tmp_path):
    shown = task_leaders(read_rankings()).set_index("task").loc["Bare"]
    plants = int(TABLE.with_suffix(".md").read_text().split(" plants a task")[0].split()[-1])
    rows = run_tasks([shown["learned"]], ["Bare"], plants, tmp_path, bound=False).rows
    fresh = number(ranking(rows).iloc[0]["iqm_percent"])
    assert fresh == number(shown["learned_iqm_percent"])
    name = shown["learned"].removeprefix("learned:")
    assert f"| Bare | `{name}`: {fresh} (0 % fail) |" in PAGE.read_text(encoding="utf-8")


def rankings(*rows):
    columns = ["task", "controller", "failed", "p90_percent", "iqm_percent"]
    return pd.DataFrame(rows, columns=columns)


def test_a_policy_that_fails_everywhere_has_no_ratio():
    found = task_leaders(
        rankings(
            ("Slow", "hybrid", 0.0, 0.2, 0.1),
            ("Slow", "guarded:ppo", 0.0, 0.9, 0.6),
            ("Slow", "learned:ppo", 1.0, 100.0, 100.0),
        )
    )
    line = standing_view(found).iloc[0]
    assert line["best policy"] == "`ppo`: 100 (100 % fail)"
    assert line["best with its monitor"] == "`ppo`: 0.6 (0 % fail)"
    assert line["policy's IQM over that"] == "–"


def test_the_student_farthest_from_what_it_corrects_is_named_where_none_fails():
    found = rankings(
        ("Bare", "adaptive-core-bank", 0.0, 0.2, 0.1),
        ("Bare", "learned:imitation-a", 0.0, 0.9, 0.3),
        ("Bare", "learned:ppo", 0.0, 9.0, 8.0),
        ("Slow", "adaptive-core-bank", 0.0, 0.2, 0.05),
        ("Slow", "learned:imitation-a", 0.0, 0.3, 0.2),
        ("Slow", "learned:imitation-b", 0.5, 100.0, 100.0),
    )
    told = strangest(found, "learned:imitation-")
    assert told == {"student": "imitation-a", "task": "Slow", "times": pytest.approx(4.0)}


def test_a_table_that_lacks_policies_is_one_clear_line(tmp_path):
    with pytest.raises(InputError, match=r"^.*no\.csv is missing; run rdpi bench --full$"):
        read_rankings(tmp_path / "no.csv")
    with pytest.raises(InputError, match=r"^Bare has no guarded: policy; score those that ship"):
        task_leaders(
            rankings(("Bare", "hybrid", 0.0, 0.2, 0.1), ("Bare", "learned:a", 0.0, 0.3, 0.2))
        )
