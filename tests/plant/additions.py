"""Files that add an effect and a core to a copy of the checkout, as CONTRIBUTING.md asks for them."""

EFFECT = {
    "rdpi_gym/plant/effects/lever_ratio.py": '''"""Lever ratio: a lever whose ratio changes with its angle."""
from dataclasses import dataclass

from numba import njit

from rdpi_gym.plant.effects.base import Effect, Parameter


@njit
def bend_block(x, u, p, state, ts, y):
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] + p[0, b] * x[t, b] ** 3


@dataclass(frozen=True)
class Bend(Effect):
    """Cubic distortion of the displacement."""

    share: float = 0.01

    name = "lever_ratio"
    slot = "output"
    order = 5
    parameters = (Parameter("share", "1", 0.0, 0.5, (0.005, 0.02), "share at 10 µm", 0.0),)
    equation = "y = y_m (1 + s (y_m / 10 µm)²)"
    source = "A lever that turns by an angle."
    signature = "Third harmonics that grow with the stroke."
    experiment = "Sines of two amplitudes."
    mistaken_for = ()
    block = staticmethod(bend_block)

    def coefficients(self, ts_s, hysteresis):
        return [self.share / 100.0]

    def state_rows(self, ts_s):
        return 0
''',
    "baselines/inverses/lever_ratio.py": '''"""Bend undone by Newton's method."""
import numpy as np

from baselines.inverses.base import Inverse


class BendInverse(Inverse):
    """The root of x + c x³ = y."""

    effect = "lever_ratio"

    def __init__(self, effect, setting, ahead=0):
        super().__init__(effect, setting, ahead)
        self._cube = effect.coefficients(setting.ts_s, setting.hysteresis)[0]

    def run(self, y, state):
        x = y.copy()
        for _ in range(30):
            x -= (x + self._cube * x**3 - y) / (1.0 + 3.0 * self._cube * x**2)
        return np.ascontiguousarray(x)
''',
    "rdpi_gym/virtual_lab/independent/lever.py": '''"""A lever, independently of the plant's stages."""
from rdpi_gym.virtual_lab.independent.twin import Twin

TWINS = (Twin("lever_ratio", 16, 15, lambda grid, share: lambda x: x * (1.0 + share * (x / 10.0) ** 2)),)
''',
}
"""A lever whose ratio changes with its angle: the effect, its inverse, an independent formulation."""

CORE = {
    "rdpi_gym/plant/cores/bent.py": '''"""Bent: a slide that relaxes along the way, beside a line that is bent."""
import math
from dataclasses import dataclass, replace

from numba import njit

from rdpi_gym.plant.cores.families import LENGTHS, InnerVariable, check_gain, check_shape
from rdpi_gym.plant.parameters import Parameter


@njit
def bent_block(u, v, p, state, y):
    for b in range(u.shape[1]):
        z, last, limit = state[2, b], state[3, b], p[3, b]
        for t in range(u.shape[0]):
            change = u[t, b] - last
            end = math.copysign(limit, change)
            z = end + (z - end) * math.exp(-abs(change) / limit)
            last = u[t, b]
            bent = limit * math.tanh(last / limit)
            y[t, b] = p[0, b] * last + p[1, b] * z + p[2, b] * bent + p[5, b]
        state[2, b], state[3, b] = z, last


@dataclass(frozen=True)
class Bent(InnerVariable):
    """y = a u + d z + q L tanh(u / L), z relaxes to L or -L along the way."""

    slope: float
    slide: float
    bend: float
    length_V: float
    rate_bandwidth_hz: float | None = None

    name = "bent"
    block = staticmethod(bent_block)
    title = "relaxing slide beside a bent line"
    equation = "y = a u + d z + q L tanh(u / L), z' = u' (1 - z sgn(u') / L)"
    source = "Written by a test of this project."
    signature = "Loops that turn clockwise about a line that is bent."
    experiment = "Triangles of several sizes about rest."
    hardware = "None."
    shape = (Parameter("length_V", "V", 1e-9, 1e9, (1.0, 30.0), "length L"),)
    clockwise = True

    def __post_init__(self):
        for name in ("slope", "slide", "bend"):
            check_gain(name, getattr(self, name))
        check_shape(self)

    @property
    def a0(self):
        return self.slope + self.slide

    @property
    def A(self):
        return self.slope + 2.0 * self.slide + self.bend

    @property
    def gains(self):
        return self.slope, self.slide, self.bend

    @property
    def signed(self):
        return False, False, False

    @property
    def reach_V(self):
        return -self.length_V, self.length_V

    def with_gains(self, gains):
        slope, slide, bend = (max(float(gain), 0.0) for gain in gains)
        return replace(self, slope=max(slope, 1e-9), slide=slide, bend=bend)

    @classmethod
    def starts(cls, scale):
        gain = scale.stroke_um / scale.span_V
        return tuple(cls(gain, gain, 0.1 * gain, k * scale.span_V) for k in LENGTHS)

    def coefficients(self):
        return [*self.gains, self.length_V]
'''
}
"""A slide that relaxes along the way, beside a bent line."""
