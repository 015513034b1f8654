"""Results of a search for missing effects, and their files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any, Literal, cast, get_args

from rdpi_gym.diagnosis.notices import Notice, statement
from rdpi_gym.diagnosis.portrait.portrait import Portrait
from rdpi_gym.diagnosis.preprocessing.finding import Finding
from rdpi_gym.diagnosis.probability import Probabilities
from rdpi_gym.diagnosis.words import headline, request_of, sized, text_of
from rdpi_gym.measurement import Quantities
from rdpi_gym.plant import CORES, RDPI, PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.fields import Fields
from rdpi_gym.support.files import read_json, write_json
from rdpi_gym.support.words import joined, quoted

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
VERSION = 1
_INSTEAD = "validation_rmse_instead"


@dataclass(frozen=True)
class Errors:
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

    train_rmse_um: float
    validation_rmse_um: float
    validation_nrmse_percent: float
    by_record_um: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the files."""
        return {
            "train_rmse": _number(self.train_rmse_um),
            "validation_rmse": _number(self.validation_rmse_um),
            "validation_nrmse_percent": _number(self.validation_nrmse_percent),
            "by_record": dict(self.by_record_um),
        }

    @classmethod
    def from_fields(cls, fields: Fields) -> Errors:
        """Build from the object of the files; a null, of a refit that failed, is infinity."""
        return cls(
            fields.number("train_rmse", math.inf),
            fields.number("validation_rmse", math.inf),
            fields.number("validation_nrmse_percent", math.inf),
            fields.numbers("by_record"),
        )


@dataclass(frozen=True)
class Candidate:
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
        0 to 1: how often this effect, or one that is indistinguishable from it, wins where the records
        are split or drawn anew. How probable it is then is told by :class:`Probabilities`.
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
    """

    effect: str
    errors: Errors
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float | None]
    confidence: float
    share: float
    indistinguishable: tuple[str, ...]
    evidence: str
    remarks: tuple[str, ...] = ()
    form: str = ""
    without_um: float | None = None
    instead: Mapping[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the files."""
        return {
            "effect": self.effect,
            "form": self.form,
            **self.errors.to_dict(),
            "parameters": dict(self.parameters),
            "standard_errors": dict(self.standard_errors),
            "confidence": self.confidence,
            "share_of_excess": _number(self.share),
            "indistinguishable": list(self.indistinguishable),
            "evidence": self.evidence,
            "remarks": list(self.remarks),
            "validation_rmse_without": self.without_um,
            _INSTEAD: dict(self.instead),
        }

    @classmethod
    def from_fields(cls, fields: Fields, errors: Errors | None = None) -> Candidate:
        """Build from the object of the files, with `errors` where they stand elsewhere."""
        return cls(
            fields.text("effect"),
            Errors.from_fields(fields) if errors is None else errors,
            fields.numbers("parameters"),
            fields.optional_numbers("standard_errors"),
            fields.number("confidence"),
            fields.number("share_of_excess", -math.inf),
            fields.texts("indistinguishable"),
            fields.text("evidence"),
            fields.texts("remarks"),
            fields.optional_text("form") or "",
            fields.optional_number("validation_rmse_without"),
            fields.numbers(_INSTEAD) if fields.raw(_INSTEAD) else {},
        )


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
class Left:
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

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the files."""
        return asdict(self)

    @classmethod
    def from_fields(cls, fields: Fields) -> Left:
        """Build from the object of the files."""
        return cls(
            fields.number("share"),
            fields.number("low"),
            fields.number("high"),
            fields.optional_number("repeats"),
            fields.number("hidden_um"),
            fields.number("left_um"),
        )


@dataclass(frozen=True)
class CoreChoice:
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
        """Kind, how sure, and what the records cannot tell from it; empty where none was compared."""
        if self.confidence is None and not self.alike:
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

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the files."""
        advice = None if self.advice is None else self.advice.to_dict()
        return asdict(self) | {"alike": list(self.alike), "advice": advice}

    @classmethod
    def from_fields(cls, fields: Fields) -> CoreChoice:
        """Build from the object of the files."""
        clockwise = fields.raw("clockwise")
        return cls(
            fields.text("kind"),
            fields.texts("alike"),
            fields.optional_number("confidence"),
            fields.optional_text("experiment"),
            None if clockwise is None else bool(clockwise),
            Notice.optional(fields, "advice"),
        )


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

    kind: Kind
    title: str
    plant: PlantModel[Any]
    steps: tuple[Step, ...]
    rounds: tuple[tuple[Candidate, ...], ...]
    removed: tuple[str, ...]
    noise_floor_um: float
    noise_origin: str
    base: Errors
    final: Errors
    given: Errors | None
    verdict: Verdict
    sampling: str | None
    undecided: str | None
    unexplained_rmse_um: float
    remainder: str
    next_experiment: str | None
    indistinguishable: tuple[tuple[str, ...], ...]
    checks: tuple[str, ...]
    views: tuple[View, ...]
    seconds: float
    notes: tuple[str, ...] = ()
    numerical_floor_um: float = 0.0
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
    def candidates(self) -> tuple[Candidate, ...]:
        """The candidates of the first round, best first."""
        return self.rounds[0] if self.rounds else ()

    @property
    def headline(self) -> str:
        """The answer in one line: which effect, how large, error before and after, noise."""
        known = {effect.name: effect for effect in self.plant.effects}
        removal = self.kind == "removal"
        names = self.removed if removal else [c.effect for c in self.added]
        before = self.given if removal and self.given is not None else self.base
        said = headline(
            self.kind,
            [sized(known[name]) if name in known else name for name in names],
            (before.validation_rmse_um, self.final.validation_rmse_um),
            self.noise_floor_um,
            self.verdict,
            self.undecided,
            self.sampling if self.reservation is None else request_of(self.reservation),
        )
        return self.quantities.fill(said)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``diagnosis.json``, ``add.json``, ``discovery.json``."""
        names = {kind: name for name, kind in FORMATS.items()}
        document: dict[str, Any] = {
            "format": names[self.kind],
            "version": VERSION,
            "title": self.title,
            "units": {"error": "um"} if self.quantities.are_standard else self.quantities.units,
            "noise_floor": self.noise_floor_um,
            "noise_origin": self.noise_origin,
            "numerical_floor": self.numerical_floor_um,
            "given": None if self.given is None else self.given.to_dict(),
            "base": self.base.to_dict(),
            "final": self.final.to_dict(),
            "headline": self.headline,
            "verdict": self.verdict,
            "sampling": self.sampling,
            "undecided": self.undecided,
            "unexplained_rmse": self.unexplained_rmse_um,
            "remainder": self.remainder,
            "left": None if self.left is None else self.left.to_dict(),
            "portrait": None if self.portrait is None else self.portrait.to_dict(),
            "probabilities": None if self.probabilities is None else self.probabilities.to_dict(),
            "reservation": None if self.reservation is None else self.reservation.to_dict(),
            "next_experiment": self.next_experiment,
            "advice": None if self.advice is None else self.advice.to_dict(),
            "indistinguishable": [list(group) for group in self.indistinguishable],
            "findings": [finding.to_dict() for finding in self.findings],
            "limits": list(self.limits),
            "limit_notices": [notice.to_dict() for notice in self.limit_notices],
            "checks": list(self.checks),
            "seconds": self.seconds,
            "core": self.core.to_dict(),
        }
        steps = [candidate.to_dict() for candidate in self.added]
        rounds = [[candidate.to_dict() for candidate in tried] for tried in self.rounds]
        if self.kind == "diagnosis":
            document["candidates"] = rounds.pop(0) if rounds else []
            document["chosen"] = [candidate.effect for candidate in self.added]
        if self.kind == "addition":
            # the file of one effect: its fields stand beside those of the search
            document["classes"] = document.pop("indistinguishable")
            document["before"], document["after"] = document.pop("base"), {}
            document |= steps.pop()
            document["after"] = {key: document.pop(key) for key in self.base.to_dict()}
        if not self.quantities.are_standard:
            document["quantities"] = self.quantities.to_dict()
        return document | {
            "steps": steps,
            "removed": list(self.removed),
            "notes": list(self.notes),
            "rounds": rounds,
            "model": self.plant.to_dict(),
        }

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
        fields = Fields(document, source)
        kind = FORMATS.get(fields.text("format"))
        verdict = fields.text("verdict")
        if kind is None or verdict not in get_args(Verdict):
            raise InputError(
                f"{source} has the format {quoted(fields.text('format'))} and the verdict {quoted(verdict)}; "
                f"expected one of {', '.join(FORMATS)} and one of {', '.join(get_args(Verdict))}"
            )
        one = kind == "addition"  # its one effect stands in the document itself
        added = (
            (Candidate.from_fields(fields, Errors.from_fields(fields.inner("after"))),)
            if one
            else tuple(Candidate.from_fields(step) for step in fields.objects("steps"))
        )
        rounds = [tuple(map(Candidate.from_fields, tried)) for tried in fields.lists("rounds")]
        first = tuple(map(Candidate.from_fields, fields.objects("candidates")))
        given = fields.raw("given")
        return cls(
            kind=kind,
            title=fields.text("title"),
            plant=PlantModel.from_dict(fields.inner("model").document, f"{source}, model"),
            steps=steps_of(added),
            rounds=(first, *rounds) if first else tuple(rounds),
            removed=fields.texts("removed"),
            noise_floor_um=fields.number("noise_floor"),
            noise_origin=fields.text("noise_origin"),
            numerical_floor_um=fields.optional_number("numerical_floor") or 0.0,
            base=Errors.from_fields(fields.inner("before" if one else "base")),
            final=Errors.from_fields(fields.inner("final")),
            given=None if given is None else Errors.from_fields(fields.inner("given")),
            verdict=cast("Verdict", verdict),
            sampling=fields.optional_text("sampling"),
            undecided=fields.optional_text("undecided"),
            unexplained_rmse_um=fields.number("unexplained_rmse"),
            remainder=fields.text("remainder"),
            left=None if fields.raw("left") is None else Left.from_fields(fields.inner("left")),
            portrait=None
            if document.get("portrait") is None
            else Portrait.from_fields(fields.inner("portrait")),
            next_experiment=fields.optional_text("next_experiment"),
            indistinguishable=fields.groups("classes" if one else "indistinguishable"),
            findings=tuple(map(Finding.from_fields, fields.objects("findings"))),
            limits=fields.texts("limits"),
            probabilities=Probabilities.from_fields(fields.inner("probabilities"))
            if document.get("probabilities") is not None
            else None,
            checks=fields.texts("checks"),
            views=(),
            seconds=fields.number("seconds"),
            notes=fields.texts("notes"),
            quantities=Quantities.from_fields(fields.inner("quantities"))
            if "quantities" in document
            else Quantities(),
            core=CoreChoice.from_fields(fields.inner("core"))
            if "core" in document
            else CoreChoice(RDPI.name),
            reservation=Notice.optional(fields, "reservation"),
            advice=Notice.optional(fields, "advice"),
            limit_notices=tuple(map(Notice.from_fields, fields.objects("limit_notices"))),
        )


def _number(value: float) -> float | None:
    """Return a number that JSON has: None for a candidate without a refit."""
    return value if math.isfinite(value) else None
