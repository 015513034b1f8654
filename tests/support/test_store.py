"""The resumable store: what survives an interruption, and what is left alone."""

import json
import tempfile
from pathlib import Path

import pytest

from benchmarks.rows import TRACKING
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.store import named_rows
from tests.looping import over


def score(seed, value=1.0, **more):
    return {
        "controller": "none", "plant": "P5", "reference": "sine", "frequency_hz": 1.0,
        "ts_s": 1e-3, "seed": seed, "rmse_um": value, "status": "ok", **more,
    }  # fmt: skip


def case(number, value=1.0, **more):
    return {"key": f"single/creep/{number}", "number": number, "value": value, **more}


def scores(path):
    return TRACKING.open(path.parent)


def fresh(folder):
    """The path of a store in a new folder."""
    return Path(tempfile.mkdtemp(dir=folder)) / "out" / "rows.jsonl"


both = over(
    "opened, row, name",
    [(scores, score, TRACKING.key), (named_rows, case, lambda row: row["key"])],
)


@both
def test_rows_come_back_and_the_later_of_two_counts(tmp_path, opened, row, name):
    path = fresh(tmp_path)
    store = opened(path)
    store.append([row(0), row(1, note="µm")])
    store.append([row(1, 7.0)])
    again = opened(path)
    assert store.rows == again.rows == {name(row(0)): row(0), name(row(1)): row(1, 7.0)}
    assert again.damaged == 0


@both
def test_a_torn_last_line_is_dropped_and_the_next_row_stands_on_its_own_line(
    tmp_path, opened, row, name
):
    path = fresh(tmp_path)
    opened(path).append([row(0), row(1)])
    path.write_bytes(path.read_bytes()[:-20])
    store = opened(path)
    assert (list(store.rows), store.damaged) == ([name(row(0))], 1)
    store.append([row(2)])
    again = opened(path)
    assert (set(again.rows), again.damaged) == ({name(row(0)), name(row(2))}, 0)


@both
@over("kept", [0, 5])
def test_a_torn_first_line_is_an_empty_store(tmp_path, opened, row, name, kept):
    path = fresh(tmp_path)
    opened(path).append([row(0)])
    path.write_bytes(path.read_bytes()[:kept])
    store = opened(path)
    assert store.rows == {}
    store.append([row(3)])
    assert list(opened(path).rows) == [name(row(3))]


@both
def test_a_line_that_is_no_row_is_dropped(tmp_path, opened, row, name):
    path = fresh(tmp_path)
    opened(path).append([row(0)])
    with path.open("a") as stream:
        stream.write('{"controller": "none", "key": 3}\n[1, 2]\nnot json\n')
    assert opened(path).damaged == 3
    opened(path).append([row(1)])
    assert set(opened(path).rows) == {name(row(0)), name(row(1))}
    assert opened(path).damaged == 0


@both
@over("text", ["a,b\n1,2\n", "my notes", '{"format": "mine"}\n'])
def test_a_foreign_file_is_refused_and_left_alone(tmp_path, opened, row, name, text):
    path = fresh(tmp_path)
    path.parent.mkdir()
    path.write_text(text)
    with pytest.raises(InputError, match="not a file of rows") as error:
        opened(path)
    assert "\n" not in str(error.value)
    assert path.read_text() == text


@both
def test_stale_rows_are_moved_aside_and_kept(tmp_path, opened, row, name):
    path = fresh(tmp_path)
    store = opened(path)
    store.append([row(0, code="old"), row(1, code="new")])
    aside = store.set_aside(lambda each: each["code"] != "new")
    assert aside.name == "rows-stale-1.jsonl"
    assert list(store.rows) == list(opened(path).rows) == [name(row(1))]
    kept = json.loads(aside.read_text().splitlines()[1])
    assert kept == row(0, code="old") | {"sum": kept["sum"]}
    assert opened(path).set_aside(lambda each: each["code"] != "new") is None
    store.append([row(2, code="old")])
    assert store.set_aside(lambda each: each["code"] != "new").name == "rows-stale-2.jsonl"


def test_rows_of_one_sweep_are_not_taken_for_those_of_another(tmp_path):
    path = fresh(tmp_path)
    named_rows(path).append([case(0)])
    with pytest.raises(InputError, match="not a file of rows"):
        scores(path)


@both
def test_rows_of_an_earlier_release_are_kept_aside_and_not_trusted(tmp_path, opened, row, name):
    path = fresh(tmp_path)
    path.parent.mkdir()
    form = "rdpi-bench-rows" if opened is scores else "rdpi-hidden-rows"
    before = json.dumps({"format": form, "version": 1}) + "\n" + json.dumps(row(0)) + "\n"
    path.write_text(before)
    store = opened(path)
    assert store.rows == {}
    assert "no check sums" in store.remark()
    assert path.read_text() == before  # reading changes nothing
    store.append([row(1)])
    assert list(opened(path).rows) == [name(row(1))]
    assert store.remark() is opened(path).remark() is None
    assert path.with_name("rows-unsummed-1.jsonl").read_text() == before


@both
def test_two_stores_on_one_file_lose_nothing_of_each_other(tmp_path, opened, row, name):
    path = fresh(tmp_path)
    one, other = opened(path), opened(path)
    one.append([row(0)])
    path.write_bytes(path.read_bytes() + b'{"half a li')
    other.append([row(1)])
    third = opened(path)  # sees the damaged line
    one.append([row(2)])
    assert third.damaged == 1
    third.append([row(3)])
    assert set(opened(path).rows) == {name(row(k)) for k in range(4)}
    assert opened(path).damaged == 0


def test_names_that_are_no_unicode_come_back(tmp_path):
    path = fresh(tmp_path)
    named_rows(path).append([case(0, note="a\udc80b")])
    assert named_rows(path).rows[case(0)["key"]]["note"] == "a\udc80b"


def test_a_folder_that_cannot_be_made_is_said_so(tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"):
        named_rows(tmp_path / "out" / "rows.jsonl").append([case(0)])
