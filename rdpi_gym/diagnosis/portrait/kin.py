"""What an effect of the catalogue is like, read off its own response, and in what it differs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.rdpi import RDPI
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.support.arrays import Array

# What a response does while the command rests, as a share of it, is a memory from here on.
_MOVES = 0.05
# What the same wave leaves otherwise at a fifth of the rate, as a share of it, is of the rate.
_RATED, _SLOWER = 0.2, 5.0
_SAMPLES, _TURNS = 2_000, 3.0
_CORES = RDPI((1.0, 0.5), (0.2,), 1e-4), RDPI((0.7, 0.5), (0.2,), 1e-4)


@dataclass(frozen=True)
class Character:
    """What a portrait and an effect can be compared in.

    Parameters
    ----------
    place
        ``before``, ``in`` or ``behind`` the hysteresis.
    memory
        Whether it goes on while the command rests.
    parity
        ``even`` or ``odd``; ``both`` where it is as much of either.
    rated
        Without a memory: whether it is another at another rate.
    clocked
        Whether it goes by the clock.
    """

    place: str | None
    memory: bool | None
    parity: str | None
    rated: bool | None = None
    clocked: bool = False

    def differs(self, other: Character) -> str:
        """Say in what another one differs."""
        said = []
        if other.clocked and not self.clocked:
            said.append("goes by the clock")
        if None not in (self.place, other.place) and self.place != other.place:
            said.append(f"stands {other.place} the hysteresis")
        if None not in (self.memory, other.memory) and self.memory != other.memory:
            said.append("has a memory" if other.memory else "has no memory")
        if None not in (self.rated, other.rated) and self.rated != other.rated:
            said.append("goes by the rate" if other.rated else "does not go by the rate")
        if {self.parity, other.parity} == {"even", "odd"}:
            said.append(f"is {other.parity}")
        if not said:
            return "it differs in its form alone"
        *most, last = said
        return f"it {', '.join(most)} and {last}" if most else f"it {last}"


def character(effect: Effect, span_V: float, longest_s: float) -> Character:
    """Read what an effect is like off its response to a wave, to its mirror image and to a rest."""
    if effect.clocked:
        return Character("behind", None, None, clocked=True)
    phase = np.linspace(0.0, 1.0, _SAMPLES)
    moving = np.minimum(phase / 0.5, 1.0)
    wave = span_V * np.sin(2.0 * np.pi * (_TURNS + 0.2) * moving)
    ts_s = longest_s / _SAMPLES
    core = RDPI((1.0, 0.5), (0.2 * span_V,), 0.02 * ts_s)
    up, down = (_added(effect, core, side * wave, ts_s) for side in (1.0, -1.0))
    even, odd = float(np.std(up + down)), float(np.std(up - down))
    rest = up[phase > 0.52]
    moves = float(np.ptp(rest)) > _MOVES * max(float(np.ptp(up)), 1e-300)
    parity = "even" if even > 2.0 * odd else "odd" if odd > 2.0 * even else "both"
    slower = _added(effect, core, wave, _SLOWER * ts_s)
    rated = float(np.std(slower - up)) > _RATED * float(np.std(up))
    return Character(_place(effect, ts_s), moves, parity, None if moves else rated)


def _place(effect: Effect, ts_s: float) -> str:
    if effect.slot == "input":
        return "before"
    if effect.slot in ("rate", "memory"):
        return "in"
    read = [effect.coefficients(ts_s, core) for core in _CORES]
    return "in" if effect.slot == "hysteresis" and read[0] != read[1] else "behind"


def _added(effect: Effect, core: RDPI, u_V: Array, ts_s: float) -> Array:
    t = ts_s * np.arange(len(u_V), dtype=np.float64)
    record = Record("wave", t, u_V, u_V, ts_s=ts_s)
    both = [simulate_effects([Variant(core, e)], record)[:, 0] for e in ((effect,), ())]
    return both[0] - both[1]
