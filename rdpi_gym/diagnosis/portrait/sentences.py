"""The portrait in words, and the experiment that would show the unknown effect best."""

from __future__ import annotations

from rdpi_gym.diagnosis.portrait.portrait import Portrait, Value
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.support.words import joined, number, pm

_PLACES = {
    "before": "there it changes the command that the plays see",
    "in": "there it changes the weights of the plays",
    "behind": "there it is added to the {output} or bends it",
}
_PARITIES = {
    "even": "It is even: where the command is mirrored about the middle of its range, it stays as it is",
    "odd": "It is odd: where the command is mirrored about the middle of its range, it changes its sign",
    "both": "It has an even and an odd part about the middle of the range",
}
# What separates two places.
_BETWEEN = {
    frozenset({"before", "behind"}): (
        "small loops at five biases from one end of the range to the other, and one large loop: what "
        "stands before the plays bends both by the command, what stands behind them by the {output}"
    ),
    frozenset({"before", "in"}): (
        "a multisine below the first threshold beside loops of half the range: what changes the weights "
        "of the plays is not in the former"
    ),
    frozenset({"in", "behind"}): (
        "a multisine below the first threshold beside loops of half the range: what changes the weights "
        "of the plays is not in the former"
    ),
}
_DRIFTS = 2.0  # errors from which on a change is one
_ALL = 0.99  # of a few hundred draws, a share that is told as a bound
_SLIGHT = 0.05  # a share that is not told


def experiment_for(drawn: Portrait) -> str:
    """Return the experiment that would show the effect best, or tell what is open."""
    if drawn.place is None:
        first, second, *_ = sorted(drawn.places, key=lambda name: -drawn.places[name])
        return f"Record {_BETWEEN[frozenset({first, second})]}."
    if drawn.time_constants_s:
        tau = drawn.time_constants_s[0].value
        driven = drawn.rate_power is not None and drawn.rate_power.value > 0.3
        what = "fast motion" if driven else "rest at either end of the range and in its middle"
        return (
            f"Record {what} for {number(3.0 * tau, 2)} s at a time, with small loops at three biases "
            f"during the {number(3.0 * tau, 2)} s that follow: the effect builds up and dies away there."
        )
    if drawn.rate_power is not None and drawn.rate_power.value > 0.3:
        return (
            "Record sines at four rates, each at full and at half amplitude: the effect grows with the "
            "rate alike at both, and a lag does not."
        )
    return (
        "Record a slow triangle that decays from the full range about its middle, and another about a "
        "quarter of the range: a static curve is the same in both."
    )


def sentences_of(drawn: Portrait) -> tuple[str, ...]:
    """Return the portrait in words, the answer with its number first."""
    said = [
        f"From {in_output(drawn.before_um)} to {in_output(drawn.after_um)}: so far a free block takes the "
        f"validation error (`rdpi add unknown`, form {drawn.form or 'static, behind'!r}).",
        f"{_place(drawn)}.",
        f"{_memory(drawn)}. {_parity(drawn)}.",
        _growth(drawn),
        _drift(drawn),
    ]
    if drawn.nearest:
        nearest = "; ".join(f"{kin.effect}, but {kin.differs}" for kin in drawn.nearest)
        said.append(f"Nearest in the catalogue: {nearest}.")
    best = drawn.experiment[:1].lower() + drawn.experiment[1:]
    return tuple(filter(None, (*said, f"To see it best, {best}")))


def _percent(share: float) -> str:
    return "over 99 %" if share > _ALL else f"{100.0 * share:.0f} %"


def _place(drawn: Portrait) -> str:
    found = [
        name
        for name in sorted(drawn.places, key=lambda name: -drawn.places[name])
        if drawn.places[name] > _SLIGHT
    ]
    shares = [f"{_percent(drawn.places[name])} {name} it" for name in found]
    first = shares[0].replace(" it", " the hysteresis")
    if drawn.place is None:
        return (
            f"Where in the chain it stands these records cannot tell: {joined([first, *shares[1:]])}, by "
            "draws of their pieces"
        )
    share = _percent(drawn.places[drawn.place])
    return f"{_upper(share)} of draws of the records place it {drawn.place} the hysteresis: {_PLACES[drawn.place]}"


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _memory(drawn: Portrait) -> str:
    if drawn.memory is None:
        return (
            f"Whether it has a memory these records cannot tell: in {_percent(drawn.memories)} of their "
            "draws it has one"
        )
    if not drawn.memory:
        return "It has no memory"
    constants = joined([_seconds(value) for value in drawn.time_constants_s])
    if len(drawn.time_constants_s) > 1:
        return f"It remembers, with two time constants: {constants}"
    return f"It remembers, with a time constant of {constants}"


def _seconds(value: Value) -> str:
    return f"{pm(value.value, value.error)} s"


def _parity(drawn: Portrait) -> str:
    if drawn.parity is None:
        shares = [
            f"{name} {_percent(share)}" for name, share in drawn.parities.items() if share > _SLIGHT
        ]
        return f"Whether it is even or odd these records cannot tell: {joined(shares)}"
    return _PARITIES[drawn.parity]


def _growth(drawn: Portrait) -> str:
    if drawn.power is None or drawn.rate_power is None:
        return "No single power of amplitude and rate describes how it grows."
    grows = [
        f"with the {of} to the power {pm(value.value, value.error)}"
        for of, value in (("amplitude", drawn.power), ("rate", drawn.rate_power))
        if value.error > 0.0 or value.value > 0.0
    ]
    return f"It grows {joined(grows)}."


def _drift(drawn: Portrait) -> str:
    drift = drawn.drift_percent
    if drift is None:
        return ""
    changed = pm(drift.value, drift.error)
    if abs(drift.value) > _DRIFTS * drift.error:
        return f"It changes by {changed} % from the first record to the last."
    return f"{changed} % is its change from the first record to the last: none that shows."
