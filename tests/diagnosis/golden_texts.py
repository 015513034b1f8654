"""Texts of limits, advice, reservations, findings and headlines; ``python -m`` writes the fixed ones."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from benchmarks.tracking.episode import Caution
from rdpi_gym.diagnosis import preprocessing, words
from rdpi_gym.diagnosis.beam.ending import clock_finding
from rdpi_gym.diagnosis.beam.evidence import Clock
from rdpi_gym.diagnosis.comparison.compare import compare
from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.diagnosis.portrait import Kin, Portrait, Value, experiment_for, sentences_of
from rdpi_gym.diagnosis.preprocessing import Finding
from rdpi_gym.diagnosis.results import Candidate, CoreChoice, Errors
from rdpi_gym.diagnosis.search import plants, verdict
from rdpi_gym.diagnosis.search.separability import next_experiment, what_to_measure
from rdpi_gym.diagnosis.search.verdict import NumericalFloor
from rdpi_gym.diagnosis.suitability import limits, unrelated
from rdpi_gym.diagnosis.words import Grade, headline, in_words, sized
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.laboratory import compensator_comparison
from rdpi_gym.measurement import Dataset, Quantities, Record
from rdpi_gym.plant import CORES, named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.report.discovery_text import candidate_sentence

FILE = Path(__file__).with_name("golden_texts.json")
STANDARD = Quantities()
P5 = named_plant("P5")


def record(u_V: Any, name: str = "one", ts_s: float = 1e-3, **changes: Any) -> Record:
    """Return a record of a plain gain, with a little noise."""
    u = np.asarray(u_V, dtype=np.float64)
    noise = 0.01 * np.random.default_rng(3).standard_normal(u.size)
    return replace(Record(name, np.arange(u.size) * ts_s, u, 0.9 * u + noise, ts_s=ts_s), **changes)


def sine(size: int = 2000, amplitude_V: float = 10.0, frequency_hz: float = 5.0) -> Any:
    """Return a sine command at 1 kHz (V)."""
    return amplitude_V * np.sin(2.0 * np.pi * frequency_hz * np.arange(size) * 1e-3)


SCALE = data_scale((record(sine()),))


def datasets(quantities: Quantities = STANDARD) -> dict[str, Dataset]:
    """Return data sets, each with limits of its own."""
    t = np.arange(4000) * 1e-3
    sweep = 10.0 * np.sin(2.0 * np.pi * (1.0 + 4.0 * t) * t)
    fading = sine(4000) * np.linspace(1.0, 0.05, t.size)
    steps = 5.0 * np.repeat([0.0, 1.0, -1.0, 0.5], 1000)
    wrong = np.random.default_rng(1).standard_normal(4000)
    found = {
        "still": Dataset("still", (record(np.ones(600)),)),
        "one sine": Dataset("one sine", (record(sine()),)),
        "short": Dataset("short", (record(sine(400)),)),
        "ramp": Dataset("ramp", (record(np.linspace(0.0, 10.0, 1000)),)),
        "50 Hz": Dataset("50 Hz", (record(sine(frequency_hz=50.0)), record(sine(), "two"))),
        "sweep": Dataset("sweep", (record(sweep),)),
        "fading": Dataset("fading", (record(fading), record(steps, "steps"))),
        "steps": Dataset("steps", (record(steps),)),
        "unrelated": Dataset("unrelated", (record(sine(4000), y_um=wrong),)),
        "small": Dataset("small", (record(sine()), record(sine(amplitude_V=0.5), "small"))),
    }
    return {name: replace(data, quantities=quantities) for name, data in found.items()}


def _limits(q: Quantities) -> Iterator[tuple[str, Any]]:
    for name, data in datasets(q).items():
        found = limits(data)
        yield f"limits of {name}", [words.text_of(each, q) for each in found]
        for settled in (False, True):
            yield (
                f"experiment of {name}, settled {settled}",
                _advised(q, found, (), settled),
            )
    for name, data in datasets(q).items():
        if name != "still":
            yield f"relation of {name}", unrelated(data.train)


def _advised(
    q: Quantities, said: Any, findings: Any, settled: bool = False, again: Any = None
) -> Any:
    nothing: Any = ((), P5.effects, {}, (), P5.hysteresis, SCALE)
    chosen, _, typical, groups, core, scale = nothing
    effects = [CATALOGUE["creep"]()]
    found = what_to_measure(
        chosen, effects, typical, groups, core, scale, again, findings, said, settled
    )
    return _played(found, q)


def _played(advice: Any, q: Quantities) -> Any:
    return [_text(advice, q), list(advice.records) if advice else []]


def _text(notice: Notice | None, q: Quantities) -> str | None:
    return None if notice is None else words.text_of(notice, q)


def _findings(q: Quantities) -> Iterator[tuple[str, Any]]:
    one = record(sine(), "held")
    few = np.zeros(2000, dtype=bool)
    few[40:47] = True
    lone = np.zeros(2000, dtype=bool)
    lone[7] = True
    made: dict[str, Finding] = {
        "spike": preprocessing._spikes(one, lone, 31.4),
        "spikes": preprocessing._spikes(one, few, 7.77),
        "clipped": preprocessing._clipped(one, few),
        "dropout": preprocessing._silent(one, "dropout", few),
        "frozen": preprocessing._silent(one, "frozen", few),
        "command lost": preprocessing._clipped_command(one, few, None),
        "command rebuilt": preprocessing._clipped_command(one, few, 0.1234),
        "in motion": preprocessing._in_motion(one, few),
        "unknown past": preprocessing.unknown_past({"held": few}),
        "unknown pasts": preprocessing.unknown_past(dict.fromkeys("abcde", few)),
        "exchanged": preprocessing.exchanged_roles([one], [one, one]),
        "lag": clock_finding(Clock("delay", "held", 0.00123), [one]),
        "lead": clock_finding(Clock("delay", "held", -0.00123), [one]),
        "stretch": clock_finding(Clock("step", "held", 0.693), [one]),
        "slight stretch": clock_finding(Clock("step", "held", 0.02), [one]),
        "skew": clock_finding(Clock("skew", "", 2e-4), [one]),
    }
    u = np.random.default_rng(5).standard_normal(4000).cumsum()
    for shift in (-3, 4):
        moved = {n: record(u, n, y_um=np.roll(u, shift)) for n in "abcd"}
        masks = {n: np.zeros(4000, dtype=bool) for n in "abcd"}
        for k, finding in enumerate(preprocessing._clocks(moved, masks, set())):
            made[f"clock {shift} {k}"] = finding
    for name, finding in made.items():
        said = replace(finding, quantities=q)
        yield f"finding {name}", [said.kind, said.sentence, said.next_step]
        yield f"experiment of finding {name}", _advised(q, (), [finding])


def _advice(q: Quantities) -> Iterator[tuple[str, Any]]:
    yield "again", _advised(q, (), (), again=verdict.Judgement("explained").again)
    yield "standard protocol", _played(Notice(Code.STANDARD), q)
    for kind, others in (
        ("rdpi", ("stop",)), ("rdpi", ("bouc_wen", "duhem")), ("bouc_wen", ("dahl",)),
        ("stop", ("rdpi", "lugre", "dahl")), ("preisach", ("stop",)),
    ):  # fmt: skip
        found = plants.kind_experiment(CORES[kind], [CORES[o] for o in others])
        yield f"kinds {kind} {others}", _played(found, q)
    creep, lag = CATALOGUE["creep"](), CATALOGUE["actuator_lag"]()
    for made in ((), ("triangle-slow", "stairs", "multisine-small")):
        found = next_experiment(creep, lag, P5.hysteresis, SCALE, made)
        yield f"creep or lag {len(made)}", _played(found, q)


def _reservations(q: Quantities) -> Iterator[tuple[str, Any]]:
    fine = NumericalFloor(0.01, 0.2, 1000.0, 0.0, 0.0, 0.0, 0.3)
    uneven = NumericalFloor(0.01, 0.02, 1000.0, 0.0, 0.5, 2.5e-6, 0.01)
    for name, floor in (("step", fine), ("clock", uneven)):
        found = verdict._by_floor("unexplained", floor, 0.05)
        yield (
            f"reservation {name}",
            [
                _text(found.sampling, q),
                words.template(f"rest/{found.rest}"),
                *_played(found.again, q),
            ],
        )
    for effect, values in (("resonance", {"f0_hz": 900.0}), ("delay", {"delay_s": 1e-5})):
        own = CATALOGUE[effect](**values)
        variant = cast("Any", SimpleNamespace(effects=(own,)))
        yield f"reservation {effect}", _text(verdict._beyond_sampling(variant, [record(sine())]), q)
    yield (
        "reservation none",
        _text(
            verdict._beyond_sampling(cast("Any", SimpleNamespace(effects=())), [record(sine())]), q
        ),
    )


def _headlines(q: Quantities) -> Iterator[tuple[str, Any]]:
    floor = verdict._by_floor("unexplained", NumericalFloor(0.1, 0.2, 1e3), 0.05)
    creep = sized(CATALOGUE["creep"]())
    loose = unrelated(datasets(q)["unrelated"].train)
    cases = product(
        ("diagnosis", "addition", "discovery", "removal"),
        cast("list[dict[str, Grade]]", [{}, {creep: "found"}, {creep: "found", "delay": "likely"}]),
        ("explained", "no missing effect", "unexplained"),
        (None, loose),
        (None, words.request_of(cast("Notice", floor.sampling))),
    )
    for asked, effects, verdict_, undecided, sampling in cases:
        if undecided is not None and (sampling is not None or verdict_ != "unexplained"):
            continue
        key = f"headline {asked} {len(effects)} {verdict_} {undecided is None} {sampling is None}"
        errors = (0.4321, 0.4319 if len(effects) == 2 else 0.0987)
        yield key, headline(asked, effects, errors, 0.05, verdict_, undecided, sampling, "found")


def _effects(q: Quantities) -> Iterator[tuple[str, Any]]:
    for name, kind in CATALOGUE.items():
        yield f"size of {name}", sized(kind())


def _portraits(q: Quantities) -> Iterator[tuple[str, Any]]:
    plain = Portrait(
        "behind", {"behind": 0.9, "in": 0.1}, False, 0.1, (), "even", {"even": 1.0}, Value(2.0, 0.1),
        Value(0.0, 0.0), Value(3.0, 0.2), 0.5, 0.2, "", (Kin("asymmetry", "that is odd"),), "", (),
    )  # fmt: skip
    changes: dict[str, dict[str, Any]] = {
        "plain": {},
        "rated": {"rate_power": Value(1.0, 0.1), "nearest": ()},
        "slow": {"memory": True, "time_constants_s": (Value(0.5, 0.1),)},
        "driven": {
            "memory": True, "time_constants_s": (Value(0.5, 0.1),), "rate_power": Value(1.0, 0.1),
        },
        "open": {"place": None, "places": {"before": 0.5, "behind": 0.45, "in": 0.05}},
        "inner": {"place": None, "places": {"in": 0.5, "behind": 0.4, "before": 0.1}},
        "unknown": {"memory": None, "parity": None, "power": None, "drift_percent": None},
    }  # fmt: skip
    for name, changed in changes.items():
        drawn = replace(plain, **changed)
        best = experiment_for(drawn)
        yield f"portrait {name}", [words.template(best.code, **best.values), *sentences_of(drawn)]


def _results(q: Quantities) -> Iterator[tuple[str, Any]]:
    errors = Errors(0.1, 0.2, 1.0, {"one": 0.2})
    for indistinguishable, remarks, without in product(((), ("delay",)), ((), ("a",)), (None, 0.3)):
        found = Candidate(
            "creep", errors, {}, {}, 0.9, 0.8, indistinguishable, "It creeps", remarks,
            without_um=without,
        )  # fmt: skip
        yield f"candidate {indistinguishable} {remarks} {without}", candidate_sentence(found)
    for alike, sure, clockwise in product(((), ("stop",)), (None, 0.9), (None, True)):
        found_core = CoreChoice("rdpi", alike, sure, None, clockwise)
        yield f"core {alike} {sure} {clockwise}", found_core.sentence


def _comparisons(q: Quantities) -> Iterator[tuple[str, Any]]:
    for name in ("fading", "one sine"):
        found = compare(datasets(q)[name], P5)
        yield f"comparison of {name}", found.findings
        yield f"left out of {name}", list(found.left_out)
        yield f"noise of {name}", found.noise_origin
        for check in found.checks:
            yield f"check {check.name} of {name}", [check.sentence, check.next_step]


_CAUTIONS = (
    (),
    (("warned", "no mode is known"),),
    (("unstable", "beyond its stability limit"), ("saturated", "3 % of the samples")),
    (("diverged", "the error is larger than that of standing still"),),
    (("saturated", "3 % of the samples"), ("extrapolated", "the plant is a guess")),
)


def _cautions(q: Quantities) -> Iterator[tuple[str, Any]]:
    for (i, blind), (k, knowing) in product(enumerate(_CAUTIONS), enumerate(_CAUTIONS)):
        said = [[Caution(*each) for each in part] for part in (blind, knowing)]
        yield f"cautions {i} {k}", list(compensator_comparison._warnings(*said))


CHOSEN = (_limits, _findings, _advice, _reservations)
"""What has experiments to choose."""
PARTS = (*CHOSEN, _headlines, _effects, _portraits, _results, _comparisons, _cautions)


def texts(quantities: Quantities = STANDARD, parts: Sequence[Any] = PARTS) -> dict[str, Any]:
    """Return every text by what it is of."""
    found = {key: text for part in parts for key, text in part(quantities)}
    return in_words(found, quantities)


if __name__ == "__main__":
    FILE.write_text(json.dumps(texts(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
