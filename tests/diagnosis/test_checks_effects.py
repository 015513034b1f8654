"""Each test without a model finds its effect in the standard protocol, and nothing else does."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.checks import run_checks
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.signals.experiments import standard_protocol
from tests.looping import over

NOISE_UM = 0.012

# effect: parameters, the checks that find it, what the first of them measures
CASES = {
    "saturation": ((100.0, 0.0), ("saturation", "congruency"), None),
    "slew_limit": ((6e3,), ("rate law",), None),
    "rate_law": ((0.6, 1e4), ("rate law",), 0.6),
    "actuator_lag": ((2e-4,), ("lag at small signals",), 200.0),
    "sensor_lag": ((1e-4,), ("lag at small signals",), 100.0),
    "delay": ((1.3e-4,), ("lag at small signals",), 130.0),
    "resonance": ((900.0, 0.03), ("resonance at small signals",), None),
    "backlash": ((0.1,), ("motion at small signals",), None),
    "asymmetry": ((0.02, 40.0), ("asymmetry",), None),
    "congruency": ((0.1, 40.0), ("congruency",), None),
    "creep": ((0.015,), ("creep",), 1.5),
    "gain_drift": ((1e-4,), ("gain drift in holds", "gain drift between repeats"), 0.6),
    "thermal_drift": ((5e-3, 200.0), ("drift in holds", "drift between repeats"), None),
    "mains_hum": ((0.02, 50.0, 1.0), ("mains hum",), 0.02),
    "initial_memory": ((20.0,), ("initial memory",), None),
}


def measured(effects=(), seed=0, halve=False):
    """Simulate the standard protocol on P10 with effects, an offset and noise."""
    rng = np.random.default_rng(seed)
    records, start_s = [], 0.0
    for experiment in standard_protocol(0.0, 40.0, 1.0):
        taken = replace(experiment, ts_s=experiment.ts_s / 2) if halve else experiment
        u = taken.command_V()
        record = Record(taken.name, start_s + taken.times_s(), u, u, taken.ts_s, role=taken.role)
        y = simulate_effects([Variant(P10.hysteresis, tuple(effects))], record)[:, 0]
        noise = NOISE_UM * rng.standard_normal(u.size)
        records.append(replace(record, y_um=y + noise - 7.0))
        start_s += taken.duration_s + 1.0
    return Dataset("simulated", tuple(records))


def found(dataset):
    return {check.name for check in run_checks(dataset) if check.zone == "yes"}


@pytest.fixture(scope="module")
def bare():
    return measured()


def test_bare_plant_leaves_every_test_silent(bare):
    assert found(bare) == set()


@over("name", CASES)
def test_effect_is_found_and_named(name):
    values, expected, size = CASES[name]
    checks = {check.name: check for check in run_checks(measured([CATALOGUE[name](*values)]))}
    for check in expected:
        assert checks[check].zone == "yes", checks[check].sentence
        assert name in checks[check].suggests
    if size is not None:
        assert checks[expected[0]].value == pytest.approx(size, rel=0.08)
    others = {c.name for c in checks.values() if c.zone == "yes" and name not in c.suggests}
    assert others == set()


# Where the sampling, the sign of y, the units of y and the order of records change, what is found
# stays; the effects are one of each kind of test.
CHANGES = {
    "sign": lambda d: change_y(d, -1.0),
    "units": lambda d: change_y(d, 1e3),
    "order": lambda d: Dataset(d.title, tuple(reversed(d.records))),
}


def change_y(dataset, factor):
    return Dataset("changed", tuple(replace(r, y_um=factor * r.y_um) for r in dataset.records))


@over("change", CHANGES)
def test_what_is_found_depends_on_no_convention(change):
    effects = [CATALOGUE[n](*CASES[n][0]) for n in ("rate_law", "asymmetry", "creep", "delay")]
    plain = run_checks(measured(effects))
    turned = run_checks(CHANGES[change](measured(effects)))
    assert [c.zone for c in turned] == [c.zone for c in plain]
    assert {"rate law", "asymmetry", "creep", "lag at small signals"} <= {
        c.name for c in plain if c.zone == "yes"
    }


def test_half_the_sampling_time_finds_the_same():
    effects = [CATALOGUE[n](*CASES[n][0]) for n in ("saturation", "creep")]
    for halve in (False, True):
        assert found(measured(effects, halve=halve)) == {"saturation", "congruency", "creep"}


@over(
    "name, values, kind",
    [
        ("delay", (1.3e-4,), ("delay",)),
        ("sensor_lag", (1.3e-4,), ("sensor_lag", "actuator_lag")),
        ("resonance", (700.0, 0.3), ("resonance",)),
        # half a sample: the mean of two samples is late and soft, like a lag
        ("delay", (2.5e-5,), ("delay", "sensor_lag", "actuator_lag")),
    ],
)
def test_kappa_tells_the_kind_of_a_lag(name, values, kind):
    # κ = g1² - 2 g2 is 0 for a delay, below 0 for a lag, above 0 for a resonance
    checks = {c.name: c for c in run_checks(measured([CATALOGUE[name](*values)]))}
    lag = checks["lag at small signals"]
    assert lag.zone == "yes"
    assert lag.suggests == kind


def test_motion_lost_in_a_wide_gap_is_seen():
    checks = {c.name: c for c in run_checks(measured([CATALOGUE["backlash"](1.0)]))}
    motion = checks["motion at small signals"]
    assert motion.zone == "yes"
    assert "does not follow the command at all" in motion.sentence


def test_creep_and_drift_are_told_apart_in_one_experiment():
    # creep follows the last step, drift does not: 1 % a decade, 0.005 µm/s
    effects = [CATALOGUE["creep"](0.01), CATALOGUE["thermal_drift"](5e-3, 1e5)]
    checks = {c.name: c for c in run_checks(measured(effects))}
    assert checks["creep"].value == pytest.approx(1.0, rel=0.1)
    stroke_um = np.ptp(measured().records[0].y_um)
    assert checks["drift in holds"].value == pytest.approx(100 * 5e-3 * 60 / stroke_um, rel=0.1)
