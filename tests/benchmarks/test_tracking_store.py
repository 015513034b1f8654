import json

import pytest

from benchmarks.tracking.store import RowStore, key
from rdpi_gym.errors import InputError


def row(seed, value=1.0, **more):
    return {
        "controller": "none", "plant": "P5", "reference": "sine", "frequency_hz": 1.0,
        "ts_s": 1e-3, "seed": seed, "rmse_um": value, **more,
    }  # fmt: skip


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out" / "rows.jsonl"


def test_rows_come_back_and_the_later_of_two_counts(path):
    store = RowStore(path)
    store.append([row(0), row(1)])
    store.append([row(1, 7.0)])
    again = RowStore(path)
    assert again.rows == {key(row(0)): row(0), key(row(1)): row(1, 7.0)}
    assert again.damaged == 0


def test_a_torn_last_line_is_dropped_and_the_next_row_stands_on_its_own_line(path):
    RowStore(path).append([row(0), row(1)])
    path.write_bytes(path.read_bytes()[:-20])
    store = RowStore(path)
    assert (list(store.rows), store.damaged) == ([key(row(0))], 1)
    store.append([row(2)])
    again = RowStore(path)
    assert (set(again.rows), again.damaged) == ({key(row(0)), key(row(2))}, 0)


@pytest.mark.parametrize("kept", [0, 5])
def test_a_torn_first_line_is_an_empty_store(path, kept):
    RowStore(path).append([row(0)])
    path.write_bytes(path.read_bytes()[:kept])
    store = RowStore(path)
    assert store.rows == {}
    store.append([row(3)])
    assert list(RowStore(path).rows) == [key(row(3))]


def test_a_line_that_is_no_row_is_dropped(path):
    RowStore(path).append([row(0)])
    with path.open("a") as stream:
        stream.write('{"controller": "none"}\n[1, 2]\nnot json\n')
    RowStore(path).append([row(1)])
    assert set(RowStore(path).rows) == {key(row(0)), key(row(1))}


def test_a_foreign_file_is_refused_and_left_alone(path):
    path.parent.mkdir()
    path.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="not a file of rows"):
        RowStore(path)
    assert path.read_text() == "a,b\n1,2\n"


def test_stale_rows_are_moved_aside_and_kept(path):
    store = RowStore(path)
    store.append([row(0, code="old"), row(1, code="new")])
    aside = store.set_aside(lambda each: each["code"] != "new")
    assert list(store.rows) == list(RowStore(path).rows) == [key(row(1))]
    assert list(RowStore(aside).rows) == [key(row(0))]
    assert RowStore(path).set_aside(lambda each: each["code"] != "new") is None


def test_the_file_says_what_it_is(path):
    RowStore(path).append([row(0)])
    assert json.loads(path.read_text().splitlines()[0]) == {
        "format": "rdpi-bench-rows",
        "version": 1,
    }


def test_a_folder_that_cannot_be_made_is_said_so(tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"):
        RowStore(tmp_path / "out" / "rows.jsonl").append([row(0)])
