"""Signals by name, from JSON and from files, and what bad input is answered with."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.measurement import DataOptions, example_folder, load, write_csv
from rdpi_gym.signals import (
    SIGNALS,
    Measured,
    Sequence,
    Signal,
    Sine,
    Sum,
    first_order_reversals,
    make_signal,
    signal_from_dict,
)
from rdpi_gym.support.errors import InputError
from tests.looping import over

NEEDED = {
    "sum": {"parts": (Sine(), make_signal("noise", seed=2))},
    "sequence": {"parts": (Sine(), Sum(parts=(Sine(),))), "durations_s": (1.0, 0.1)},
    "measured": {"times_s": (0.0, 0.1, 0.3), "values_um": (1.0 / 3.0, 2.0, 1e-17)},
}
REAL = st.floats(1e-6, 1e6)


@over("name", SIGNALS)
def test_every_name_makes_its_signal_with_defaults(name):
    signal = make_signal(name, **NEEDED.get(name, {}))
    assert type(signal) is SIGNALS[name]
    assert signal.name == name
    assert np.isfinite(signal(np.linspace(0.0, 1.0, 11))).all()


@settings(deadline=None)
@given(st.sampled_from(sorted(SIGNALS)), REAL, st.floats(-1e6, 1e6), REAL)
def test_a_signal_is_the_same_after_a_round_trip_through_json(name, amplitude, offset, start):
    signal = make_signal(
        name,
        amplitude_um=amplitude,
        offset_um=offset,
        smooth_start_s=start,
        **NEEDED.get(name, {}),
    )
    document = json.loads(json.dumps(signal.to_dict(), allow_nan=False))
    assert document["signal"] == name
    again = signal_from_dict(document)
    assert again == signal
    assert again.to_dict() == signal.to_dict()


def test_numbers_of_numpy_become_plain_ones():
    signal = make_signal(
        "multisine", amplitude_um=np.float32(2.0), lines=np.int64(5), odd=np.bool_(True), seed=1
    )
    steps = make_signal("steps", levels=np.array([0, 1]), hold_s=1)
    assert json.loads(json.dumps(signal.to_dict()))["lines"] == 5
    assert json.loads(json.dumps(steps.to_dict()))["levels"] == [0.0, 1.0]
    assert signal.to_dict()["odd"] is True


def test_parts_may_be_given_as_documents():
    parts = [{"signal": "sine", "frequency_hz": 2.0}, Sine(frequency_hz=3.0)]
    assert make_signal("sum", parts=parts) == Sum(
        parts=(Sine(frequency_hz=2.0), Sine(frequency_hz=3.0))
    )


def test_a_signal_of_ones_own_needs_no_registry():
    class Ramp(Signal):
        name = "ramp"

        def _shape(self, t):
            return t

        def _shape_rate(self, t):
            return np.ones_like(t)

    ramp = Ramp(amplitude_um=2.0, smooth_start_s=1.0)
    assert ramp(3.0) == 6.0
    assert ramp.derivative(3.0) == 2.0
    assert replace(ramp, amplitude_um=1.0)(3.0) == 3.0


NAN, INF = float("nan"), float("inf")
BAD_FIELDS = [
    ("sine", {"frequency_hz": 0.0}, "frequency_hz is 0.0; give a finite number above 0"),
    ("sine", {"frequency_hz": -1}, "frequency_hz is -1; give a finite number above 0"),
    ("triangle", {"frequency_hz": NAN}, "frequency_hz is nan"),
    ("sine", {"frequency_hz": INF}, "frequency_hz is inf"),
    ("sine", {"frequency_hz": "fast"}, "frequency_hz is 'fast'"),
    ("sine", {"frequency_hz": True}, "frequency_hz is True"),
    ("sine", {"frequency_hz": None}, "frequency_hz is None"),
    ("sine", {"amplitude_um": -1.0}, "amplitude_um is -1.0; give a finite number at least 0"),
    ("sine", {"amplitude_um": INF}, "amplitude_um is inf"),
    ("noise", {"offset_um": NAN}, "offset_um is nan; give a finite number"),
    ("chirp", {"smooth_start_s": -0.1}, "smooth_start_s is -0.1"),
    ("chirp", {"duration_s": 0.0}, "duration_s is 0.0"),
    ("chirp", {"sweep": "cubic"}, "sweep is 'cubic'; give 'linear' or 'logarithmic'"),
    ("decaying-sine", {"decay_s": 0.0}, "decay_s is 0.0"),
    ("sawtooth", {"flyback_fraction": 1.0}, "flyback_fraction is 1.0"),
    ("steps", {"levels": []}, "levels is []; give a flat list of at least 1 finite numbers"),
    ("steps", {"levels": [[1.0]]}, "levels is"),
    ("steps", {"levels": [0.0, NAN]}, "levels is"),
    ("steps", {"levels": "high"}, "levels is 'high'"),
    ("steps", {"hold_s": 0.0}, "hold_s is 0.0"),
    ("steps", {"hold_s": 0.1, "rise_s": 0.2}, "rise_s is 0.2; give at most the time of one hold"),
    ("random-steps", {"count": 0}, "count is 0; give a whole number of at least 1"),
    ("random-steps", {"seed": -1}, "seed is -1; give a whole number of at least 0"),
    ("random-steps", {"seed": 1.5}, "seed is 1.5"),
    ("raster", {"trace_fraction": 1.0}, "trace_fraction is 1.0"),
    ("raster", {"trace_fraction": 0.9, "turnaround_fraction": 0.2}, "turnaround_fraction is 0.2"),
    ("raster-slow-ramp", {"lines": 1}, "lines is 1; give a whole number of at least 2"),
    ("raster-slow-stairs", {"frequency_hz": 0.0}, "frequency_hz is 0.0"),
    ("nested-loops", {"turning_points": [1.0]}, "turning_points is"),
    ("nested-loops", {"turning_points": [1.0, 0.5, 1.0]}, "differ from the one before"),
    ("multisine", {"lines": 0}, "lines is 0"),
    ("multisine", {"lines": 10**6}, "at most 5000"),
    ("noise", {"low_hz": 30.0, "high_hz": 20.0}, "0 lines"),
    ("noise", {"high_hz": 1e4}, "100000 lines"),
    ("wiener", {"duration_s": 0.001}, "holds 0 intervals"),
    ("laplace", {"interval_s": 1e-9}, "choose them for 1 to 10000000"),
    ("wiener", {"spread_s": 0.0}, "spread_s is 0.0"),
    ("sum", {"parts": []}, "parts is []; give a list of one or more signals"),
    ("sum", {"parts": 3}, "parts is 3"),
    ("sum", {"parts": [3]}, "parts is [3]"),
    ("sum", {"parts": [{"frequency_hz": 1.0}]}, 'its name under "signal"'),
    ("sequence", {"parts": [Sine()], "durations_s": [1.0, 2.0]}, "1 parts and 2 durations_s"),
    ("sequence", {"parts": [Sine()], "durations_s": [0.0]}, "durations above 0 s"),
    ("measured", {"times_s": [0.0, 1.0], "values_um": [0.0] * 3}, "2 times_s and 3 values_um"),
    ("measured", {"times_s": [0.0, 1.0, 1.0], "values_um": [0.0] * 3}, "at sample 2"),
    ("measured", {"times_s": [0.0], "values_um": [0.0]}, "times_s is"),
    ("sum", {}, "the field parts is missing"),
    ("sine", {"freqency_hz": 1.0}, "unknown field 'freqency_hz'; did you mean 'frequency_hz'?"),
    ("sine", {"xyz": 1.0}, "unknown field 'xyz'. Its fields are amplitude_um,"),
    ("sin", {}, "unknown signal 'sin'; did you mean 'sine'?"),
    ("Nested_Loops", {}, "did you mean 'nested-loops'?"),
    ("qqq", {}, "unknown signal 'qqq'. The signals are chirp, constant,"),
]


@over("name, fields, message", BAD_FIELDS)
def test_bad_input_is_answered_with_one_line(name, fields, message):
    with pytest.raises(InputError) as caught:
        make_signal(name, **fields)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@over("document", [None, [], "sine", {}, {"signal": 3}])
def test_a_document_that_is_no_signal_is_refused(document):
    with pytest.raises(InputError, match='its name under "signal"'):
        signal_from_dict(document)


@over("loops", [0, -2])
def test_reversal_curves_need_a_loop(loops):
    with pytest.raises(InputError, match="give 1 loop or more"):
        first_order_reversals(loops)


def write(folder: Path, text: str) -> Path:
    path = folder / "record.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_record_is_read_from_a_file(tmp_path):
    path = write(tmp_path, "\ufeff# bench\nt, u, y\n5.0,1,0\n5.5,2,1e1\n% pause\n6.0,3,20\n\n")
    record = Measured.from_file(path, "y", smooth_start_s=0.1, amplitude_um=0.5)
    assert record.times_s == (0.0, 0.5, 1.0)
    assert record.values_um == (0.0, 10.0, 20.0)
    assert record([0.75, 9.0]) == pytest.approx([7.5, 10.0])
    skipped = Measured.from_file(path, "y", skip_s=0.5)
    assert skipped.times_s == (0.0, 0.5)
    assert skipped.values_um == (10.0, 20.0)
    assert signal_from_dict(json.loads(json.dumps(record.to_dict()))) == record


@over(
    "text, message",
    [
        ("", "has no column 't'"),
        ("t,displacement\n0,1\n1,2\n", "has no column 'y'"),
        ("t,Y\n0,1\n", "its header has t, Y"),
        ("t,y\n0,1\n", "fewer than two samples"),
        ("t,y\n0,1\n1,two\n", "line 3, column 'y': 'two' is no finite number"),
        ("t,y\n0,1\n1\n2,3\n", "line 3, column 'y': '' is no finite number"),
        ("t,y\n0,1\n1,nan\n", "line 3, column 'y': 'nan' is no finite number"),
        ("# a\nt,y\n0,1\n2,2\n1,3\n", "line 5, column 't': 1 s follows 2 s"),
        ("t,y\n0,1\n1,2\n", "leaves fewer than two of 2 samples"),
    ],
)
def test_a_bad_record_is_refused_naming_file_and_place(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        Measured.from_file(path, "y", skip_s=0.5)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_record_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        Measured.from_file(tmp_path / "absent.csv", "y")
    (tmp_path / "latin.csv").write_bytes("t,y (µm)\n0,1\n".encode("latin-1"))
    with pytest.raises(InputError, match="cannot be read"):
        Measured.from_file(tmp_path / "latin.csv", "y")


def test_the_measured_reference_of_the_picma_record(tmp_path):
    (record,) = load(example_folder("picma"), DataOptions(skip_s=0.0)).validation
    write_csv(record, tmp_path / "validation.csv")
    reference = Measured.from_file(tmp_path / "validation.csv", skip_s=1.0)
    t = np.arange(0.0, 30.0, 5e-3)
    assert np.ptp(reference(t)) == pytest.approx(45.0, abs=10.0)
    assert Sequence(parts=[reference], durations_s=[30.0])(35.0) == pytest.approx(reference(5.0))


def test_parts_in_parts_without_end_are_refused() -> None:
    document = {"signal": "sine"}
    for _ in range(20):
        document = {"signal": "sum", "parts": [document]}
    assert signal_from_dict(document).parts
    for _ in range(5000):
        document = {"signal": "sum", "parts": [document]}
    with pytest.raises(InputError, match="parts have parts more than 20 times over"):
        signal_from_dict(document)


def test_a_field_that_is_named_name() -> None:
    with pytest.raises(InputError, match="unknown field 'name'"):
        signal_from_dict({"signal": "sine", "name": "sine"})


def test_numbers_whose_product_no_float_holds() -> None:
    with pytest.raises(InputError, match="noise: inf lines"):
        make_signal("noise", high_hz=1e308, repeat_s=100.0)
