"""Which records and samples a fit sees, which it is checked on, and which are kept aside."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rdpi_gym.measurement import DataOptions, Dataset, Record, hold_out_blocks, load


@pytest.fixture
def folder(tmp_path, write, sine_lines):
    def make(*names: str, **text: str):
        for name in names:
            amplitude_V = 0.0 if "quiet" in name else 1.0
            write(f"{name}.csv", "\n".join(sine_lines(amplitude_V=amplitude_V)))
        for name, content in text.items():
            write(f"{name}.toml", content)
        return tmp_path

    return make


def names(records: tuple[Record, ...]) -> list[str]:
    return [record.name for record in records]


def test_names_that_begin_with_validation(folder) -> None:
    data = load(folder("a", "b", "validation", "validation_2", "my_validation"))
    assert names(data.train) == ["a", "b", "my_validation"]
    assert names(data.validation) == ["validation", "validation_2"]
    assert all(r.error_mask.all() for r in (*data.train, *data.validation))


def test_the_pattern_where_no_name_says_so(folder) -> None:
    data = load(folder("a", "run_1", "run_2"), DataOptions(validate="run_?"))
    assert names(data.train) == ["a"]
    assert names(data.validation) == ["run_1", "run_2"]


def test_the_pattern_gives_way_to_names_and_says_so(folder) -> None:
    data = load(folder("a", "b", "validation"), DataOptions(validate="b"))
    assert names(data.validation) == ["validation"]
    assert "--validate 'b' was not needed: validation is named so" in data.describe()


def test_a_pattern_without_a_match(folder, refusal) -> None:
    line = refusal(folder("a", "b"), DataOptions(validate="c*"))
    assert "--validate 'c*' matches no record with changing u; they are a, b" in line


def test_the_role_of_the_folder_wins_over_the_name(folder) -> None:
    toml = "[records.a]\nrole = 'validation'\n[records.validation]\nrole = 'train'\n"
    data = load(folder("a", "validation", dataset=toml))
    assert (names(data.train), names(data.validation)) == (["validation"], ["a"])


def test_the_pattern_wins_over_the_role_of_the_folder_and_says_so(folder) -> None:
    toml = "[records.a]\nrole = 'validation'\n"
    data = load(folder("a", "b", dataset=toml), DataOptions(validate="b"))
    assert (names(data.train), names(data.validation)) == (["a"], ["b"])
    assert "--validate 'b' overrides dataset.toml for a" in data.describe()


def test_else_a_quarter_of_each_record_in_blocks(folder) -> None:
    data = load(folder("a", "b"))
    assert names(data.train) == names(data.validation) == ["a", "b"]
    for train, validation, whole in zip(data.train, data.validation, data.records, strict=True):
        # whole in memory, so that a simulation carries its state into each block
        assert train.u_V is validation.u_V is whole.u_V
        assert whole.error_mask.all()
        assert (train.role, validation.role) == ("train", "validation")
        held_out = [9, 10, 11, 21, 22, 23, 30, 31, 38, 39]
        assert np.flatnonzero(validation.error_mask).tolist() == held_out
        np.testing.assert_array_equal(train.error_mask, ~validation.error_mask)
    assert "a quarter of each record, in blocks, is held out for validation" in data.describe()


def test_quiet_records_are_kept_aside(folder) -> None:
    data = load(folder("a", "quiet", "validation", "validation_quiet"))
    assert names(data.train) == ["a"]
    assert names(data.validation) == ["validation"]
    assert names(data.quiet) == ["quiet", "validation_quiet"]
    assert "quiet (quiet): 40 samples" in data.describe()


def test_a_quiet_record_is_no_validation_record(folder) -> None:
    data = load(folder("a", "validation_quiet"))
    assert names(data.validation) == ["a"]
    assert data.holds_out_quarters


def test_test_records_are_in_neither(folder) -> None:
    data = load(folder("a", "b", dataset="[records.b]\nrole = 'test'\n"))
    assert (names(data.train), names(data.validation)) == (["a"], ["a"])
    assert names(data.test) == ["b"]


@given(st.lists(st.booleans(), min_size=16, max_size=80))
def test_a_quarter_of_what_counts_is_held_out(counted) -> None:
    mask = np.array(counted)
    t = np.arange(mask.size, dtype=float)
    train, validation = hold_out_blocks(Record("run", t, t, t, 1.0, error_mask=mask))
    np.testing.assert_array_equal(train.error_mask | validation.error_mask, mask)
    assert not (train.error_mask & validation.error_mask).any()
    assert validation.error_mask.sum() == mask.sum() // 4


def test_a_voltage_that_only_rounds_is_constant() -> None:
    t = np.arange(20.0)
    u = 3.0 + 1e-15 * np.sin(t)
    assert Record("rest", t, u, t, 1.0).is_quiet
    assert not Record("slow", t, u + 1e-6 * t, t, 1.0).is_quiet


def test_a_data_set_put_together_by_hand_splits_the_same_way() -> None:
    t = np.arange(40.0)
    data = Dataset("by hand", (Record("run", t, np.sin(t), t, 1.0),))
    assert int(data.train[0].error_mask.sum()) == 30
