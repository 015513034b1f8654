"""Archives of several channels, realisations and periods: one axis with the other inputs beside it."""

from __future__ import annotations

import numpy as np
import pytest

from rdpi_gym.measurement import DATA_HINT, DataOptions, load, measured_data
from tests.looping import over

SAMPLES, INPUTS, REALISATIONS, PERIODS = 50, 3, 2, 2
TS = DataOptions(sampling_time_s=0.01)


def arrays(seed=0):
    return np.random.default_rng(seed).normal(size=(SAMPLES, INPUTS, REALISATIONS, PERIODS))


@pytest.fixture
def mirror(tmp_path):
    path = tmp_path / "mirror.npz"
    parts = {
        f"{side}_{part}": arrays(k + 5 * (side == "u"))
        for k, part in enumerate(("train", "test"))
        for side in "uy"
    }
    np.savez(path, **parts)
    return path, parts


def test_one_axis_its_own_input_and_the_others_beside_it(mirror) -> None:
    path, parts = mirror
    data = load(path, TS)
    assert [r.name for r in data.train] == ["train-1", "train-2"]
    assert [r.name for r in data.validation] == ["validation-test-1", "validation-test-2"]
    record = data.train[1]
    u = parts["u_train"][:, :, 1, :]
    np.testing.assert_array_equal(record.u_V, np.concatenate([u[:, 0, 0], u[:, 0, 1]]))
    np.testing.assert_array_equal(record.others["u3"], np.concatenate([u[:, 2, 0], u[:, 2, 1]]))
    assert list(record.others) == ["u2", "u3"]
    assert record.period.tolist() == [0] * SAMPLES + [1] * SAMPLES
    assert record.error_mask.tolist() == [False] * SAMPLES + [True] * SAMPLES
    assert "channel y1 of 3, realisation 2 of 2" in record.remarks


def test_another_axis_and_another_input(mirror) -> None:
    path, parts = mirror
    record = load(path, DataOptions(sampling_time_s=0.01, columns={"y": "y3"})).train[0]
    np.testing.assert_array_equal(record.y_um[:SAMPLES], parts["y_train"][:, 2, 0, 0])
    np.testing.assert_array_equal(record.u_V[:SAMPLES], parts["u_train"][:, 2, 0, 0])
    record = load(path, DataOptions(sampling_time_s=0.01, input="u2")).train[0]
    np.testing.assert_array_equal(record.u_V[:SAMPLES], parts["u_train"][:, 1, 0, 0])
    assert list(record.others) == ["u1", "u3"]


@over(
    "options, said",
    [
        ({"input": "u4"}, "u_train has no channel u4; there are u1, u2, u3"),
        ({"columns": {"y": 2}}, "channel 2 of y; give one as in y2, counted from 1"),
        ({"input": "left"}, "channel 'left' of u; give one as in u2"),
    ],
)
def test_a_channel_that_is_not_there(mirror, refusal, options, said) -> None:
    assert said in refusal(mirror[0], DataOptions(sampling_time_s=0.01, **options))


def test_arrays_that_do_not_fit(tmp_path, refusal) -> None:
    np.savez(tmp_path / "a.npz", u_low=np.zeros((40, 3, 2)), y_low=np.zeros((40, 3, 1)))
    assert "u_low is 40x3x2x1 and y_low 40x3x1x1; give both the same" in refusal(
        tmp_path / "a.npz", TS
    )
    np.savez(tmp_path / "b.npz", u_low=np.zeros(40), y_low=np.zeros(40))
    assert "give numbers, samples x channels x realisations x periods" in refusal(
        tmp_path / "b.npz", TS
    )


def test_names_that_carry_units_are_no_stack(tmp_path) -> None:
    u = np.sin(np.arange(40.0))
    np.savez(tmp_path / "run.npz", t_s=0.1 * np.arange(40), u_V=u, y_um=2 * u)
    (record,) = load(tmp_path / "run.npz").records
    assert record.name == "run"
    np.testing.assert_array_equal(record.y_um, 2 * u)


def test_the_mirror_is_read_as_published() -> None:
    folder = measured_data("fsm")
    if folder is None:
        pytest.skip(DATA_HINT)
    options = DataOptions(sampling_time_s=1 / 6400, units={"y": "m"})
    data = load(folder / "fsm_float32.npz", options)
    assert (len(data.train), len(data.validation)) == (18, 9)
    for record in data.records:
        assert list(record.others) == ["u2", "u3"]
        level = 0.3 if "300mV" in record.name else 0.2 if "200mV" in record.name else 0.1
        assert record.u_V.std() == pytest.approx(level, rel=0.02)
