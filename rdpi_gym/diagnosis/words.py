"""Texts: of every notice, and the answer of a search in one sentence."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.measurement import Quantities
from rdpi_gym.measurement.quantities import in_output, unit_template
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.signals.experiments import standard_protocol
from rdpi_gym.support.words import closed, digits, joined

_UNIT_IN_NAME = re.compile(r"(_per)?_(hz|V_s|um_s|s|V|um|rad)$")
# Of the error without an effect, the share that is no improvement.
_NO_BETTER = 0.98
_TIMES = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))

_PLAIN = Quantities()
_FASTER = "Sample faster than {n0:~3} Hz"
_REQUESTS: Mapping[Code, tuple[str, str]] = {
    Code.STEP_TOO_LONG: (
        "Sample faster than {n0:~2} Hz",
        "half the step and another command between the samples change the model by {n1:output} rms, "
        "so less than that cannot be judged.",
    ),
    Code.STAMPS_UNEVEN: (
        "Write time stamps with more digits, or trigger the samples by a clock",
        "stamps that are off an even one by {us:~2} µs rms change the model by {n1:output} rms, so "
        "less than that cannot be judged.",
    ),
    Code.MOTION_BETWEEN: (
        _FASTER,
        "the records miss motion between their samples ({0} has {n1:~3} Hz); with {n2:.0f} steps "
        "from sample to sample the model leaves {n3:output}.",
    ),
    Code.EFFECT_TOO_FAST: (
        f"{_FASTER} before anything more is concluded",
        "{0} ({n1:~3} {1}) is too fast for records of {n2:~3} Hz.",
    ),
}
_TEXTS: Mapping[Code, str] = {
    **{code: ": ".join(parts) for code, parts in _REQUESTS.items()},
    Code.STILL: "No record moves: nothing can be told of any effect.",
    Code.FEW_SAMPLES: "{n0:.0f} samples to fit: small effects cannot be told from the freedom of the "
    "fit ({n1:.0f} or more would do).",
    Code.UNRELATED: "{percent:~2} % of the {output}'s power follows the command: check the columns "
    "and the sensor before any effect is believed.",
    Code.ONE_RECORD: "1 record: nothing is held out but a part of it, so what differs between "
    "experiments cannot be told.",
    Code.FEW_HALF_CYCLES: "{n0:.0f} whole half-cycles: memory at several depths cannot be told from "
    "the shape of one branch.",
    Code.ONE_FREQUENCY: "1 frequency ({n0:~3} Hz): a lag, a delay, a resonance and the rate law look "
    "alike.",
    Code.ONE_AMPLITUDE: "1 amplitude: whether the gain depends on amplitude or on bias, and memory "
    "at other depths, cannot be told.",
    Code.NO_REST: "No rest after a move: creep, drift and slow recovery cannot be told apart.",
    Code.NO_SMALL_SIGNALS: "No small signals: lags cannot be told from the motion of plays.",
    Code.NO_REPETITION: "No repetition: what does not follow from the command cannot be told from "
    "what the model lacks.",
    Code.LONGER: "Record longer, or faster: a few thousand samples while the command moves.",
    Code.DECAYING: "Record a slow triangle that decays from the full range to zero in twenty turns.",
    Code.RATES: "Record sines at four rates, up to ten times this one, their amplitude lower in "
    "proportion as they are faster.",
    Code.BIASES: "Record a slow triangle that decays from the full range, and loops at three biases.",
    Code.HOLDS: "Record steps up and down with holds from 0.05 to 50 s.",
    Code.SMALL: "Record a small multisine, below the first threshold, where every play sticks.",
    Code.TWICE: "Record the same thing twice, at the beginning and at the end.",
    Code.OTHER_MOTION: "Record another kind of motion in a second file, to be held out.",
    Code.STANDARD: "Record the standard protocol: a slow decaying triangle, sines at several rates "
    "and amplitudes, a multisine, steps with long holds.",
    Code.EFFECTS_APART: "Record other frequencies and amplitudes: of the standard protocol, {0} "
    "({purpose}; {seconds:g} s at {rate_hz:g} samples a second) tells {1} from {2} best.",
    Code.LOOPS_WITHIN: "Record loops within a loop, from small to large: some kinds close them, "
    "others drift; that tells {0} from {others}.",
    Code.ONE_LOOP: "Record one loop at four rates, ten times apart in all; that tells {0} from "
    "{others}.",
    Code.NESTED: "Record nested loops of one size at unlike bias: that tells {0} from {others}.",
    Code.FASTER: "Record the same motion again, sampled faster.",
    Code.CLOCKED: "Record the same motion again, every sample triggered by one clock.",
    Code.CONTACTS: "Look for loose contacts and switching.",
    Code.SENSOR_RANGE: "Measure again with a wider range of the sensor.",
    Code.SENSOR: "Check the sensor's cable and range.",
    Code.COMMAND_RANGE: "Record the command over its full range, or give the one that was sent.",
    Code.BEGIN_AT_REST: "Begin each record at rest, or with one cycle that may be left out.",
    Code.BEGIN_AFTER_CYCLE: "Begin each record at rest, after one full cycle.",
    Code.ONE_CLOCK: "Sample both channels by one clock.",
    Code.SAMPLING_TIME: "Check the sampling time of {0}, and give it as ts_s in dataset.toml.",
    Code.TRIGGER: "Check the trigger of {0}: sample both channels by one clock.",
}


def text_of(notice: Notice, quantities: Quantities = _PLAIN) -> str:
    """Write a notice."""
    return _written(_TEXTS[notice.code], notice, quantities)


def notice_of(text: str) -> Notice | None:
    """Return the notice that has a code, or this very text without names and numbers; else None."""
    known = {template: code for code, template in _TEXTS.items()}
    known |= {code.value: code for code in Code}
    code = known.get(text)
    return None if code is None or "{" in _TEXTS[code] else Notice(code)


def request_of(notice: Notice) -> str:
    """Write what a reservation asks for without its reason; any other notice whole."""
    template, *_ = _REQUESTS.get(notice.code, (_TEXTS[notice.code],))
    return _written(template, notice, _PLAIN)


def _written(template: str, notice: Notice, quantities: Quantities) -> str:
    values: dict[str, object] = {f"n{i}": number for i, number in enumerate(notice.numbers)}
    values["others"] = joined(notice.names[1:])
    if notice.code is Code.STAMPS_UNEVEN:
        values["us"] = 1e6 * notice.numbers[0]
    elif notice.code is Code.UNRELATED:
        values["percent"] = 100.0 * notice.numbers[0]
    elif notice.code is Code.EFFECTS_APART:
        known = {experiment.name: experiment for experiment in standard_protocol(0.0, 1.0, 1.0)}
        chosen = known[notice.names[0]]
        values |= {
            "purpose": chosen.purpose,
            "seconds": chosen.duration_s,
            "rate_hz": 1 / chosen.ts_s,
        }
    return quantities.text(template, *notice.names, **values)


def sized(effect: Effect) -> str:
    """Name an effect with its fitted parameters, as a template."""
    places, sizes = [], []
    for parameter in effect.parameters:
        value = effect.values[parameter.name]
        if parameter.fixed or parameter.unit == "rad":
            continue
        if parameter.unit == "Hz":
            places.append(f" at {digits(value, 3)} Hz")
            continue
        label = _UNIT_IN_NAME.sub("", parameter.name).replace("_", " ")
        unit = "" if parameter.unit == "1" else f" {unit_template(parameter.unit)}"
        quantity = _time(value) if parameter.unit == "s" else f"{_figures(value)}{unit}"
        sizes.append(f"{label} {quantity}")
    return effect.full_name() + "".join(places) + (f" ({', '.join(sizes)})" if sizes else "")


def headline(
    asked: str,
    effects: Sequence[str],
    errors_um: tuple[float, float],
    noise_um: float,
    verdict: str,
    undecided: str | None,
    request: str | None,
) -> str:
    """Answer a search, as a template; `request` is what a reservation asks for."""
    before, after = (in_output(error) for error in errors_um)
    noise = f"noise {in_output(noise_um)}"
    rest = "" if request is None else f" {closed(request)}"
    if not effects:
        numbers = f"Error {after}, {noise}.{rest}"
        if undecided is not None:
            return f"Undecided. {undecided} {numbers}"
        if verdict == "no missing effect":
            return f"Nothing is missing. {numbers}"
        return f"Unexplained: no effect of the catalogue improves held-out error. {numbers}"
    verb = {"addition": "Added", "removal": "Removed"}.get(asked, "Missing")
    numbers = f"Error {before.removesuffix(' {output_unit}')} to {after}, {noise}.{rest}"
    names = joined(effects)
    if undecided is not None:
        return f"{verb}: {names}. Undecided whether it is there. {undecided} {numbers}"
    if asked == "addition" and errors_um[1] > _NO_BETTER * errors_um[0]:
        return f"{verb}: {names}, which does not improve held-out error. {numbers}"
    if verdict != "unexplained" or asked == "removal":
        return f"{verb}: {names}. {numbers}"
    if asked == "addition":
        return f"{verb}: {names}, which leaves part of the error unexplained. {numbers}"
    return f"{verb}: {names}, and something that no effect of the catalogue explains. {numbers}"


def _figures(value: float) -> str:
    """Write a parameter: an exponent only where the number is very large or very small."""
    return digits(value, 3) if 1e-4 <= abs(value) < 1e6 or value == 0.0 else f"{value:.3g}"


def _time(value_s: float) -> str:
    scale, unit = next(((s, u) for s, u in _TIMES if abs(value_s) >= s), _TIMES[-1])
    return f"{digits(value_s / scale, 3)} {unit}"
