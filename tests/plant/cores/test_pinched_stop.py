"""The pinched stop: its loop by hand, an integration of its own, what it refuses, a friction damper."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import nnls

from rdpi_gym.measurement import load, measured_data
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.plant.cores.pinched_stop import PinchedStop
from rdpi_gym.plant.cores.stop import Stop
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from tests.plant.cores.integration import path, run

DAMPER = PinchedStop(weights=(4.0, 1.0, 0.0, 0.5, 3.0), threshold_V=5.0, slope=-0.02)


def test_it_is_an_independent_integration_of_a_slider_and_a_spring() -> None:
    corners = np.concatenate([[0.0], np.random.default_rng(3).uniform(-14.0, 14.0, 16)])
    u, r = path(corners), DAMPER.threshold_V
    stiffness, edge = np.array(DAMPER.weights), 2.0 * r / len(DAMPER.weights)
    state, y = np.zeros(2), [0.0]

    for a, b in pairwise(corners):
        rate = b - a

        def moves(t: float, z: Array, rate: float = rate) -> list[float]:
            slips = abs(z[0]) >= r and z[0] * rate > 0.0
            k = min(max(int((z[0] + r) // edge), 0), len(stiffness) - 1)
            return [0.0, 0.0] if slips else [rate, stiffness[k] * rate]

        leg = solve_ivp(
            moves, (0.0, 1.0), state, t_eval=np.linspace(0.0, 1.0, 40)[1:],
            max_step=0.05, rtol=1e-9, atol=1e-9,
        )  # fmt: skip
        y += leg.y[1].tolist()
        state = leg.y[:, -1]
    whole = DAMPER.slope * u + np.array(y)
    np.testing.assert_allclose(run(DAMPER, u), whole, atol=1e-6 * np.ptp(whole))


def test_after_a_turn_it_falls_to_the_gap_rests_there_and_slips_at_last() -> None:
    core = PinchedStop((4.0, 0.0, 3.0), 1.5)
    y = run(core, np.array([2.0, 1.5, 1.0, 0.5, 0.0, -0.5, -1.0, -9.0, -8.5]))
    np.testing.assert_allclose(y, [3.0, 1.5, 0.0, 0.0, 0.0, -2.0, -4.0, -4.0, -2.0], atol=1e-12)


def test_with_one_stiffness_it_is_a_stop() -> None:
    u = path(np.random.default_rng(2).uniform(-14.0, 14.0, 30))
    np.testing.assert_allclose(
        run(PinchedStop((0.7,) * 6, 3.0, 0.1), u), run(Stop((0.7,), (3.0,), 0.1), u), atol=1e-12
    )


def test_gains_that_leave_no_stiffness_at_a_turn_are_moved_until_there_is_one() -> None:
    soft = DAMPER.with_gains([-10.0, 0.0, 1.0, 2.0, -1.0, 5.0])
    assert soft.weights[1:] == (1.0, 2.0, 0.0, 5.0)
    assert soft.a0 > 0.0
    assert DAMPER.with_gains([0.0] * 6).a0 > 0.0


FOLDER = measured_data("friction_damper")


@pytest.mark.skipif(FOLDER is None, reason="friction_damper is not there (set RDPI_DATA)")
def test_a_friction_damper_is_explained_where_plain_stops_are_not() -> None:
    data = load(FOLDER)

    def held_out(core: PinchedStop | Stop) -> tuple[float, list[float]]:
        """Squared error on the records that are fitted to; per cent of peak to peak on the others, less a constant."""

        def columns(u: Array) -> Array:
            x = core.responses(u, u, np.zeros(core.n))
            return np.column_stack([x, -x[:, 0], np.ones(len(u)), -np.ones(len(u))])

        x = np.vstack([columns(record.u_V) for record in data.train])
        y = np.concatenate([record.y_um for record in data.train])
        q, r = np.linalg.qr(x)
        gains, _ = nnls(r, q.T @ y)
        left = float(np.sum((y - x @ gains) ** 2))
        judged = [(record.y_um, columns(record.u_V) @ gains) for record in data.validation]
        return left, [100.0 * float(np.std(f - g) / np.ptp(f)) for f, g in judged]

    springs = [held_out(PinchedStop((1.0,) * 12, r)) for r in np.arange(3.5, 6.1, 0.25)]
    _, pinched = min(springs)
    _, plain = held_out(Stop.starts(DataScale(0.0, 38.3, 20.0, 250.0, 1 / 256, 28.0))[0])
    assert max(pinched) < 5.0 < min(plain)


def test_lanes_with_unlike_sections_are_refused() -> None:
    models = [
        PlantModel(PinchedStop((1.0,) * k, 3.0), "demo", (-30.0, 30.0), (0.0, 8.0)) for k in (4, 6)
    ]
    with pytest.raises(InputError, match=r"lanes with \[5, 7\] gains; all lanes of one plant"):
        Plant(models, 1e-3)  # type: ignore[arg-type]
