"""The texts of the diagnosis by code; :mod:`rdpi_gym.diagnosis.words` writes them.

A text has fields for words and units of the user's quantities (``{output}``, ``{input_unit}``) and for
the values of its statement: ``{x:output}`` and ``{x:input}`` are numbers with the unit, ``{x:~2}`` is
one of two digits, a pair of numbers is a value with its standard error, ``{n_s}`` the s of a plural.
"""

from __future__ import annotations

from collections.abc import Mapping

from rdpi_gym.diagnosis.notices import Code

_REVERSALS = "Stretches from reversal to reversal cover {low:~3} to {high:~3} "
_AMPLITUDES = (
    "thresholds and weights are known at these amplitudes only, and a gain that changes with "
    "amplitude cannot be seen."
)
_FREQUENCIES = "delay, lags, the rate law and δ2 cannot be separated."
_NO_STRETCH = "No stretch of the command runs from one reversal to the next: "
_CONGRUENT = "Loops of {span:~3} {input_unit} in {record} "
_SIDES = _CONGRUENT + "are {percent:~2} % {} at the sides of the range than in its middle"
_HIGHER, _LOWER = (_SIDES.replace("{}", way) for way in ("higher", "lower"))
_HEIGHTS = (
    _CONGRUENT + "have the same height in the middle of the range and at its sides: congruent."
)
_LOOPS = "From loops of {small:~3} {input_unit} ({first}) to {large:~3} {input_unit} ({second}) "
_RATES = (
    "From {low:~2} to {high:~2} {input_unit}/s the loops' opening grows with the power {exponent} "
    "of the rate"
)
_BRANCHES = "Along the wide branches of {record} the gain changes by {percent:~2} % towards the end"
_BEGINS = (
    "{record} begins {percent:~2} % of half its loop's opening away from where a stage that had "
    "rested at 0 {input_unit} would"
)
_EVEN = (
    "Under the half-wave symmetric command of {record} the {output} has even harmonics of "
    "{percent:~2} % of the odd ones (rms)"
)
_LINEAR = (
    "In {record} {percent:~2} % of the {output} is not what a linear path would make of the command"
)
_UP_TO = "In {record}, up to {highest_hz:~3} Hz, "
_LAGS = _UP_TO + "the {output} lags by {lag_us:~3} µs at amplitudes where no play moves: "
_LAG = _UP_TO + "the lag is {lag_us} µs: "
_GAIN_AT = "In {record} the gain at {highest_hz:~3} Hz "
_RESTS = "Over {rests} rest{rests_s} of the command "
_DRIFT = _RESTS + "the {output} moves by {drift} % of the stroke a minute"
_NO_DRIFT = (
    _RESTS
    + "nothing moves whatever the command did (under {least:g} % of the stroke a minute): no drift."
)
_LITTLE = ": too uncertain, or too little beside the rest, to call it "
_GROWS = _RESTS + "the {output} grows by {drift} % of itself a minute"
_AGAIN = "From {pair}, {apart:~3} s later, "

CHECKS: Mapping[str, str] = {
    "few reversals/yes": "The command reverses {count} times; with fewer than {least} reversals the "
    "loops are hardly seen.",
    "few reversals/no": "The command reverses {count} times.",
    "few amplitudes/none": _NO_STRETCH + _AMPLITUDES,
    "few amplitudes/yes": _REVERSALS + "{input_unit}: " + _AMPLITUDES,
    "few amplitudes/no": _REVERSALS + "{input_unit}.",
    "few frequencies/none": _NO_STRETCH + _FREQUENCIES,
    "few frequencies/yes": _REVERSALS + "Hz: " + _FREQUENCIES,
    "few frequencies/no": _REVERSALS + "Hz.",
    "no long holds/no": "After a move the command rests for up to {longest:~3} s.",
    "no long holds/yes": "The longest rest after a move takes {longest:~3} s: creep and drift show "
    "over decades of time.",
    "no repetition/record": "{second} has the command of {first}: noise and drift can be separated from "
    "the actuator.",
    "no repetition/period": "{record} repeats its period: noise can be separated from the actuator.",
    "no repetition/yes": "No command is repeated: noise, drift and what the actuator does cannot be "
    "separated without a model.",
    "clipping/yes": "In {record} near {extreme:.5g} {output_unit} the {output} stands still for "
    "{count} samples while the command moves: the sensor or the recorder clips.",
    "clipping/no": "The {output} never stands at its extreme while the command moves: no clipping.",
    "coarse resolution/yes": "{record} moves in steps of {step:output}, more than its noise: errors "
    "below a third of a step cannot be judged.",
    "coarse resolution/no": "The smallest step of the {output} ({step:output} in {record}) is lost "
    "in its noise.",
    "coarse resolution/none": "The {output} shows no steps.",
    "closed loop/noiseless": "The commands are free of noise: they were computed beforehand, so the "
    "loop was open.",
    "closed loop/yes": "In {record} the command's noise follows the {output} (correlation "
    "{correlation:~2}): the loop was closed, and noise of the sensor is part of the command.",
    "closed loop/no": "The command's noise does not follow the {output} (correlation "
    "{correlation:.1g} in {record}): the loop was open.",
    "two clocks/none": "No record holds six steady periods, so it cannot be seen whether command and "
    "{output} were sampled by one clock.",
    "two clocks/yes": "In {record} the lag of the {output} changes by {skew:~3} µs a second: command "
    "and {output} were sampled by two clocks, or their times are wrong.",
    "two clocks/no": "In {record} the lag of the {output} stays the same: one clock.",
    "two clocks/cannot tell": "In {record} the lag of the {output} changes by {measured} µs a "
    "second: too uncertain.",
    "mains hum/none": "No stretch is sampled fast and long enough to show a line at 50 or 60 Hz.",
    "mains hum/yes": "In {where} there is a line of {amplitude:output} at {frequency_hz:.4g} Hz, "
    "while frequencies around it have {around:output} at most: mains hum.",
    "mains hum/no": "In {where} no line at 50 or 60 Hz or their harmonics stands out of the noise: "
    "no mains hum.",
    "mains hum/cannot tell": "In {where} a line at {frequency_hz:.4g} Hz has {amplitude:output}, "
    "which other frequencies nearby have too: nothing can be said about mains hum.",
    "the quiet record": "the quiet record {record}",
    "a rest": "a rest of {record}",
    "a name": "{record}",
    "congruency/none": "There are no closed loops of one span at three biases, so it cannot be seen "
    "whether the gain depends on where a loop stands.",
    "congruency/yes/higher": _HIGHER + ": to play operators they would be the same.",
    "congruency/yes/lower": _LOWER
    + ": to play operators they would be the same; a gain that falls "
    "outwards is saturation.",
    "congruency/no/higher": _HEIGHTS,
    "congruency/no/lower": _HEIGHTS,
    "congruency/cannot tell/higher": _HIGHER + ", not safely more than the noise.",
    "congruency/cannot tell/lower": _LOWER + ", not safely more than the noise.",
    "gain over amplitude/none": "There are no closed loops of two sizes at one rate, so it cannot be "
    "seen whether the gain falls with amplitude.",
    "gain over amplitude/falls": _LOOPS + "the gain falls by {percent:~2} %: with plays it only "
    "grows, so the actuator saturates.",
    "gain over amplitude/grows": _LOOPS
    + "the gain grows by {percent:~2} %, as plays have it; a weak "
    "saturation could hide under it.",
    "gain over amplitude/same": _LOOPS + "the gain stays ({change} %): no saturation.",
    "gain over amplitude/uncertain": _LOOPS + "the gain stays ({change} %): too uncertain.",
    "rate law/none": "Loops over the full range are there at fewer than three rates, so it cannot be "
    "seen how thresholds grow with the rate.",
    "rate law/same": "Loops open as far at {high:~2} {input_unit}/s as at {low:~2} {input_unit}/s: "
    "nothing depends on the rate.",
    "rate law/yes": _RATES + "; δ2 |v|, a delay or a lag would give 1.",
    "rate law/no": _RATES + ", as δ2 |v|, a delay or a lag has it.",
    "rate law/cannot tell": _RATES + ": too uncertain.",
    "saturation/none": "No record goes up and down over most of the range, so the gain cannot be "
    "followed along a branch.",
    "saturation/yes/falls": _BRANCHES + ": a play model's gain only grows along a branch, so the "
    "actuator saturates.",
    "saturation/no/falls": _BRANCHES + ": no saturation.",
    "saturation/cannot tell/grows": _BRANCHES + ": plays may grow so, and a weak saturation could "
    "hide under it.",
    "saturation/cannot tell/falls": _BRANCHES + ", not safely more than its noise.",
    "initial memory/none": "No record begins in the middle of a loop that it goes through later, so "
    "what the plays remembered when it began cannot be seen.",
    "initial memory/yes": _BEGINS + ": the plays remember an excursion from before the record.",
    "initial memory/no": "{record} begins where a stage that had rested at 0 {input_unit} would: no "
    "memory from before.",
    "initial memory/cannot tell": _BEGINS + ", not safely more than the noise.",
    "asymmetry/none": "No record holds three steady periods of a half-wave symmetric command, so even "
    "harmonics of the {output} cannot be laid to the actuator.",
    "asymmetry/yes": _EVEN + ": play operators leave none, so the actuator is not symmetric.",
    "asymmetry/no": _EVEN + ": no asymmetry.",
    "asymmetry/cannot tell": _EVEN + ", not safely more than its noise.",
    "small signals/none": "No periodic record stays below a tenth of the command's widest swing, so "
    "lag, delay, resonance and the rate law cannot be separated by small signals.",
    "small signals/still": "In {record} nothing moves at the command's frequencies, so there is no "
    "phase.",
    "small signals/nonlinear": "In {record} the {output} is not proportional to the command, so its "
    "phase is not that of a lag alone.",
    "motion at small signals/lost": "In {record} the {output} does not follow the command at all: "
    "motion is lost, as in a gap.",
    "motion at small signals/yes": _LINEAR
    + ": the first threshold lies below this command, or there "
    "is backlash or a slew limit.",
    "motion at small signals/no": _LINEAR + ": every play sticks, and there is no backlash.",
    "motion at small signals/cannot tell": _LINEAR + ": too uncertain to say whether every play "
    "sticks.",
    "lag at small signals/resonance": _LAGS + "the gain rises with it, as of a resonance.",
    "lag at small signals/first order": _LAGS + "the gain falls with it, as of a first-order lag.",
    "lag at small signals/delay": _LAGS + "the gain stays, as of a delay.",
    "lag at small signals/open": _LAGS + "too little to tell a delay from a first-order lag.",
    "lag at small signals/none": _LAG + "none.",
    "lag at small signals/uncertain": _LAG + "too uncertain.",
    "lag at small signals/leads": _LAG + "check the times of the two channels.",
    "resonance at small signals/yes": _GAIN_AT + "has risen by {percent:~2} %: a resonance near "
    "{f0_hz:~3} Hz.",
    "resonance at small signals/cannot tell": _GAIN_AT
    + "has changed by {change} %: too uncertain.",
    "resonance at small signals/falls": _GAIN_AT + "has fallen by {percent:~2} %: no resonance in "
    "reach.",
    "resonance at small signals/no": _GAIN_AT
    + "is that of low frequencies: no resonance in reach.",
    "holds/none": "The command never rests, so creep and drift cannot be watched at constant command.",
    "creep/lag": "Over {rests} rest{rests_s} of the command, of up to {longest:~2} s, the {output} "
    "goes on by {percent:~2} % of each step a decade of time, but not as creep does: a lag that is "
    "not over when the command stops.",
    "creep/yes": _RESTS
    + "the {output} goes on by {percent:~2} % of each step a decade of time, in "
    "the step's direction: creep.",
    "creep/no": _RESTS
    + "nothing follows the last step (under {least:g} % of it a decade): no creep.",
    "creep/cannot tell": _RESTS + "creep would be {creep} % of a step a decade: too uncertain, or "
    "against the step.",
    "drift in holds/yes/alone": _DRIFT + ": drift.",
    "drift in holds/yes/of two": _DRIFT + " whatever the command did: drift.",
    "drift in holds/no/alone": _NO_DRIFT,
    "drift in holds/no/of two": _NO_DRIFT,
    "drift in holds/cannot tell/alone": _DRIFT + _LITTLE + "drift.",
    "drift in holds/cannot tell/of two": _DRIFT + " whatever the command did" + _LITTLE + "drift.",
    "gain drift in holds/yes": _GROWS + ": the gain drifts.",
    "gain drift in holds/no": _RESTS + "the {output} keeps its size (within {least:g} % a minute): "
    "the gain does not drift.",
    "gain drift in holds/cannot tell": _GROWS + _LITTLE + "a drift of the gain.",
    "repeats/none": "No command was run twice with time in between, so a change of offset or gain "
    "over the experiment cannot be seen.",
    "two records": "{first} to {second}",
    "two periods": "the first periods of {record} to the last",
    "drift between repeats/yes": _AGAIN
    + "the {output} has shifted by {percent:~2} % of its peak to "
    "peak ({shift:~2} {output_unit}): drift, or creep that still goes on.",
    "drift between repeats/no": _AGAIN + "the {output} has come back to within {least:g} % of its "
    "peak to peak: no drift.",
    "drift between repeats/cannot tell": _AGAIN
    + "the {output} has shifted by {change} % of its peak "
    "to peak: too uncertain.",
    "gain drift between repeats/yes": _AGAIN + "the stroke has changed by {percent:~2} %: the gain "
    "drifts.",
    "gain drift between repeats/no": _AGAIN + "the stroke is the same within {least:g} %: the gain "
    "does not drift.",
    "gain drift between repeats/cannot tell": _AGAIN + "the stroke has changed by {change} %: too "
    "uncertain.",
}
"""Findings of tests without a model, by the name of the test and its zone."""

ADVICE: Mapping[str, str] = {
    "fading triangle": "Add a slow triangle whose amplitude decays from the full range to nothing.",
    "four frequencies": "Add sines at four frequencies over a decade or more, and pairs of the same "
    "largest rate (A at f, A/4 at 4 f).",
    "add holds": "Add steps up and down with holds over three decades of time.",
    "repeat at the end": "Repeat the first record at the end.",
    "repeat at the very end": "Repeat the first record at the end of the experiment.",
    "widen range": "Measure again with a wider range, or leave these samples out (mask_s).",
    "finer range": "Use a finer range of the recorder.",
    "open the loop": "Record with the loop open, or give the {input} at the stack with less noise.",
    "twenty periods": "Record twenty periods or more of a sine.",
    "one clock": "Sample both channels by one clock.",
    "two quiet seconds": "Record two seconds at constant command, sampled at 500 Hz or more.",
    "quiet minute": "Record at constant command, after a long rest, for as long as the experiment took.",
    "minor loops": "Take minor loops of one span at three biases, three times each, at one slow rate.",
    "four amplitudes": "Take sines at four amplitudes up to the full range, the frequency lower in "
    "proportion as the amplitude is larger.",
    "four rates": "Take sines of the full amplitude at four frequencies over a decade or more, and a "
    "slow triangle.",
    "slow triangles": "Take a slow triangle over the full range, and over a half of it.",
    "decaying sine": "Begin each record with a decaying sine: it wipes out what came before.",
    "slow sine": "Take five periods or more of a slow sine or triangle about the middle of the range, "
    "at full and at half amplitude.",
    "small multisine": "Take an odd random-phase multisine with an amplitude below the first "
    "threshold, up to a fifth of the sampling rate, in eight periods or more.",
    "smaller multisine": "Repeat the small multisine at a third of its amplitude: plays stop, "
    "backlash grows.",
    "stair of holds": "Take a stair of steps up and down with holds over three decades of time: creep goes on "
    "in the direction of the last step, drift does not.",
}
"""Experiments and actions that would let a test decide."""

_FAR = "The model is far away from {record}: its RMS error is {percent:.3g} % of the measured peak to peak"
_MOSTLY = "The figures below mostly show this."
_STROKE = _FAR + ", and the measured stroke is about {gain:.4g} times the model's"
_UNITS = "; check --units, or whether this model belongs to this actuator. " + _MOSTLY
_RMS = ", rms with one offset free in each record; {noise}."
_LARGEST = (
    "The error is largest on {worst} ({largest:output}) and smallest on {best} ({smallest:output})"
)
_SLOPE = " than the model's (slope of measured over model)."
_MOVES = (
    "From the first to the last quarter of {record} the mean of measured minus model moves by "
    "{move:output}"
)
_PEAK = "The largest difference is {size:output}, in {record} at t = {time:.6g} s ({command:.3g} {input_unit}, "
_EARLY = ", before the first reversal: there the model does not know the actuator's past."
_WAYS = (
    "Measured minus model is {rising:output} on average while the command rises and "
    "{falling:output} while it falls: "
)
_WIDTH = (
    " than the model's, which suggests weights or thresholds that are off (or, where it changes with "
    "frequency, a lag or the rate law)."
)
_NEAR = "Near {place:.3g} {input_unit} the measured loop is {gap:output} "
_ALONG = " than the model's: its shape differs along the command. {width}"
_COURSE = (
    "from {low:~3} to {high:~3} {unit} the RMS error goes from {first:output} to {last:output}"
)
_RELATIVE = " ({first_percent:~2} and {last_percent:~2} % of the stroke there)."
_KINDS = {
    "peaks": "The error is largest in between, {peak:output} near {place:~3} {unit}; ",
    "grows": "The error grows with {}: ",
    "falls": "The error falls with {}: ",
    "stays": "The error changes little with {}: ",
    "grows relatively": "Relative to the stroke, the error grows with {}: ",
    "falls relatively": "Relative to the stroke, the error falls with {}: ",
}
_OTHER = {"frequency": "amplitude", "amplitude": "frequency"}
_FOLLOWS = (
    "Command and rate alone account for {percent:.0f} % of the residual's variance (cell means)"
)
_ON = "From {first:~2} to {last:~2} s after a move measured minus model goes on by {move:output}"
_BACK = (
    "From {first:~2} to {last:~2} s after a move measured minus model goes back by {move:output}"
)
_CLOCK = (
    "Over the {seconds:~3} s of the experiment the mean of measured minus model {} by {move:output}"
)
_STRAIGHT = ", with {percent:.0f} % of its moves on a straight line: "
_BAND = (
    "Most of the error above noise lies between {low:~2} and {high:~2} Hz, the most near "
    "{frequency_hz:~2} Hz ({size:output} rms), and {percent:.0f} % of the squared error is coherent with "
    "the command"
)
_HARMONICS = "In {record} ({frequency_hz:~3} Hz) {percent:.0f} % of the squared error ({size:output} rms) is "
_NEAREST = "{models} {} nearest with {error:output} rms "

COMPARISON: Mapping[str, str] = {
    "far/still": "The measured {output} of {record} never changes; check its column and the sensor.",
    "far/turned": _FAR
    + ", and it moves the other way; check the sign of y, the columns, or whether "
    "this model belongs to this actuator.",
    "far/gain": _STROKE + _UNITS,
    "far/unit": _STROKE
    + " (close to 10^{power}, as between m, mm, µm and nm, or V and mV)"
    + _UNITS,
    "far/other": _FAR
    + "; check the columns, or whether this model belongs to this actuator. "
    + _MOSTLY,
    "range": "Commands from {least:.4g} to {most:.4g} {input_unit} go beyond the range of {low:.4g} to "
    "{high:.4g} {input_unit} that {model} states: what the model says there is extrapolated.",
    "error/train": "Error {train:output} on the training records" + _RMS,
    "error/validation": "Error {validation:output} on the validation records" + _RMS,
    "error/train+validation": "Error {train:output} on the training records and {validation:output} "
    "on the validation records" + _RMS,
    "error/test": "Error {test:output} on the test records" + _RMS,
    "overall/noise": "{sizes} The error is hardly more than noise.",
    "overall/systematic": "{sizes} Nearly all of the squared error is systematic: a better model could "
    "remove it.",
    "overall/mixed": "{sizes} About {percent:.0f} % of the squared error is systematic: a better model "
    "could remove it.",
    "records/one": "There is one record only, so nothing can be said about how the error differs "
    "between records.",
    "records/alike": _LARGEST + "; the records are alike.",
    "records/differ": _LARGEST + ".",
    "gain/still": "The model does not move where samples count, so there is no gain to compare.",
    "gain/far": "On {record} the measured stroke is {ratio:.4g} times the model's (slope of measured "
    "over model).",
    "gain/fits": "The mean gain fits: measured and modelled stroke agree within {least:g} % in every "
    "record.",
    "gain/larger": "On {record} the measured stroke is {percent:.2g} % larger" + _SLOPE,
    "gain/smaller": "On {record} the measured stroke is {percent:.2g} % smaller" + _SLOPE,
    "drift/few": "The records have too few periods to tell a slow drift.",
    "drift/little": _MOVES + ": no marked slow drift.",
    "drift/other": _MOVES + "; the command differs between the two, so this need not be creep or "
    "drift.",
    "drift/same": _MOVES + ", which suggests creep, drift, or a memory from before the record.",
    "largest/rising/later": _PEAK + "rising).",
    "largest/rising/early": _PEAK + "rising)" + _EARLY,
    "largest/falling/later": _PEAK + "falling).",
    "largest/falling/early": _PEAK + "falling)" + _EARLY,
    "direction/rises": "The command only rises: the width of the loop cannot be compared.",
    "direction/falls": "The command only falls: the width of the loop cannot be compared.",
    "direction/right": _WAYS + "the mean width of the loop is about right.",
    "direction/narrower": _WAYS
    + "the measured loop is on average about {gap:output} narrower"
    + _WIDTH,
    "direction/wider": _WAYS + "the measured loop is on average about {gap:output} wider" + _WIDTH,
    "direction/near/narrower": _NEAR + "narrower" + _ALONG,
    "direction/near/wider": _NEAR + "wider" + _ALONG,
    "trend/unit/frequency": "Hz",
    "trend/unit/amplitude": "{input_unit}",
    **{
        f"trend/{by}/none": "Fewer than {count} stretches of one " + by + " run from reversal to "
        "reversal: these records cannot tell how the error depends on " + by + "."
        for by in _OTHER
    },
    **{
        f"trend/{by}/one": "All stretches have about the same "
        + by
        + " ({value:~3} {unit}): these "
        "records cannot tell how the error depends on " + by + "."
        for by in _OTHER
    },
    **{
        f"trend/{by}/{kind}/alone": text.replace("{}", by) + _COURSE + _RELATIVE
        for by in _OTHER
        for kind, text in _KINDS.items()
    },
    **{
        f"trend/{by}/{kind}/confounded": text.replace("{}", by)
        + _COURSE
        + _RELATIVE
        + " The "
        + other
        + " changes too between these rows, so part of this may be its doing."
        for by, other in _OTHER.items()
        for kind, text in _KINDS.items()
    },
    "plane/few": "There are too few samples, or passes through the same command at the same rate, to "
    "tell how much of the error follows from command and rate alone.",
    "plane/most": _FOLLOWS + ": most of the error is a repeatable function of the two.",
    "plane/part": _FOLLOWS + "; the rest depends on the past of the command, on time, or is noise.",
    "plane/little": _FOLLOWS + ": the rest depends on the past of the command, on time, or is "
    "noise.",
    "since_rest/none": "The command does not rest for long enough after a move to another place: these "
    "records cannot tell whether creep is missing.",
    "since_rest/on little": _ON + ": no marked creep is missing.",
    "since_rest/back little": _BACK + ": no marked creep is missing.",
    "since_rest/on lag": _ON
    + ", but hardly any more in the later half of that: a lag that is not over "
    "when the command stops, rather than creep.",
    "since_rest/on far": _ON + " in the direction of the move ({slope:output} a decade): creep is "
    "missing.",
    "since_rest/back lag": _BACK
    + ", but hardly any more in the later half of that: a lag or a resonance, rather than creep.",
    "since_rest/back far": _BACK + ", against the direction of the move: something drifts.",
    "since_rest/back creep": _BACK
    + ", against the direction of the move: the model creeps too much, or something drifts.",
    "clock/overlap": "The records' times overlap, so there is no common clock: a drift from record to "
    "record cannot be seen.",
    "clock/few": "There are too few samples to tell a drift over the experiment.",
    **{
        f"clock/{way}/{kind}": _CLOCK.replace("{}", way) + text
        for way in ("rises", "falls")
        for kind, text in {
            "little": ": no marked drift.",
            "unsure": ", which is not safely more than what it moves by from piece to piece and with "
            "the command: a drift cannot be seen.",
            "jumps": ", but jumps from record to record more than that: offsets that differ, or memory "
            "from before a record, rather than drift.",
            "one": _STRAIGHT + "creep that still goes on, or drift.",
            "several": _STRAIGHT + "drift.",
        }.items()
    },
    "spectrum/short": "The records are too short for a spectrum of the error.",
    "spectrum/noise": "In no band of frequencies is the error much more than noise.",
    "spectrum/slow": "Most of the error above noise lies below {edge_hz:~2} Hz, slower than a spectrum "
    "of these records resolves: the part that follows the command cannot be separated.",
    "spectrum/coherent/most": _BAND
    + ": a linear filter could remove most of it, such as a gain, a delay, "
    "a lag, a resonance or creep.",
    "spectrum/coherent/part": _BAND
    + "; the rest is shape of the loops, drift, disturbance or noise.",
    "spectrum/coherent/little": _BAND
    + ": it does not follow linearly from the command; it is shape of the "
    "loops, drift, disturbance or noise.",
    "distortion/none": "No record holds three steady periods, so the error cannot be split into "
    "harmonics.",
    "distortion/noise": "Under steady periods the error is not much more than noise in any record.",
    "distortion/gain": _HARMONICS
    + "at the command's frequencies and in step with the model: a gain "
    "that is off.",
    "distortion/width": _HARMONICS
    + "at the command's frequencies and a quarter of a period out of "
    "step: the loop's width, a lag, a delay or the rate law.",
    "distortion/odd": _HARMONICS
    + "in odd harmonics: the loop's shape, that is thresholds and weights, "
    "saturation or a slew limit.",
    "distortion/even": _HARMONICS + "in even harmonics, which no play operator gives: asymmetry.",
    "distortion/even command": _HARMONICS
    + "in even harmonics, which the command has too: that need not "
    "be asymmetry.",
    "distortion/little even": _HARMONICS
    + "in even harmonics, less than {least:g} % of the {output}: too "
    "little to lay it to the actuator.",
    "distortion/other": _HARMONICS + "not periodic: noise, drift or a disturbance.",
    "noise": "noise floor {floor:.4g} {output_unit} rms, from {origin}",
    "noise/unknown": "noise floor unknown: every record is too short",
    "noise/quiet": "the quiet record {record}",
    "noise/repetitions": "the repetitions in {record}",
    "noise/rough": "the part of the residual that changes from sample to sample",
    "noise/coloured": "the part of the residual that changes from sample to sample (times {colour:.2g}: "
    "the noise is slower than white)",
    "as written": "{text}",
    "left out/remark": "{record}: {remark}",
    "left out/quiet": "{record}: constant {input}, no part of the comparison",
    "left out/reversals": "{count} of {whole} samples lie before the first or after the last reversal of "
    "their record, or where the command mostly rests: they have no frequency and no amplitude, and "
    "count everywhere else",
    "left out/fast": "{count} samples at the largest rates are off the plane of command and rate",
    "left out/memory": "{record}: simulated from the memory that the fit found, a turn at {extremum:.4g} "
    "{input_unit}",
    "models/error": "{model} {error:output}",
    **{
        f"models/nearest/{count}/{where}/{kind}": _NEAREST.replace("{}", verb)
        + place
        + others
        + ". The noise floor is {noise:output}."
        for count, verb in {"one": "is", "several": "are"}.items()
        for where, place in {"held out": "held out", "all": "on all records"}.items()
        for kind, others in {"others": "; {others}", "alone": ""}.items()
    },
    "models/wins": "{model} on {count}",
    "models/records": "Of {count} records, least error or as good as that: {wins}.",
    "models/place/value": "{low:.3g} {unit}",
    "models/place/range": "{low:.3g} to {high:.3g} {unit}",
    "models/at": "{models} at {places}",
    "models/from": "{models} from {places}",
    **{
        f"models/throughout/{by}": "By " + by + ": {models} throughout ({places})." for by in _OTHER
    },
    **{f"models/by {by}": "By " + by + ": {parts}." for by in _OTHER},
}
"""Findings of a comparison, by its table and kind."""

_FASTER = "Sample faster than {n0:~3} Hz"
REQUESTS: Mapping[Code, tuple[str, str]] = {
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
NOTICES: Mapping[Code, str] = {
    **{code: ": ".join(parts) for code, parts in REQUESTS.items()},
    Code.STILL: "No record moves, so no effect can be identified.",
    Code.FEW_SAMPLES: "Only {n0:.0f} samples to fit ({n1:.0f} or more are needed), so small effects "
    "cannot be separated from overfitting.",
    Code.UNRELATED: "{percent:~2} % of the {output}'s power follows the command: check the columns "
    "and the sensor before any effect is believed.",
    Code.ONE_RECORD: "One record, of which only a part is held out, so differences between experiments "
    "cannot be seen.",
    Code.FEW_HALF_CYCLES: "Only {n0:.0f} whole half-cycles, so memory at several depths cannot be "
    "separated from the shape of one branch.",
    Code.ONE_FREQUENCY: "One frequency ({n0:~3} Hz), so a lag, a delay, a resonance and the rate law "
    "cannot be separated.",
    Code.ONE_AMPLITUDE: "One amplitude, so a gain that depends on amplitude or on bias, and memory at "
    "other depths, cannot be seen.",
    Code.NO_REST: "No rest after a move, so creep, drift and slow recovery cannot be separated.",
    Code.NO_SMALL_SIGNALS: "No small-amplitude data, so lags cannot be separated from hysteresis.",
    Code.NO_REPETITION: "No repetition, so disturbances cannot be separated from missing effects.",
    Code.LONGER: "Record longer, or faster: a few thousand samples while the command moves.",
    Code.DECAYING: "Record a slow triangle that decays from the full range to zero in twenty turns.",
    Code.RATES: "Record sines at four rates, up to ten times this one, their amplitude lower in "
    "proportion as they are faster.",
    Code.BIASES: "Record a slow triangle that decays from the full range, and loops at three biases.",
    Code.HOLDS: "Record steps up and down with holds over three decades of time.",
    Code.SMALL: "Record a small multisine, below the first threshold, where every play sticks.",
    Code.TWICE: "Record the same thing twice, at the beginning and at the end.",
    Code.OTHER_MOTION: "Record another kind of motion in a second file, to be held out.",
    Code.STANDARD: "Record the standard protocol: a slow decaying triangle, sines at several rates "
    "and amplitudes, a multisine, steps with long holds.",
    Code.EFFECTS_APART: "Record other frequencies and amplitudes: of the standard protocol{slowed}, {0} "
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
    Code.FIT_THESE: "Give {0} as training records, and others of such a motion to validate.",
    Code.ONE_CLOCK: "Sample both channels by one clock.",
    Code.SAMPLING_TIME: "Check the sampling time of {0}, and give it as ts_s in dataset.toml.",
    Code.TRIGGER: "Check the trigger of {0}: sample both channels by one clock.",
}
"""Limits, reservations and advice, and of reservations what they ask for with its reason."""

_OF = "{samples} sample{samples_s} ({share:~2} %) of {record} "
_COMMAND_CLIPPED = (
    _OF
    + "show a command that stands at its extreme while the {output} goes on and comes back: the "
    "recorded command is clipped, left out; "
)
_WRITTEN = (
    " times its time step: the model, right for the other records, fits it when {right:~3} s pass "
    "between its samples, not {written:~3} s, and errors are of the record with that set right."
)
_SHIFTED = (
    " the other records by {shift_ms:~2} ms ({samples:~2} samples): its {output} fits when it is moved "
    "by that, and errors are of the record so moved."
)

RECORDS: Mapping[str, str] = {
    "spikes/one": _OF
    + "stands alone, up to {times:~2} times the noise from its neighbours: outlier, "
    "left out.",
    "spikes/several": _OF + "stand alone, up to {times:~2} times the noise from their neighbours: "
    "outliers, left out.",
    "clipped output": _OF
    + "stand at the end of the {output}'s range without any noise: the sensor or "
    "its converter clips, left out.",
    "silent/dropout": _OF + "jump to one value and stay there: the sensor dropped out, left out.",
    "silent/frozen": _OF + "repeat one value exactly: the {output} was frozen, left out.",
    "clipped input/unknown": _COMMAND_CLIPPED
    + "what was really commanded there is unknown, and the "
    "memory after it is uncertain.",
    "clipped input/rebuilt": _COMMAND_CLIPPED + "what was commanded there was rebuilt from the "
    "{output}, which tells the rest of the command to {missed:~2} {input_unit} rms.",
    "in motion": _OF
    + "lie before the command has passed both of its extremes: the record begins in "
    "motion, and what came before it is unknown.",
    "unknown past": "{samples} of {whole} samples of {records} left out of the fit, of the verdict and of "
    "the errors, and an offset and the free response of creep fitted to each stretch between them: the "
    "history there was not recorded.",
    "exchanged": "{judged} agreed with the model to the noise and {fitted} did not: the model is fitted to "
    "{fitted} and validated on {judged}.",
    "clock/lead by one": "{samples:~3} sample: by so much the {output} of {records} leads its command, "
    "which no plant does; it was moved later by that.",
    "clock/lead": "{samples:~3} samples: by so much the {output} of {records} leads its command, which "
    "no plant does; it was moved later by that.",
    "clock/late": "{samples:~2} samples: at least by so much the {output} is late in every record, "
    "whatever its sampling time: a shift of the channels, and no delay of the plant.",
    "clock/scale": "{record} seems to be written with {factor:~3}" + _WRITTEN,
    "clock/record lags": "{record} lags" + _SHIFTED,
    "clock/record leads": "{record} leads" + _SHIFTED,
    "clock/skew": "The {output} of {of} falls behind its command by {late_ms:~2} ms more in each second: "
    "two clocks, and errors are of the records with that set right.",
}
"""Faults of records."""

_LEFT = "the remaining squared error above noise"
_HIDES = "an effect of less than {hidden:output} rms could hide"
_SEEN = "a learner with memory predicts {learned:.0f} % of it on data it has not seen"
_UNEVEN = ", too unevenly to be sure of more than {low:.0f} %"
_REPEATS = (
    ", and {repeats:.0f} % of the error beyond the noise repeats where the input's history does"
)
_AT_LEAST = "At least {low:.0f} % of " + _LEFT + " follows from the input: {seen}."
_LACKS = " The model lacks an effect, or has one or the hysteresis in another form."
_DISTURBED = "at least {percent:.0f} % is a disturbance: "
_OF_IT = " of the squared residual ({low:.0f} to {high:.0f} %; {before:output} to {after:output}): "
_GIVE = "give all inputs to a model, or hold the others still."
_FEWER = "the search read {read}: confidences are of these; the model is refitted over all {total:,} samples"
_ERRORS = ", and errors, shares, the noise floor and the verdict are of all of them"

SEARCH: Mapping[str, str] = {
    "unrelated": "The {output} hardly follows the {input} ({percent:.1f} % of its power): check the "
    "columns and the sensor.",
    "turned": "the {output} falls where the {input} rises: its sign was turned, the model describes -y",
    "not converged": "did not converge: {reason}",
    "on request": "{effect} was added on request; these records do not earn it",
    "no portrait": "no portrait of what is missing could be drawn: {error}",
    "core left out": "the core {core} was left out: {error}",
    "law/none": "the thresholds stay free: no refit with those of Eq. 8 converged",
    "law/kept": "the thresholds are those of Eq. 8 with {plays} plays; the validation error is "
    "{change:+.0f} % beside that of free thresholds",
    "law/comb": "the thresholds stay free: with those of Eq. 8 and {plays} plays the validation error "
    "would be {change:+.0f} % beside theirs",
    "core gains": "core {core}: {used} gains that are not zero",
    "core numbers": "{parts}",
    "at bound": "{parameter} at its bound",
    "not ended": "the search did not end",
    "refused": "it gains no more than chance, or than a command that cannot be its cause, would",
    "evidence": "The error falls most on {record}. {signature}",
    "left/low": "At least {low:.0f} % of the remaining squared error above noise follows from the input.",
    "read/stretch/one/all": "a stretch of {size:,} samples of {records}",
    "read/stretch/one/fewer": "a stretch of {size:,} samples, one in {step}, of {records}",
    "read/stretch/each/all": "a stretch of {size:,} samples of each of {records}",
    "read/stretch/each/fewer": "a stretch of {size:,} samples, one in {step}, of each of {records}",
    "read/step": "one sample in {step} of {records}",
    "fewer": _FEWER + " (one in {step} of those to fit enters the squares)" + _ERRORS,
    "fewer, all squares": _FEWER + _ERRORS,
    "left": "The residual is {rest}.",
    "left/clock": "The residual cannot be judged before the clock of {records} is right.",
    "rest/noise": "noise",
    "rest/between": "motion between the samples",
    "rest/uneven": "an effect of uneven sampling times",
    "rest/numerical": "noise and the error of the simulation",
    "core/kind": "Kind of hysteresis: {core}, the {title}",
    "core/confidence": " (confidence {percent:.0f} %)",
    "core/clockwise": "; the loops turn clockwise",
    "core/counter-clockwise": "; the loops turn counter-clockwise",
    "core/alike": ". Indistinguishable from it on these records: {cores}",
    "inputs/one": "The input {inputs}",
    "inputs/several": "The inputs {inputs}",
    "inputs/temperature": "The temperature",
    "inputs/one+temperature": "The input {inputs} and the temperature",
    "inputs/several+temperature": "The inputs {inputs} and the temperature",
    "explains/alone little": "{what} explains little or nothing of the residual ({high:.0f} % at most).",
    "explains/together little": "{what} together explain little or nothing of the residual ({high:.0f} % "
    "at most).",
    "explains/alone": "{what} explains {share:.0f} %" + _OF_IT + _GIVE,
    "explains/together": "{what} together explain {share:.0f} %" + _OF_IT + _GIVE,
    "explains/temperature": "{what} explains {share:.0f} %"
    + _OF_IT
    + "hold it still, or give it to a "
    "model as an input.",
    "input share": "{name} {share:.0f} %",
    "inputs alone": "{together} Alone: {shares}.",
    "seen/even": _SEEN,
    "seen/uneven": _SEEN + _UNEVEN,
    "seen/even repeats": _SEEN + _REPEATS,
    "seen/uneven repeats": _SEEN + _UNEVEN + _REPEATS,
    "disturbed/repetitions": _DISTURBED
    + "repetitions of the same input differ by more than the noise",
    "disturbed/stage": _DISTURBED + "the stage moves while the input rests by more than the noise",
    "residual/follows": _AT_LEAST,
    "residual/lacks": _AT_LEAST + _LACKS,
    "residual/follows disturbed": _AT_LEAST + " {disturbed_sentence}.",
    "residual/lacks disturbed": _AT_LEAST + _LACKS + " {disturbed_sentence}.",
    "residual/nothing": "Nothing was found that follows from the input; "
    + _HIDES
    + ". Of "
    + _LEFT
    + " {disturbed}.",
    "residual/open disturbed": "Of "
    + _LEFT
    + " {disturbed}. These records cannot tell whether the rest "
    "follows from the input: {seen}; " + _HIDES + ".",
    "residual/open": "These records cannot tell whether "
    + _LEFT
    + " follows from the input: {seen}, "
    "and neither repetitions nor quiet records show a disturbance; " + _HIDES + ".",
}
"""Findings and decisions of a search."""

_LOOPS_OF_HALF = (
    "Record a multisine below the first threshold beside loops of half the range: what changes the "
    "weights of the plays is not in the former."
)
_BUILDS_UP = (
    " for {seconds} s at a time, with small loops at three biases during the {seconds} s that follow: "
    "the effect builds up and dies away there."
)
_PLACED = "{share_sentence} of draws of the records place it "
_MIRRORED = "where the command is mirrored about the middle of its range, it "

PORTRAIT: Mapping[str, str] = {
    "to portray/between/before+behind": "Record small loops at five biases from one end of the range to the "
    "other, and one large loop: what stands before the plays bends both by the command, what stands "
    "behind them by the {output}.",
    "to portray/between/before+in": _LOOPS_OF_HALF,
    "to portray/between/behind+in": _LOOPS_OF_HALF,
    "to portray/fast": "Record fast motion" + _BUILDS_UP,
    "to portray/rests": "Record rest at either end of the range and in its middle" + _BUILDS_UP,
    "to portray/rates": "Record sines at four rates, each at full and at half amplitude: the effect "
    "grows with the rate alike at both, and a lag does not.",
    "to portray/curve": "Record a slow triangle that decays from the full range about its middle, and "
    "another about a quarter of the range: a static curve is the same in both.",
    "portrait/error": "From {before:output} to {after:output}: so far a free block takes the validation "
    "error (`rdpi add unknown`, form {form}).",
    "portrait/place/before": _PLACED
    + "before the hysteresis: there it changes the command that the "
    "plays see.",
    "portrait/place/in": _PLACED + "in the hysteresis: there it changes the weights of the plays.",
    "portrait/place/behind": _PLACED
    + "behind the hysteresis: there it is added to the {output} or "
    "bends it.",
    "portrait/place open": "Where in the chain it stands these records cannot tell: {shares}, by draws "
    "of their pieces.",
    "portrait/first place": "{share} {place} the hysteresis",
    "portrait/other place": "{share} {place} it",
    "share": "{percent:.0f} %",
    "share/all": "over 99 %",
    "portrait/nature": "{memory}. {parity}.",
    "portrait/memory open": "Whether it has a memory these records cannot tell: in {share} of their "
    "draws it has one",
    "portrait/no memory": "It has no memory",
    "portrait/memory": "It remembers, with a time constant of {seconds}",
    "portrait/memories": "It remembers, with two time constants: {seconds}",
    "seconds": "{value} s",
    "portrait/parity/even": "It is even: " + _MIRRORED + "stays as it is",
    "portrait/parity/odd": "It is odd: " + _MIRRORED + "changes its sign",
    "portrait/parity/both": "It has an even and an odd part about the middle of the range",
    "portrait/parity open": "Whether it is even or odd these records cannot tell: {shares}",
    "portrait/share of parity": "{parity} {share}",
    "portrait/no power": "No single power of amplitude and rate describes how it grows.",
    "portrait/growth": "It grows {ways}.",
    "portrait/amplitude": "with the amplitude to the power {power}",
    "portrait/rate": "with the rate to the power {power}",
    "portrait/drift": "It changes by {change} % from the first record to the last.",
    "portrait/no drift": "{change} % is its change from the first record to the last: none that shows.",
    "portrait/nearest": "Nearest in the catalogue: {kin}.",
    "portrait/kin": "{effect}, but {differs}",
    "portrait/experiment": "To see it best, {experiment_clause}.",
    "kin": "it {ways}",
    "kin/form": "it differs in its form alone",
    "kin/clocked": "goes by the clock",
    "kin/before": "stands before the hysteresis",
    "kin/in": "stands in the hysteresis",
    "kin/behind": "stands behind the hysteresis",
    "kin/memory": "has a memory",
    "kin/no memory": "has no memory",
    "kin/rated": "goes by the rate",
    "kin/not rated": "does not go by the rate",
    "kin/even": "is even",
    "kin/odd": "is odd",
}
"""Portrait of an effect that the catalogue does not have."""

TEXTS: Mapping[str, str] = {**CHECKS, **ADVICE, **COMPARISON, **RECORDS, **SEARCH, **PORTRAIT}
"""Every text of a statement."""
