"""Records as they come: each command gives a result or one line, whatever the command did."""

import warnings

import numpy as np

from rdpi_gym.cli import main
from rdpi_gym.measurement import Record, write_csv
from rdpi_gym.plant import P5, Plant

TS_S = 1e-3
N = 700
K = np.arange(N)
MIXED = sum(
    a * np.sin(2 * np.pi * f * K * TS_S + f) for a, f in ((15.0, 6.0), (10.0, 17.0), (5.0, 40.0))
)
COMMANDS = {
    "fit": ["fit", "DATA", "-n", "3"],
    "compare": ["compare", "DATA", "--model", "P5"],
    "diagnose": ["diagnose", "DATA", "--model", "P5", "--jobs", "1", "--verbose"],
    "add": ["add", "creep", "DATA", "--model", "P5", "--jobs", "1"],
    "discover": ["discover", "DATA", "--jobs", "1", "--verbose"],
}


def spike(*places):
    u = np.zeros(N)
    u[list(places)] = 10.0
    return u


VOLTAGES = {
    "one step": np.where(K > 250, 20.0, 0.0),
    "one spike": spike(300),
    "alternating": np.where(K % 2, 10.0, -10.0),
    "spikes": spike(150, 350, 550),
    "last sample only": spike(N - 1),
    "step train": 10.0 * (K // 60 % 2),
    "pulse": np.where((K > 200) & (K < 400), 10.0, 0.0),
    "ramp": np.linspace(0.0, 30.0, N),
    "two levels": 10.0 * (np.cumsum(np.random.default_rng(0).random(N) < 0.05) % 2),
    "long rest": np.where(K < 150, MIXED, MIXED[150]),
    "two samples a period": 10.0 * np.cos(np.pi * K),
    "far from zero": MIXED + 1e6,
    "twenty samples": MIXED[:20],
}
DISPLACEMENTS = {
    "unplugged": lambda y: np.full(N, 3.0),
    "saturated": lambda y: np.clip(y, -8.0, 8.0),
    "quantised": lambda y: np.round(y / 20.0) * 20.0,
    "huge offset": lambda y: y + 1e9,
    "metres": lambda y: 1e-6 * y,
    "noise": lambda y: np.random.default_rng(1).standard_normal(N),
    "moves only where it is held out": lambda y: np.where(K < 600, 0.0, 5.0),
    "moves only where it is fitted": lambda y: np.where(K < 400, y, 5.0),
}


def measured(u):
    y = Plant(P5, TS_S).simulate(u)
    return y + 0.01 * np.random.default_rng(0).standard_normal(y.size)


def called(command, u, y, folder, capsys):
    """Exit status and what was printed on standard error; a result leaves no warning of Python's."""
    path = write_csv(Record("run", np.arange(u.size) * TS_S, u, y, ts_s=TS_S), folder / "run.csv")
    words = [str(path) if word == "DATA" else word for word in COMMANDS[command]]
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        status = main([*words, "--out", str(folder / "out")])
    printed = capsys.readouterr()
    if status == 0:
        assert printed.err == ""
        assert printed.out
    else:
        assert status == 2
        assert printed.err.count("\n") == 1
        assert 20 < len(printed.err) < 400
    return status, printed.out + printed.err


def test_every_command_answers_on_jumps(tmp_path_factory, capsys, subtests):
    for kind in ["one step", "one spike", "alternating"]:
        for command in COMMANDS:
            with subtests.test(kind=kind, command=command):
                tmp_path = tmp_path_factory.mktemp("case")
                u = VOLTAGES[kind]
                status, printed = called(command, u, measured(u), tmp_path, capsys)
                assert status == 0
                if command in ("diagnose", "discover"):
                    assert "One record, of which only a part is held out" in printed


def test_a_sensor_that_is_unplugged_is_named(tmp_path_factory, capsys, subtests):
    for command in ["fit", "diagnose", "add", "discover"]:
        with subtests.test(command=command):
            tmp_path = tmp_path_factory.mktemp("case")
            status, said = called(command, MIXED, np.full(N, 3.0), tmp_path, capsys)
            assert status == 2
            assert "the displacement never changes: it is 3 µm in run; check the sensor" in said


JUMPS = {"one step", "one spike", "alternating"}


def test_other_commands_of_the_amplifier(tmp_path_factory, capsys, subtests):
    for kind in sorted(VOLTAGES.keys() - JUMPS):
        with subtests.test(kind=kind):
            tmp_path = tmp_path_factory.mktemp("case")
            u = VOLTAGES[kind]
            called("fit", u, measured(u), tmp_path, capsys)


def test_other_readings_of_the_sensor(tmp_path_factory, capsys, subtests):
    for kind in DISPLACEMENTS:
        with subtests.test(kind=kind):
            tmp_path = tmp_path_factory.mktemp("case")
            called("fit", MIXED, DISPLACEMENTS[kind](measured(MIXED)), tmp_path, capsys)


def test_comparisons_with_such_readings(tmp_path_factory, capsys, subtests):
    for kind in ["quantised", "unplugged", "moves only where it is held out"]:
        with subtests.test(kind=kind):
            tmp_path = tmp_path_factory.mktemp("case")
            called("compare", MIXED, DISPLACEMENTS[kind](measured(MIXED)), tmp_path, capsys)


def test_searches_on_such_commands(tmp_path_factory, capsys, subtests):
    for kind in ["last sample only", "step train", "twenty samples"]:
        with subtests.test(kind=kind):
            tmp_path = tmp_path_factory.mktemp("case")
            u = VOLTAGES[kind]
            called("add", u, measured(u), tmp_path, capsys)


def test_searches_on_such_readings(tmp_path_factory, capsys, subtests):
    for kind in ["quantised", "moves only where it is fitted"]:
        with subtests.test(kind=kind):
            tmp_path = tmp_path_factory.mktemp("case")
            called("add", MIXED, DISPLACEMENTS[kind](measured(MIXED)), tmp_path, capsys)


def test_noise_for_a_displacement_decides_nothing(tmp_path, capsys):
    noise = np.random.default_rng(1).standard_normal(N)
    _, printed = called("discover", MIXED, noise, tmp_path, capsys)
    assert printed.startswith("Undecided. The displacement hardly follows the voltage (")


def test_metres_are_asked_for_their_unit(tmp_path, capsys):
    status, said = called("discover", MIXED, 1e-6 * measured(MIXED), tmp_path, capsys)
    assert status == 2
    assert "y in m? Then give --units y=m" in said
