"""Numbers that a core refuses, each in one line that a person can act on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.bouc_wen import AsymmetricBoucWen, BoucWen
from rdpi_gym.plant.cores.dahl import Dahl
from rdpi_gym.plant.cores.duhem import Duhem
from rdpi_gym.plant.cores.generalised import GeneralisedPI
from rdpi_gym.plant.cores.lugre import LuGre
from rdpi_gym.plant.cores.pinched_stop import PinchedStop
from rdpi_gym.plant.cores.preisach import Preisach
from rdpi_gym.plant.cores.rdpi import RDPI
from rdpi_gym.plant.cores.stop import Stop
from rdpi_gym.support.errors import InputError
from tests.looping import over

INF, NAN = float("inf"), float("nan")
REFUSED: list[tuple[Core, dict[str, Any], str]] = [
    # stop
    (Stop((1.0, 0.5), (1.0, 2.0)), {"weights": (1.0, -0.1)}, r"weight a_2 is -0.1; weights are finite and not negative"),
    (Stop((1.0, 0.5), (1.0, 2.0)), {"weights": (1.0, INF)}, r"weight a_2 is inf"),
    (Stop((1.0, 0.5), (1.0, 2.0)), {"weights": ()}, r"weights is empty"),
    (Stop((1.0, 0.5), (1.0, 2.0)), {"weights": ("a", 1.0)}, r"weights is \('a', 1.0\); give a list of numbers"),
    (Stop((1.0, 0.5), (1.0, 2.0)), {"weights": (1.0,)}, r"2 thresholds for 1 stop weights"),
    (Stop((1.0, 0.5), (1.0, 2.0)), {"thresholds_V": (2.0, 2.0)}, r"threshold r_2 is 2.0 V after 2.0 V; thresholds increase"),
    (Stop((1.0, 0.5), (1.0, 2.0)), {"thresholds_V": (0.0, 2.0)}, r"threshold r_1 is 0.0 V after 0.0 V"),
    (Stop((1.0, 0.5), (1.0, 2.0)), {"thresholds_V": (1.0, NAN)}, r"threshold r_2 is nan V"),
    (Stop((1.0, 0.5), (1.0, 2.0)), {"slope": NAN}, r"slope is nan; c is a finite gain"),
    (Stop((1.0, 0.5), (1.0, 2.0)), {"slope": -1.5}, r"the gain right after a turn, .* is 0.0; it is above 0"),
    (Stop((1.0, 0.5), (1.0, 2.0)), {"rate_bandwidth_hz": 0.0}, r"rate_bandwidth_hz is 0.0; give a frequency above 0 Hz"),
    # pinched_stop
    (PinchedStop((1.0, 0.0, 2.0), 1.0), {"weights": (1.0, -0.1)}, r"weight a_2 is -0.1; weights are finite and not negative"),
    (PinchedStop((1.0, 0.0, 2.0), 1.0), {"weights": ()}, r"weights is empty"),
    (PinchedStop((1.0, 0.0, 2.0), 1.0), {"weights": None}, r"weights is None; give a list of numbers"),
    (PinchedStop((1.0, 0.0, 2.0), 1.0), {"weights": (0.0, 1.0)}, r"the gain right after a turn, .* is 0.0; it is above 0"),
    (PinchedStop((1.0, 0.0, 2.0), 1.0), {"slope": -1.0}, r"the gain right after a turn, .* is 0.0; it is above 0"),
    (PinchedStop((1.0, 0.0, 2.0), 1.0), {"slope": INF}, r"slope is inf; c is a finite gain"),
    (PinchedStop((1.0, 0.0, 2.0), 1.0), {"threshold_V": 0.0}, r"threshold_V is 0.0; give a number from 1e-09 to 1e\+09 V"),
    (PinchedStop((1.0, 0.0, 2.0), 1.0), {"threshold_V": None}, r"threshold_V is None; give a number"),
    (PinchedStop((1.0, 0.0, 2.0), 1.0), {"rate_bandwidth_hz": 0.0}, r"rate_bandwidth_hz is 0.0; give a frequency above 0 Hz"),
    # generalised
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"weights": (0.0, 1.0)}, r"a_0 is 0.0; the model needs a finite a_0 above 0"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"weights": ()}, r"a_0 is missing"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"weights": (1.0, -1.0)}, r"weight a_1 is -1.0; weights are finite and not negative"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"weights": (1.0, NAN)}, r"weight a_1 is nan"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"weights": 3.0}, r"weights is 3.0; give a list of numbers"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"thresholds_V": (1.0, 2.0)}, r"2 thresholds for 1 play weights"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"thresholds_V": (-1.0,)}, r"threshold r_1 is -1.0 V after 0.0 V; thresholds increase"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"rising_per_V": -0.1}, r"rising_per_V is -0.1; give a number from 0 to 1000 1/V"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"falling_per_V": 2e3}, r"falling_per_V is 2000.0; give a number from 0 to 1000 1/V"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"falling_centre_V": "x"}, r"falling_centre_V is 'x'; give a number"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"rising_centre_V": INF}, r"rising_centre_V is inf; give a number"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"falling_gain": 0.0}, r"falling_gain is 0.0; give a number from 0.05 to 20"),
    (GeneralisedPI((1.0, 0.5), (1.0,)), {"rate_bandwidth_hz": -1.0}, r"rate_bandwidth_hz is -1.0; give a frequency above 0 Hz"),
    # preisach
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"reversible_um_V": -0.1}, "reversible_um_V is -0.1; c is finite and not negative"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"reversible_um_V": NAN}, "reversible_um_V is nan"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"levels_V": (5.0,)}, "levels_V has 1; give two levels"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"levels_V": (5.0, 5.0)}, "level 2 is 5.0 V after 5.0 V; levels are finite and increase"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"levels_V": (5.0, 0.0)}, "level 2 is 0.0 V after 5.0 V"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"levels_V": (0.0, INF)}, "level 2 is inf V"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"levels_V": (NAN, 1.0)}, "level 1 is nan V; levels"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"levels_V": (0.0, 5.0, 11.0)}, "level 2 is 5.0 V; evenly spaced from 0.0 to 11.0 V it is 5.5 V"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"levels_V": "ab"}, "levels_V is 'ab'; give a list of numbers"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"levels_V": 3.0}, "levels_V is 3.0; give a list of numbers"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"ramp_V": 0.0}, "ramp_V is 0.0; give a width above 0 V"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"ramp_V": 5.1}, "ramp_V is 5.1; give .* at most the distance of two levels, 5 V"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"ramp_V": None}, "ramp_V is None"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"weights_um": (1.0, 1.0)}, "2 weights for 2 levels; give one for each of the 3 relays"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"weights_um": (1.0, -2.0, 1.0)}, "the weight at α = 5 V, β = 0 V is -2.0; weights are finite"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"weights_um": (1.0, 1.0, NAN)}, "the weight at α = 5 V, β = 5 V is nan"),
    (Preisach(0.1, (0.0, 5.0), 5.0, (1.0,) * 3), {"rate_bandwidth_hz": 0.0}, "rate_bandwidth_hz is 0.0"),
    # dahl
    (Dahl(1.0, 2.0, 1.0), {"s": 0.0}, "s is 0.0; give a stiffness above 0"),
    (Dahl(1.0, 2.0, 1.0), {"s": -2.0}, "s is -2.0; give a finite gain that is not negative"),
    (Dahl(1.0, 2.0, 1.0), {"limit_V": INF}, "limit_V is inf; give a number from 1e-09 to 1e\\+09 V"),
    (Dahl(1.0, 2.0, 1.0), {"exponent": -0.1}, "exponent is -0.1; give a number from 0 to 4$"),
    (Dahl(1.0, 2.0, 1.0), {"rate_bandwidth_hz": -1.0}, "rate_bandwidth_hz is -1.0"),
    # duhem
    (Duhem(1.0, 0.7, 2.0), {"b": -1.0}, "b is -1.0; give a finite gain that is not negative"),
    (Duhem(1.0, 0.7, 2.0), {"c": NAN}, "c is nan; give a finite gain"),
    (Duhem(1.0, 0.7, 2.0), {"c": 0.4}, "c is 0.4 with b 1.0; give a c above 0 and at least b / 2, or"),
    (Duhem(1.0, 0.7, 2.0), {"b": 0.0, "c": 0.0}, "c is 0.0 with b 0.0; give a c above 0"),
    (Duhem(1.0, 0.7, 2.0), {"length_V": -1.0}, "length_V is -1.0; give a number from 1e-09 to 1e\\+09 V"),
    (Duhem(1.0, 0.7, 2.0), {"rate_bandwidth_hz": NAN}, "rate_bandwidth_hz is nan"),
    # lugre
    (LuGre(8.0, 0.02, 0.01, coulomb_V=0.4, static_ratio=1.6, stribeck_V_s=30.0), {"s0": 0.0}, "s0 is 0.0; give a stiffness above 0"),
    (LuGre(8.0, 0.02, 0.01, coulomb_V=0.4, static_ratio=1.6, stribeck_V_s=30.0), {"s1_s": -0.1}, "s1_s is -0.1; give a finite gain that is not negative"),
    (LuGre(8.0, 0.02, 0.01, coulomb_V=0.4, static_ratio=1.6, stribeck_V_s=30.0), {"s2_s": INF}, "s2_s is inf; give a finite gain"),
    (LuGre(8.0, 0.02, 0.01, coulomb_V=0.4, static_ratio=1.6, stribeck_V_s=30.0), {"coulomb_V": 0.0}, "coulomb_V is 0.0; give a number from 1e-09 to 1e\\+09 V"),
    (LuGre(8.0, 0.02, 0.01, coulomb_V=0.4, static_ratio=1.6, stribeck_V_s=30.0), {"static_ratio": 0.9}, "static_ratio is 0.9; give a number from 1 to 10$"),
    (LuGre(8.0, 0.02, 0.01, coulomb_V=0.4, static_ratio=1.6, stribeck_V_s=30.0), {"stribeck_V_s": NAN}, "stribeck_V_s is nan; give a number from .* V/s"),
    (LuGre(8.0, 0.02, 0.01, coulomb_V=0.4, static_ratio=1.6, stribeck_V_s=30.0), {"rate_bandwidth_hz": "fast"}, "rate_bandwidth_hz is 'fast'"),
    # bouc_wen
    (BoucWen(1.0, -0.3, 2.0, 0.7, 1.0), {"k": -1.0}, "k is -1.0; give a finite gain that is not negative"),
    (BoucWen(1.0, -0.3, 2.0, 0.7, 1.0), {"k": INF}, "k is inf; give a finite gain that is not negative"),
    (BoucWen(1.0, -0.3, 2.0, 0.7, 1.0), {"d": NAN}, "d is nan; give a finite gain"),
    (BoucWen(1.0, -0.3, 2.0, 0.7, 1.0), {"d": -0.8}, "d is -0.8 with k 1.0; give a d of at least -0.714286, or"),
    (BoucWen(1.0, -0.3, 2.0, 0.7, 1.0), {"k": 0.0, "d": 0.0}, "k \\+ d is 0.0; give a gain of small commands above 0"),
    (BoucWen(1.0, -0.3, 2.0, 0.7, 1.0), {"limit_V": 0.0}, "limit_V is 0.0; give a number from 1e-09 to 1e\\+09 V"),
    (BoucWen(1.0, -0.3, 2.0, 0.7, 1.0), {"sigma": 0.4}, "sigma is 0.4; give a number from 0.5 to 3$"),
    (BoucWen(1.0, -0.3, 2.0, 0.7, 1.0), {"exponent": 0.9}, "exponent is 0.9; give a number from 1 to 16$"),
    (BoucWen(1.0, -0.3, 2.0, 0.7, 1.0), {"exponent": "two"}, "exponent is 'two'; give a number"),
    (BoucWen(1.0, -0.3, 2.0, 0.7, 1.0), {"rate_bandwidth_hz": 0.0}, "rate_bandwidth_hz is 0.0"),
    # asymmetric_bouc_wen, rdpi
    (AsymmetricBoucWen(1.0, 0.1, 2.0), {"skew": 1.0}, r"skew is 1\.0; give a number from -0\.9 to 0\.9"),
    (RDPI((1.0, 1.0), (1.0,), 0.0), {"weights": (0.0, 1.0)}, "a_0 is 0.0"),
    (RDPI((1.0, 1.0), (1.0,), 0.0), {"weights": (-1.0, 1.0)}, "a_0 is -1.0"),
    (RDPI((1.0, 1.0), (1.0,), 0.0), {"weights": ()}, "a_0 is missing"),
    (RDPI((1.0, 1.0), (1.0,), 0.0), {"weights": (1.0, -0.1)}, "a_1 is -0.1"),
    (RDPI((1.0, 1.0), (1.0,), 0.0), {"weights": (1.0, NAN)}, "a_1 is nan"),
    (RDPI((1.0, 1.0), (1.0,), 0.0), {"weights": (1.0,) * 3, "thresholds_V": (2.0, 1.0)}, "r_2 is 1.0 V after 2.0 V"),
    (RDPI((1.0, 1.0), (1.0,), 0.0), {"thresholds_V": (0.0,)}, "r_1 is 0.0 V"),
    (RDPI((1.0, 1.0), (1.0,), 0.0), {"thresholds_V": (1.0, 2.0)}, "2 thresholds for 1 play weights"),
    (RDPI((1.0, 1.0), (1.0,), 0.0), {"delta2_s": -1e-4}, "delta2_s is -0.0001"),
    (RDPI((1.0, 1.0), (1.0,), 0.0), {"rate_bandwidth_hz": 0.0}, "rate_bandwidth_hz is 0.0"),
]  # fmt: skip
"""A core that is whole, what is changed, and what the refusal says (a pattern)."""


@over("core, changed, message", REFUSED)
def test_a_wrong_number_is_refused_in_one_line(core, changed, message):
    with pytest.raises(InputError, match=message) as error:
        replace(core, **changed)
    assert "\n" not in str(error.value)


def test_laws_of_the_literature_refuse_numbers_too():
    with pytest.raises(InputError, match=r"beta \+ gamma is 0\.0; give a sum above 0"):
        BoucWen.from_law(1.0, 1.0, 0.5, -0.5, 1.0)
    with pytest.raises(InputError, match="A is 0; give a number above 0"):
        BoucWen.from_law(1.0, 1.0, 0.5, 0.5, 1.0, A=0)
