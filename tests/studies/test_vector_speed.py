"""The committed measurement of the vector environment, and the command that makes it."""

from pathlib import Path

import pandas as pd

from studies import vector_speed
from studies.vector_speed import bytes_a_lane, operations_a_lane, roofline
from tests.looping import over

PAGE = Path(__file__).parents[2] / "docs" / "vector-environment.md"


def committed(name):
    path = vector_speed.RESULTS / name
    assert path.is_file(), "python -m studies.vector_speed writes it"
    return pd.read_csv(path)


def test_the_committed_speeds_reach_what_they_must():
    table = committed("vector_speed.csv").set_index(["case", "threads"])
    assert table.index.tolist() == [(case, n) for case in vector_speed.CASES for n in (1, 2)]
    plain, effects = table.loc[("defaults", 2)], table.loc[("five effects", 2)]
    assert plain["times_cartpole"] >= 4.0, table.to_string()
    assert plain["share_of_bare"] >= 0.4, table.to_string()
    assert effects["share_of_defaults"] >= 0.3, table.to_string()
    trained = table.loc[(vector_speed.AS_TRAINED, 1)]
    assert trained["times_cartpole"] >= 1.0, table.to_string()
    assert table.loc[(vector_speed.AS_TRAINED, 2), "times_cartpole"] >= 2.0, table.to_string()


def test_the_committed_speeds_are_those_of_the_page():
    page = " ".join(PAGE.read_text(encoding="utf-8").split())
    times = committed("vector_speed.csv").set_index(["case", "threads"])["times_cartpole"]
    one, two = (times[vector_speed.AS_TRAINED, threads] for threads in (1, 2))
    assert (
        f"one thread makes {one:.2f} times the steps of CartPole, two make {two:.2f} times" in page
    )
    staggered = "as in a training, episodes end at different times"
    one, two = (times[staggered, threads] for threads in (1, 2))
    assert f"begins at every step these are {one:.2f} and {two:.2f} times" in page


def test_the_committed_bounds_say_what_the_page_says():
    table = committed("vector_roofline.csv").set_index("quantity")["one_thread"]
    assert table["bytes of a lane and step"] == sum(bytes_a_lane(plays=10, preview=8).values())
    assert table["operations of a lane and step"] == sum(operations_a_lane(plays=10).values())
    # The bytes bound a step more narrowly than the arithmetic, and it is not far from that bound.
    moved, computed = (table[f"step at the ceiling of {of}"] for of in ("the copy", "arithmetic"))
    assert computed < moved < table["compiled part of a step"] < 3 * moved
    assert table["the same by Box.sample()"] > table["step()"] / 2


def test_the_page_counts_as_the_code_does():
    page = PAGE.read_text()
    moved, done = bytes_a_lane(plays=10, preview=8), operations_a_lane(plays=10)
    for counted in (moved, done):
        for what, count in counted.items():
            assert f"| {what} | {count} |" in page
    assert f"**{sum(moved.values())} bytes**" in page
    assert f"**{sum(done.values())} operations**" in page


@over("case", vector_speed.CASES)
def test_every_case_is_measured(case):
    table = vector_speed.measure(rounds=2, duration_s=0.001, lanes=3, threads=[1], cases=[case])
    assert table["case"].tolist() == [case]
    assert (table.drop(columns="case") > 0).all(axis=None)
    assert (table["lowest"] <= table["times_cartpole"]).all()
    assert (table["times_cartpole"] <= table["highest"]).all()


def test_bytes_and_operations_follow_the_plays_and_the_preview():
    assert sum(bytes_a_lane(11, 8).values()) - sum(bytes_a_lane(10, 8).values()) == 2 * 8 + 16
    assert sum(bytes_a_lane(10, 9).values()) - sum(bytes_a_lane(10, 8).values()) == 2 * 4
    assert sum(operations_a_lane(11).values()) - sum(operations_a_lane(10).values()) == 9


def test_the_command_writes_the_tables(tmp_path, monkeypatch, capsys):
    bounds = roofline(lanes=64, repeats=1)
    assert (bounds["one_thread"] > 0).all()
    monkeypatch.setattr(vector_speed, "CASES", {"defaults": vector_speed.CASES["defaults"]})
    monkeypatch.setattr(vector_speed, "roofline", lambda lanes, repeats: bounds)
    arguments = ["--rounds", "1", "--duration", "0.001", "--lanes", "64", "--out", str(tmp_path)]
    vector_speed.main(arguments)
    speed = pd.read_csv(tmp_path / "vector_speed.csv")
    assert speed["case"].tolist() == ["defaults"] * 2
    text = (tmp_path / "vector_speed.md").read_text()
    assert "| defaults | 2 |" in text
    assert "| rdpi_block alone |" in text
    assert len(pd.read_csv(tmp_path / "vector_roofline.csv")) == len(bounds)
    assert "written to" in capsys.readouterr().out
    assert vector_speed.main([*arguments, "--only", "Cart"]) == 2
    assert "no case has 'Cart' in its name" in capsys.readouterr().err


def test_some_cases_are_measured_anew_and_the_others_stay(tmp_path, monkeypatch):
    for name in ("vector_speed.csv", "vector_roofline.csv"):
        (tmp_path / name).write_text((vector_speed.RESULTS / name).read_text())
    two = {case: vector_speed.CASES[case] for case in list(vector_speed.CASES)[:2]}
    monkeypatch.setattr(vector_speed, "CASES", two)
    words = ["--rounds", "1", "--duration", "0.001", "--lanes", "4", "--out", str(tmp_path)]
    assert vector_speed.main([*words, "--only", "beforehand"]) == 0
    before, after = (
        pd.read_csv(folder / "vector_speed.csv").set_index(["case", "threads"])["cartpole"]
        for folder in (vector_speed.RESULTS, tmp_path)
    )
    assert after["defaults"].equals(before["defaults"])
    assert after[list(two)[1], 1] < before[list(two)[1], 1]
