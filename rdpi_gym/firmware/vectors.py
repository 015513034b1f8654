"""Signals that generated code is tried on, and the header of 2,000 samples that goes with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from rdpi_gym.firmware.source import Source, safe
from rdpi_gym.support.arrays import Array

SAMPLES = 2000
"""Samples of the vectors in a folder."""
ALLOWED = {64: 1e-13, 32: 1e-5, 31: 1e-6}
"""Largest difference from Python, in strokes or ranges of the command, by precision."""
ROUGH = 100.0
"""From which amplification on a program makes so much of roundings that more has to be allowed."""
_EPSILON = {64: 2.0**-53, 32: 2.0**-24, 31: 2.0**-32}
_LAST_BIT = 2.0**-53
_SEED = 15
_BEYOND = 1.2  # of the reach
_PIECE = 400  # samples


@dataclass(frozen=True)
class Vectors:
    """Inputs, and what Python answers.

    Parameters
    ----------
    inputs
        By name: ``reference_um``, float64[T + preview, B], and ``measured_um``, float64[T, B], of a
        controller; ``command_V``, float64[T, B], of a plant.
    expected
        Commands (V) or displacements (µm), float64[T, B].
    """

    inputs: Mapping[str, Array]
    expected: Array


def vectors(source: Source, samples: int = SAMPLES, lanes: int = 1, seed: int = _SEED) -> Vectors:
    """Return random signals of several kinds, within and slightly beyond what is reached, answered by the twin.

    Parameters
    ----------
    source
        The program, with what it reaches.
    samples, lanes
        T and B.
    seed
        Of all that is drawn.
    """
    rng = np.random.default_rng([seed, samples, lanes])
    program = source.program
    if program.kind == "plant":
        low, high = program.command_range_V
        command = _signals(rng, samples, lanes, low, high, 0.5 * (low + high), 0.5 * (high - low))
        return Vectors({"command_V": command}, program.twin.plant(command))
    low, high = source.reach_um or _around(program.centre_um, program.scale_um)
    reference = _signals(
        rng, samples + program.preview, lanes, low, high, program.centre_um, program.scale_um
    )
    measured = _measured(rng, reference[:samples], program.scale_um)
    if source.fixed is not None:  # what whole numbers cannot hold is not asked for
        far = source.fixed.displacement_scale_um
        reference, measured = (
            np.clip(each, source.fixed.centre_um - far, source.fixed.centre_um + far)
            for each in (reference, measured)
        )
    inputs = {"reference_um": reference, "measured_um": measured}
    return Vectors(inputs, program.twin.controller(reference, measured))


def amplification(source: Source, made: Vectors, seed: int = _SEED) -> float:
    """Return how much larger the answers' differences are than those of the inputs' last bits.

    A loop outside its stability limit, and what estimates online, make much of every rounding; no two
    ways of computing agree there, and none is nearer to the truth.

    Parameters
    ----------
    source
        The program.
    made
        Signals.
    seed
        Of the bits.

    Returns
    -------
    float
        Largest difference of an answer, in strokes or ranges of the command, in units of the relative
        difference of the inputs.
    """
    rng = np.random.default_rng([seed, 1])
    inputs = [x * (1.0 + _LAST_BIT * rng.uniform(-1.0, 1.0, x.shape)) for x in made.inputs.values()]
    twin = source.program.twin
    found = twin.plant(*inputs) if source.program.kind == "plant" else twin.controller(*inputs)
    return float(np.abs(found - made.expected).max() / unit_of(source, made) / _LAST_BIT)


def allowed(amplified: float, *, single: bool = False) -> dict[int, float]:
    """Return the largest difference from Python that is a matter of rounding, by precision.

    Parameters
    ----------
    amplified
        :func:`amplification`; it counts where it is large.
    single
        Whether Python itself has numbers of single precision in it.

    Examples
    --------
    >>> allowed(3.0) == ALLOWED, allowed(1e5)[32]
    (True, 0.0596...)
    """
    usual, epsilon = dict(ALLOWED), dict(_EPSILON)
    if single:
        usual[64], epsilon[64] = usual[32], epsilon[32]
    if not amplified > ROUGH:
        return usual
    return {p: min(max(each, 10.0 * amplified * epsilon[p]), 1.0) for p, each in usual.items()}


def unit_of(source: Source, made: Vectors) -> float:
    """Return what differences are fractions of: the range of commands (V), or the stroke (µm)."""
    if source.program.kind == "plant":
        return float(np.ptp(made.expected)) or 1.0
    low, high = source.program.command_range_V
    return high - low


def vectors_text(source: Source, made: Vectors) -> str:
    """Return the header ``rdpi_vectors.h`` of vectors of one lane."""
    program = source.program
    samples = len(made.expected)
    unit = "um" if program.kind == "plant" else "V"
    arrays = {**made.inputs, f"expected_{unit}": made.expected}
    lines = [
        f"/* {samples} samples of {safe(program.title)} as Python has them. Generated by rdpi-gym. */",
        "#ifndef RDPI_VECTORS_H",
        "#define RDPI_VECTORS_H",
        "",
        "#if RDPI_PRECISION == 32",
        "typedef float rdpi_vector_real;",
        "#define RDPI_V(x) ((rdpi_vector_real)(x))",
        "#else",
        "typedef double rdpi_vector_real;",
        "#define RDPI_V(x) (x)",
        "#endif",
        "",
        f"#define RDPI_VECTORS {samples}",
        "",
    ]
    for name, values in arrays.items():
        numbers = [f"RDPI_V({float(value)!r})" for value in values[:, 0]]
        rows = [", ".join(numbers[k : k + 5]) for k in range(0, len(numbers), 5)]
        lines += [f"static const rdpi_vector_real rdpi_vector_{name}[{len(numbers)}] = {{"]
        lines += [f"    {row}," for row in rows]
        lines += ["};", ""]
    return "\n".join([*lines, "#endif /* RDPI_VECTORS_H */", ""])


def _around(centre: float, scale: float) -> tuple[float, float]:
    return centre - scale, centre + scale


def _signals(
    rng: np.random.Generator,
    samples: int,
    lanes: int,
    low: float,
    high: float,
    centre: float,
    scale: float,
) -> Array:
    """Return signals of pieces of every kind, float64[T, B], one piece in ten beyond low and high."""
    found = np.empty((samples, lanes))
    for lane in range(lanes):
        at, last = 0, centre
        order = rng.permutation(len(_KINDS))
        piece = int(rng.integers(_PIECE // 2, _PIECE))
        while at < samples:
            kind = _KINDS[order[(at // piece) % len(_KINDS)]]
            count = min(piece, samples - at)
            amplitude = scale * rng.uniform(0.05, 1.0)
            middle = centre + rng.uniform(-1.0, 1.0) * (scale - amplitude)
            if rng.random() < 0.1 or at // piece == 2:  # once in every signal that is long enough
                middle, amplitude = 0.5 * (low + high), 0.5 * _BEYOND * (high - low)
            found[at : at + count, lane] = kind(rng, count, middle, amplitude, last)
            at += count
            last = float(found[at - 1, lane])
    return found


def _sine(rng: np.random.Generator, count: int, middle: float, size: float, last: float) -> Array:
    turn = 2.0 * np.pi / rng.uniform(20.0, 2.0 * count + 20.0)
    return np.asarray(middle + size * np.sin(turn * np.arange(count) + rng.uniform(0.0, 6.0)))


def _triangle(
    rng: np.random.Generator, count: int, middle: float, size: float, last: float
) -> Array:
    place = (np.arange(count) / rng.uniform(20.0, 2.0 * count + 20.0) + rng.random()) % 1.0
    return np.asarray(middle + size * (4.0 * np.abs(place - 0.5) - 1.0))


def _steps(rng: np.random.Generator, count: int, middle: float, size: float, last: float) -> Array:
    length = int(rng.integers(5, 60))
    levels = middle + size * rng.uniform(-1.0, 1.0, -(-count // length))
    return np.repeat(levels, length)[:count]


def _noise(rng: np.random.Generator, count: int, middle: float, size: float, last: float) -> Array:
    width = int(rng.integers(3, 40))
    window = np.hanning(width + 2)
    smooth = np.convolve(rng.standard_normal(count + width + 1), window, "valid")[:count]
    return np.asarray(middle + size * smooth / max(float(np.abs(smooth).max()), 1e-9))


def _hold(rng: np.random.Generator, count: int, middle: float, size: float, last: float) -> Array:
    return np.full(count, last)


_Kind = Callable[[np.random.Generator, int, float, float, float], Array]
_KINDS: tuple[_Kind, ...] = (_sine, _triangle, _steps, _noise, _hold)


def _measured(rng: np.random.Generator, reference_um: Array, scale: float) -> Array:
    """Return what a stage that nearly follows might show (µm): late, a little short, noisy, drifting."""
    samples, lanes = reference_um.shape
    late = rng.integers(1, 4, lanes)
    rows = np.maximum(np.arange(samples)[:, None] - late, 0)
    followed = reference_um[rows, np.arange(lanes)]
    short = rng.uniform(-0.02, 0.02, lanes)
    drift = np.cumsum(rng.standard_normal((samples, lanes)), axis=0) * 2e-4
    noise = 0.002 * rng.standard_normal((samples, lanes))
    return np.asarray(followed * (1.0 + short) + scale * (drift + noise))
