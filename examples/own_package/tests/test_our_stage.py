"""Our effect and our controller do what they say."""

import numpy as np
import pytest
from our_stage.lead import SAMPLES, Lead
from our_stage.self_heating import SelfHeating

from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import P5


def test_a_ramp_warms_by_the_square_of_its_rate():
    ts_s = 1e-3
    ramp = [500.0 * k * ts_s for k in range(10_001)]  # ten time constants at 500 V/s
    warmed = SelfHeating(rise_um=0.2, time_constant_s=1.0).run([0.0] * len(ramp), ts_s, u=ramp)
    assert warmed[-1] == pytest.approx(0.2 * 0.5**2, rel=1e-3)


def test_the_reference_is_read_ahead():
    layout = ObservationLayout.for_plant(P5, ts_s=1e-3, preview=4)
    observation = np.zeros((1, layout.size), dtype=np.float32)
    observation[0, SAMPLES] = 0.5  # the reference so many samples ahead
    action, _ = Lead(P5, layout).predict(observation)
    wanted_um = layout.reference_um(observation)[0, SAMPLES]
    low_V, high_V = layout.command_range_V
    command_V = low_V + (float(np.ravel(action)[0]) + 1.0) / 2.0 * (high_V - low_V)
    assert command_V == pytest.approx(wanted_um / P5.hysteresis.A, rel=1e-5)
