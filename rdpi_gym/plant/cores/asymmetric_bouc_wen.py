"""The Bouc-Wen model with rising and falling branches that saturate at unlike heights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from rdpi_gym.plant.cores.bouc_wen import BoucWen
from rdpi_gym.plant.parameters import Parameter


@dataclass(frozen=True)
class AsymmetricBoucWen(BoucWen):
    """Bouc-Wen model with one term more: z' = u' (1 + φ sgn z) - β |u'| |z|^(n-1) z - γ u' |z|^n.

    Parameters
    ----------
    k, d, limit_V, sigma, exponent, rate_bandwidth_hz
        As of :class:`~rdpi_gym.plant.cores.bouc_wen.BoucWen`.
    skew
        φ: z saturates at zc (1 + φ)^(1/n) above zero, and at zc (1 - φ)^(1/n) below. Zero is the
        symmetric model.

    Raises
    ------
    InputError
        As of :class:`~rdpi_gym.plant.cores.bouc_wen.BoucWen`; the skew is beyond its bounds.

    Examples
    --------
    >>> AsymmetricBoucWen(k=0.0, d=1.0, limit_V=2.0, skew=0.25).settled((100.0,)).tolist()[:2]
    [2.5, 100.0]
    """

    skew: float = 0.0

    name = "asymmetric_bouc_wen"
    title = "asymmetric Bouc-Wen model"
    equation = "z' = u' (1 + φ sgn z) - β |u'| |z|^(n-1) z - γ u' |z|^n, y = k u + d z"
    source = (
        f"{BoucWen.source} A term for unlike branches: Zhu, Wang, Non-symmetrical Bouc-Wen model for "
        "piezoelectric ceramic actuators, Sens. Actuators A 181 (2012) 51, who write another one."
    )
    signature = (
        "Rising and falling branches that saturate at unlike heights about the middle of the loop; "
        "small loops do not close and drift along a staircase."
    )
    experiment = (
        "A wide loop about rest, for the heights of its branches; loops of one size at unlike bias."
    )
    shape = (
        *BoucWen.shape,
        Parameter("skew", "1", -0.9, 0.9, (-0.3, 0.3), "unlike saturation φ", neutral=0.0),
    )
    cases: ClassVar[Mapping[str, Mapping[str, float]]] = {
        name: {**numbers, "skew": 0.0} for name, numbers in BoucWen.cases.items()
    }

    @property
    def _slopes(self) -> tuple[float, float]:
        return 1.0 + self.skew, 1.0 - self.skew
