"""Results of a search for missing effects, and their files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import groupby, takewhile
from pathlib import Path
from typing import Any, Literal

from rdpi_gym.diagnosis.notices import Notice, statement
from rdpi_gym.diagnosis.portrait import Portrait
from rdpi_gym.diagnosis.preprocessing import Finding
from rdpi_gym.diagnosis.words import Grade, grade_of, headline, request_of, sized, text_of
from rdpi_gym.measurement import Quantities
from rdpi_gym.plant import CORES, RDPI, PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.documents import PLAIN, Document, at, stored
from rdpi_gym.support.files import read_json, write_json
from rdpi_gym.support.words import joined

Kind = Literal["diagnosis", "addition", "discovery", "removal"]
"""What was asked: one round of candidates, one effect on request, rounds until nothing helps, or an
effect taken out on request."""
Verdict = Literal["explained", "no missing effect", "unexplained"]
FORMATS: Mapping[str, Kind] = {
    "rdpi-diagnosis": "diagnosis",
    "rdpi-add": "addition",
    "rdpi-discovery": "discovery",
    "rdpi-remove": "removal",
}
"""Kinds by the format that their files state."""
_Format = Literal["rdpi-diagnosis", "rdpi-add", "rdpi-discovery", "rdpi-remove"]
VERSION = 1
_ORDER = [
    "format",
    "version",
    "title",
    "units",
    "noise_floor",
    "noise_origin",
    "numerical_floor",
    "given",
    "base",
    "final",
    "headline",
    "verdict",
    "sampling",
    "undecided",
    "unexplained_rmse",
    "remainder",
    "left",
    "portrait",
    "probabilities",
    "reservation",
    "next_experiment",
    "advice",
    "indistinguishable",
    "findings",
    "limits",
    "limit_notices",
    "checks",
    "seconds",
    "core",
]
"""Keys of a file, before those that only some kinds have."""


@dataclass(frozen=True)
class Errors(Document):
    """Errors of a model over the records of a data set, one offset free in each.

    Parameters
    ----------
    train_rmse_um, validation_rmse_um
        Over the counted samples of the records of that kind (µm).
    validation_nrmse_percent
        The latter over the peak to peak of the validation records (%).
    by_record_um
        Of every record (µm).
    """

    train_rmse_um: float = field(metadata=stored("train_rmse", null=math.inf))
    validation_rmse_um: float = field(metadata=stored("validation_rmse", null=math.inf))
    validation_nrmse_percent: float = field(metadata=stored(null=math.inf))
    by_record_um: Mapping[str, float] = field(metadata=stored("by_record"))


def share_of_excess(before: Errors, after: Errors, noise_um: float) -> float:
    """Share of the squared validation error above the noise that a model removes of another's."""
    squares = [each.validation_rmse_um**2 for each in (before, after)]
    excess = squares[0] - noise_um**2
    return (squares[0] - squares[1]) / excess if excess > 0.0 else 0.0


@dataclass(frozen=True)
class Candidate(Document):
    """One effect, refitted together with the base model and what was added before.

    Parameters
    ----------
    effect
        Its name.
    errors
        With the effect added.
    parameters, standard_errors
        Of the effect; a standard error is None where the data do not fix the parameter.
    confidence
        0 to 1: how probable this effect is, or one that is indistinguishable from it. How probable it
        is alone is told by :class:`Probabilities`.
    share
        Of the excess over the noise floor on validation records, how much disappears.
    indistinguishable
        Effects whose validation error the data cannot separate from this one's.
    evidence
        A sentence that a person can check on a figure.
    remarks
        A bound reached, a search that did not converge, a record made worse.
    form
        Of the effect; empty for its simplest.
    without_um
        Validation error (µm rms) with all other effects of the final model and without this one;
        None where that was not asked.
    instead
        By effect that came close to this one, the validation error (µm rms) of the final model with it
        in this one's place.
    grade
        How sure it is: of *likely*, it or one that is indistinguishable from it. Empty where that is
        less likely than not, and in results of other searches.
    """

    effect: str
    errors: Errors = field(metadata=stored(inline=True))
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float | None]
    confidence: float
    share: float = field(metadata=stored("share_of_excess", null=-math.inf))
    indistinguishable: tuple[str, ...]
    evidence: str
    remarks: tuple[str, ...] = ()
    form: str = ""
    without_um: float | None = field(default=None, metadata=stored("validation_rmse_without"))
    instead: Mapping[str, float] = field(
        default_factory=dict, metadata=stored("validation_rmse_instead")
    )
    grade: Grade = ""

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the files."""
        return {"effect": self.effect, "form": self.form, **super().to_dict()}


_Rounds = tuple[tuple[Candidate, ...], ...]


@dataclass(frozen=True)
class Step:
    """Effects that were added to the model at once.

    Parameters
    ----------
    added
        One candidate, or two that help only together; their errors are those of the model with both.
    """

    added: tuple[Candidate, ...]

    @property
    def errors(self) -> Errors:
        """Errors of the model after the step."""
        return self.added[0].errors

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of what was added."""
        return tuple(candidate.effect for candidate in self.added)


def steps_of(added: Iterable[Candidate]) -> tuple[Step, ...]:
    """Group candidates, in the order in which they were added, by what was added at once."""
    return tuple(Step(tuple(group)) for _, group in groupby(added, key=lambda c: c.errors))


@dataclass(frozen=True)
class Left(Document):
    """Share of the residual of a model that follows from the input.

    Parameters
    ----------
    share, low, high
        Share of the mean square of the excess over noise and numerical floor, and its 95 %
        interval.
    repeats
        Share that repeats where the input's history recurs; None where it never does.
    hidden_um
        An effect of the input smaller than this could hide (µm rms).
    left_um
        What is left over the noise and the numerical floor (µm rms).
    """

    share: float
    low: float
    high: float
    repeats: float | None
    hidden_um: float
    left_um: float


@dataclass(frozen=True)
class CoreChoice(Document):
    """Kind of hysteresis of a model, and how it was chosen.

    Parameters
    ----------
    kind
        Name of the core, as in the plant's file.
    alike
        Names of those that the held-out records do not tell from it, of those that were fitted.
    confidence
        Share of draws of pieces of the held-out records in which it, or one alike, is better than
        every other that was fitted; None where no other was.
    experiment
        What would tell it from those; None where there are none.
    clockwise
        Whether the loops turn clockwise in the plane of command and displacement; None: they
        enclose no area that stands out.
    advice
        The experiment as a notice.
    """

    kind: str
    alike: tuple[str, ...] = ()
    confidence: float | None = None
    experiment: str | None = None
    clockwise: bool | None = None
    advice: Notice | None = None

    @property
    def sentence(self) -> str:
        """Kind, how sure, and what is not told from it; empty where nothing speaks for another."""
        if self.confidence is None and not self.alike and not self.clockwise:
            return ""
        parts = [statement("core/kind", core=self.kind, title=CORES[self.kind].title)]
        if self.confidence is not None:
            parts.append(statement("core/confidence", percent=100 * self.confidence))
        if self.clockwise is not None:
            parts.append(
                statement("core/clockwise" if self.clockwise else "core/counter-clockwise")
            )
        if self.alike:
            parts.append(statement("core/alike", cores=joined(self.alike)))
        return f"{''.join(map(text_of, parts))}."


@dataclass(frozen=True)
class Probabilities(Document):
    """Probabilities of effects: weights of the sets that were visited.

    Parameters
    ----------
    effects
        By name, 0 to 1, the most probable first. They are no shares of a whole: two effects can be
        there at once.
    classes
        Of each effect that was added: that it is there, or one that the records do not tell from it.
    none
        That no effect is missing.
    other
        That something is there that the catalogue does not have.
    probable
        The effects that are less than nine times as likely to be absent.
    """

    effects: Mapping[str, float]
    classes: Mapping[str, float]
    none: float = field(metadata=stored("none"))
    other: float = field(metadata=stored("something else"))
    probable: tuple[str, ...]


@dataclass(frozen=True)
class View:
    """One record as measured and as models see it, for the figures.

    Parameters
    ----------
    name, role
        The record and what it was used for.
    t_s, u_V, y_um
        The measurement, ``(T,)``.
    models_um
        Displacement of each model, its free offset included (µm), by label, in order.
    counted
        Samples that count in the error.
    """

    name: str
    role: str
    t_s: Array
    u_V: Array
    y_um: Array
    models_um: Mapping[str, Array]
    counted: Array


@dataclass(frozen=True)
class SearchResult:
    """Result of `diagnose`, `add_effect`, `discover` and `remove_effect`.

    Parameters
    ----------
    kind
        Which of these.
    title
        Of the data.
    plant
        The model with all steps, as it is saved; of a diagnosis, with what it recommends.
    steps
        What was added, in order; of a diagnosis, what it recommends to add: at most one step.
    rounds
        Every candidate of each round, best first: the ranking that each step stood on.
    removed
        Effects that backward elimination, or a request, took out.
    noise_floor_um, noise_origin
        Noise (µm rms) and the sentence that says where the figure comes from.
    numerical_floor_um
        What half the step, another command between the samples and samples at the uneven times of
        the file change in the model (µm rms).
    base
        Errors of the base model, refitted on a fine comb of thresholds.
    final
        Errors of `plant`.
    given
        Errors of the model as it was given.
    verdict
        As in the files: it is judged on `plant`.
    sampling
        A sentence where the records are sampled too slowly for the model; else None.
    undecided
        A sentence where the displacement hardly follows the voltage; else None.
    unexplained_rmse_um
        What the model with all steps leaves over the noise floor (µm rms).
    remainder
        A sentence on whether what is left follows from the command.
    left
        In numbers, how much of what is left follows from the command; None where what is left is
        the noise.
    portrait
        Of the effect that the catalogue does not have, where what is left follows from the command;
        None where there is nothing to portray.
    next_experiment
        The experiment that would tell the effects added from their rivals; None where none is
        needed.
    indistinguishable
        Classes of effects, not in the model, that these records cannot tell apart.
    findings
        What was wrong with the records and was left out or mended.
    limits
        What these records cannot tell in principle: a sentence each.
    checks
        Tests without a model and of the data: a sentence each.
    views
        Records for the figures; not part of the files.
    seconds
        Time taken.
    notes
        What else was decided on the way: a sentence each.
    probabilities
        Of a discovery, how probable each effect is; else None.
    quantities
        What was measured: sentences use its words and units, and numbers named ``_um`` are in the
        unit of its output.
    core
        Which kind of hysteresis `plant` has, and how that was decided.
    reservation, advice, limit_notices
        What `sampling`, `next_experiment` and `limits` are the texts of; None and empty in results
        of files that hold the texts alone.
    """

    kind: Kind = field(metadata=stored(omitted=True))
    title: str
    plant: PlantModel[Any] = field(metadata=stored("model"))
    steps: tuple[Step, ...] = field(metadata=stored(omitted=True))
    rounds: tuple[tuple[Candidate, ...], ...] = field(metadata=stored(omitted=True))
    removed: tuple[str, ...]
    noise_floor_um: float = field(metadata=stored("noise_floor"))
    noise_origin: str
    base: Errors
    final: Errors
    given: Errors | None
    verdict: Verdict
    sampling: str | None
    undecided: str | None
    unexplained_rmse_um: float = field(metadata=stored("unexplained_rmse"))
    remainder: str
    next_experiment: str | None
    indistinguishable: tuple[tuple[str, ...], ...]
    checks: tuple[str, ...]
    views: tuple[View, ...] = field(metadata=stored(omitted=True))
    seconds: float
    notes: tuple[str, ...] = ()
    numerical_floor_um: float = field(default=0.0, metadata=stored("numerical_floor", null=0.0))
    left: Left | None = None
    portrait: Portrait | None = None
    findings: tuple[Finding, ...] = ()
    limits: tuple[str, ...] = ()
    probabilities: Probabilities | None = None
    quantities: Quantities = field(default_factory=Quantities)
    core: CoreChoice = field(default_factory=lambda: CoreChoice(RDPI.name))
    reservation: Notice | None = None
    advice: Notice | None = None
    limit_notices: tuple[Notice, ...] = ()

    @property
    def added(self) -> tuple[Candidate, ...]:
        """Every effect of the steps, in order."""
        return tuple(candidate for step in self.steps for candidate in step.added)

    @property
    def named(self) -> tuple[Candidate, ...]:
        """Effects of the steps that are found or likely: those stated as missing."""
        return tuple(c for c in self.added if self.grade(c) in ("found", "likely"))

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """The candidates of the first round, best first."""
        return self.rounds[0] if self.rounds else ()

    @property
    def stated(self) -> dict[str, Candidate]:
        """Every effect of the steps, by name, with the share that the model with it removes."""
        stated, before = dict[str, Candidate](), self.base
        for step in self.steps:
            share = share_of_excess(before, step.errors, self.noise_floor_um)
            alone = len(step.added) == 1
            for c in step.added:
                stated[c.effect] = replace(c, share=share) if alone else c
            before = step.errors
        return stated

    @property
    def stated_rounds(self) -> tuple[tuple[Candidate, ...], ...]:
        """Candidates of each round; what was added has the errors and the share of the model with it."""
        stated, found = self.stated, []
        for candidates in self.rounds:
            chosen = list(takewhile(lambda c: c.effect in stated, candidates))
            first = [replace(stated.pop(c.effect), remarks=c.remarks) for c in chosen]
            found.append((*first, *candidates[len(chosen) :]))
        return tuple(found)

    @property
    def ranking(self) -> tuple[Candidate, ...]:
        """The candidates of the first round as they are stated, best first."""
        return self.stated_rounds[0] if self.rounds else ()

    def certainty(self, candidate: Candidate) -> float:
        """Probability of an effect (0 to 1); where none is known, of a diagnosis, its confidence."""
        known = {} if self.probabilities is None else self.probabilities.effects
        return known.get(candidate.effect, candidate.confidence)

    def grade(self, candidate: Candidate) -> Grade:
        """Grade of an effect; of a result that states none, that of its certainty."""
        return candidate.grade or grade_of(self.certainty(candidate))

    def _is_alone(self, candidate: Candidate) -> bool:
        """Whether its probability bears the grade of an effect without its rivals."""
        alone = self.probabilities is not None
        return alone and (
            self.grade(candidate) != "likely" or bool(grade_of(self.certainty(candidate)))
        )

    @property
    def headline(self) -> str:
        """The answer in one line: which effect, how large, error before and after, noise."""
        stand_ins = {c.effect for c in self.added if self.grade(c) == "stand-in"}
        known = {
            effect.name: effect.full_name() if effect.name in stand_ins else sized(effect)
            for effect in self.plant.effects
        }
        removal = self.kind == "removal"
        names = self.removed if removal else [c.effect for c in self.added]
        before = self.given if removal and self.given is not None else self.base
        sure = {c.effect: self.grade(c) for c in self.added}
        # a confidence, and what makes a name likely that alone is not, is that in it or a rival
        rivals = {
            c.effect: f" (or {joined(c.indistinguishable)})"
            for c in self.added
            if c.indistinguishable and self.kind != "addition" and not self._is_alone(c)
        }
        said = headline(
            self.kind,
            {known.get(n, n) + rivals.get(n, ""): sure.get(n, "found") for n in names},
            (before.validation_rmse_um, self.final.validation_rmse_um),
            self.noise_floor_um,
            self.verdict,
            self.undecided,
            self.sampling if self.reservation is None else request_of(self.reservation),
            "found" if self.probabilities is None else grade_of(self.probabilities.none),
        )
        return self.quantities.fill(said)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``diagnosis.json``, ``add.json``, ``discovery.json``."""
        names = {kind: name for name, kind in FORMATS.items()}
        quantities = self.quantities
        stated = PLAIN.write_fields(self) | {
            "format": names[self.kind],
            "version": VERSION,
            "units": {"error": "um"} if quantities.are_standard else quantities.units,
            "headline": self.headline,
        }
        document = {key: stated[key] for key in _ORDER}
        steps, rounds = PLAIN.write(self.added), PLAIN.write(self.stated_rounds)
        if self.kind == "diagnosis":
            document["candidates"] = rounds.pop(0) if rounds else []
            document["chosen"] = [candidate.effect for candidate in self.added]
        if self.kind == "addition":
            # the file of one effect: its fields stand beside those of the search
            document["classes"] = document.pop("indistinguishable")
            document["before"], document["after"] = document.pop("base"), {}
            document |= steps.pop()
            document["after"] = {key: document.pop(key) for key in self.base.to_dict()}
        if not quantities.are_standard:
            document["quantities"] = stated["quantities"]
        removed, notes, model = (stated[key] for key in ("removed", "notes", "model"))
        tail = {"steps": steps, "removed": removed, "notes": notes, "rounds": rounds}
        return document | tail | {"model": model}

    def save(self, path: Path | str) -> Path:
        """Write the result as JSON, whole or not at all; the records of the figures are left out.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        return write_json(path, self.to_dict())

    @classmethod
    def load(cls, path: Path | str) -> SearchResult:
        """Read a result that :meth:`save` or a command wrote; it has no `views`.

        Raises
        ------
        InputError
            The file is missing, cut off or foreign, or a field has another type than it must.
        """
        return cls.from_dict(read_json(path, tuple(FORMATS), VERSION), str(path))

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], source: str = "result") -> SearchResult:
        """Build a result from the JSON object that :meth:`to_dict` returns.

        Parameters
        ----------
        document
            The object.
        source
            Named in errors.

        Raises
        ------
        InputError
            A field is missing or has another type than it must.
        """
        whole = {**PLAIN.read(Mapping[str, Any], document, source)}
        kind = FORMATS[PLAIN.read(_Format, whole.get("format"), at(source, "format"))]
        if kind == "addition":  # its one effect stands in the document itself
            after = PLAIN.read(Mapping[str, Any], whole.get("after"), at(source, "after"))
            added: tuple[Candidate, ...] = (Candidate.from_dict({**whole, **after}, source),)
            whole |= {"base": whole.get("before"), "indistinguishable": whole.get("classes", [])}
        else:
            added = PLAIN.read(tuple[Candidate, ...], whole.get("steps", []), at(source, "steps"))
        first = PLAIN.read(
            tuple[Candidate, ...], whole.get("candidates", []), at(source, "candidates")
        )
        rounds = PLAIN.read(_Rounds, whole.get("rounds", []), at(source, "rounds"))
        given = {"kind": kind, "steps": steps_of(added), "views": ()}
        return PLAIN.read_fields(
            cls, whole, source, {**given, "rounds": (first, *rounds) if first else rounds}
        )
