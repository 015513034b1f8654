"""Judgement of the study's rows against their truth, tables by source of truth, and targets."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import pandas as pd

from benchmarks.effect_discovery.forms import TIMED
from benchmarks.effect_discovery.independent import NOISE_UM, PLAIN
from rdpi_gym.support.markdown import frame_table, leading_rows, table
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.draws import HIDEABLE, VISIBLE

LARGEST_RATIO = 1.15
"""Largest ratio of the validation error to the noise of a case that counts as explained."""
MARGIN = 0.1
"""By which the true share may lie outside of the interval."""
EXPLAINED = 1.3
"""Noise floors of clean error that an explained record may have left."""
_NOTHING = 0.5  # noise floors: of less no share is asked
_SAMPLED = 0.5  # noise floors that lie between the samples: from here on sampling matters
_OF_TRUTH = 2.0  # largest ratio of a numerical floor that is believed
_FEW_SAMPLES = 4.0  # of the shortest time of what is hidden: with fewer, sampling matters
_TIMES = ("time_constant_s", "delay_s")
# Kinds of findings that say what was done to a record.
_NOTICED_AS: Mapping[str, tuple[str, ...]] = {
    "spikes": ("spikes",),
    "dropouts": ("dropout", "frozen"),
    "clipped output": ("clipped output",),
    "clipped input": ("clipped input",),
    "one sample apart": ("clock",),
    "clock skew": ("clock",),
}
# Faults of clocks and rows that reading states, before anything is fitted.
_READ = ("rounded stamps", "jittered stamps", "missing rows")
_CLOCKS = ("clock skew", *_READ)


def _between_samples(truth: Mapping[str, Any]) -> str:
    if "sampling_um" not in truth:
        return ""
    floors = truth["sampling_um"] / truth["noise_um"]
    return "below half" if floors < 0.5 else "half to twice" if floors < 2.0 else "above twice"


_UNKNOWN_PAST = "history that nobody recorded"


def judge(row: Row) -> dict[str, Any]:
    """Judge one row.

    A name counts as right where it is hidden, and ``by class`` where the records of the case cannot
    tell it from what is hidden (``alike`` of the truth). A name that the case excuses (a memory that
    was there, a delay where u and y are apart) is neither right nor wrong.
    """
    truth: Mapping[str, Any] = row.get("truth", {})
    is_outside = row["study"] == "outside" or bool(truth.get("outside"))
    subject: list[str] = [] if is_outside else row["subject"]
    alike, excused = truth.get("alike", {}), truth.get("excused", [])
    ranking = [c["effect"] for c in row.get("ranking", []) if c["effect"] not in excused]
    steps = [c["effect"] for c in row.get("steps", [])]
    done = row["status"] == "done"
    findings = {finding["kind"] for finding in row.get("findings") or ()}
    first = ranking[0] if ranking else ""
    # what the records begin with is unknown: said as a finding, it is that effect by class
    if "in motion" in findings and "initial_memory" in subject and "initial_memory" not in steps:
        steps = [*steps, _UNKNOWN_PAST]
        alike = alike | {"initial_memory": [*alike.get("initial_memory", ()), _UNKNOWN_PAST]}
        first = first if len(steps) > 1 else _UNKNOWN_PAST
    exact = first in subject
    grades = {c["effect"]: c.get("grade", "found") for c in row.get("steps", [])}
    missing, by_class, additions, wrong_found = list(subject), 0, 0, 0
    for name in sorted(steps, key=lambda name: name not in subject):
        stands_for = [s for s in missing if name in alike.get(s, [])]
        if name in missing:
            missing.remove(name)
        elif stands_for:
            missing.remove(stands_for[0])
            by_class += 1
        elif name not in excused:
            additions += 1
            wrong_found += grades.get(name) == "found"
    first_by_class = not exact and any(first in alike.get(s, []) for s in subject)
    ratio = row["validation_um"] / row["noise_um"] if done else math.nan
    degraded, remarked = truth.get("degraded", ""), bool(row.get("remarked"))
    clock_stated = remarked or "clock" in findings
    stated = clock_stated if truth.get("is_clock") else remarked and degraded in _READ
    judged = {
        "study": row["study"],
        "subject": "+".join(row["subject"]) or "nothing",
        "form": "+".join(hidden["form"] for hidden in truth.get("hidden", []) if "form" in hidden),
        "number": row["number"],
        "seed": row["seed"],
        "variant": row.get("variant", ""),
        "status": row["status"],
        "protocol": truth.get("protocol", ""),
        "degraded": degraded or "none",
        "noise_um": row.get("noise_um"),
        "between_samples": _between_samples(truth),
        "findings": "+".join(sorted(findings)),
        "noticed": stated or bool(findings & set(_NOTICED_AS.get(degraded, ()))),
        "is_clock": truth.get("is_clock", degraded in _CLOCKS),
        "clock_stated": clock_stated,
        "first": first,
        "first_exact": exact,
        "first_by_class": first_by_class,
        "first_right": exact or first_by_class,
        "found_exact": done and not missing and not by_class,
        "found_by_class": done and not missing and by_class > 0,
        "found": done and not missing and not is_outside,
        "additions": additions,
        "wrong_found": wrong_found,
        "steps": "+".join(steps),
        "verdict": row.get("verdict", ""),
        "ratio": ratio,
        "within": ratio <= LARGEST_RATIO,
        "seconds": row.get("seconds"),
    }
    if done and "true_left" in row:
        return judged | judge_statements(row)
    return judged | {"all_true": None}


def judgements(rows: Sequence[Row]) -> pd.DataFrame:
    """Judge all rows but the masked ones: a line each, with the keys of :func:`judge`."""
    return pd.DataFrame([judge(row) for row in rows if row["status"] != "masked"])


def judge_statements(row: Mapping[str, Any]) -> dict[str, Any]:
    """Judge the statements of a result on its residual."""
    truth, true_left = row["truth"], row["true_left"]
    noise = truth["noise_um"]
    # what is stated counts as far as the truth itself moves with what lies between the samples
    floor = min(row.get("numerical_floor_um") or 0.0, _OF_TRUTH * truth["sampling_um"])
    clean = math.nan if true_left["clean_um"] is None else true_left["clean_um"]
    part = math.nan if true_left["by_input_um"] is None else true_left["by_input_um"]
    share = _share(clean, part, floor) if clean > math.hypot(_NOTHING * noise, floor) else None
    left = row.get("left") or {}
    share_true = hidden_true = explained_true = sampling_true = None
    if share is not None and left.get("low") is not None and left.get("high") is not None:
        share_true = bool(left["low"] - MARGIN <= share <= left["high"] + MARGIN)
    if share is not None and left.get("hidden_um") is not None:
        most = (1.0 + MARGIN) * math.hypot(left["hidden_um"], floor, _NOTHING * noise)
        hidden_true = bool(part <= most)
    if row["verdict"] in ("explained", "no missing effect") and not math.isnan(clean):
        explained_true = bool(clean <= EXPLAINED * math.hypot(noise, floor))
    if row.get("sampling"):
        sampling_true = sampling_matters(truth)
    made = [x for x in (share_true, hidden_true, explained_true, sampling_true) if x is not None]
    return {
        "clean_ratio": clean / noise,
        "true_share": share,
        "share_true": share_true,
        "hidden_true": hidden_true,
        "explained_true": explained_true,
        "sampling_true": sampling_true,
        "all_true": all(made),
    }


def _share(clean_um: float, by_input_um: float, floor_um: float) -> float:
    beyond = max(by_input_um**2 - floor_um**2, 0.0)
    return min(beyond / max(clean_um**2 - floor_um**2, 1e-300), 1.0)


def sampling_matters(truth: Mapping[str, Any]) -> bool:
    """Whether faster sampling would show more.

    Either the motion between the samples moves the displacement at them by half a noise floor, or
    something that is hidden has a time of fewer than four samples, or a mode above a fifteenth of
    the rate.
    """
    if truth["sampling_um"] > _SAMPLED * truth["noise_um"]:
        return True
    slowest = min(truth["rates_hz"])
    for effect in truth["hidden"]:
        times = [effect[key] for key in _TIMES if key in effect and effect["effect"] not in TIMED]
        if any(time * slowest < _FEW_SAMPLES for time in times):
            return True
        if effect.get("f0_hz", 0.0) > slowest / 15.0:
            return True
    return False


_OUTSIDE_RATIO = 2.0
Mask = Callable[[pd.DataFrame], "pd.Series[bool]"]


@dataclass(frozen=True)
class Target:
    """A share that is asked for, and what the study reached."""

    # the study, and the figure in words
    study: str
    asks: str
    percent: float  # share of the cases that is asked for (%)
    # cases that fulfil it, and all that it is asked of
    reached: int
    cases: int
    # of those that fulfil it, how many name another member of a class that the records of the
    # case cannot tell apart; None where a source has no classes
    by_class: int | None = None
    # effects added that were not hidden, in words; None where that is a target of its own
    falsely_added: str | None = None
    at_most: bool = False  # whether the share is a limit from above

    @property
    def reached_percent(self) -> float:
        """Share that was reached (%)."""
        return 100.0 * self.reached / self.cases if self.cases else float("nan")

    @property
    def is_met(self) -> bool:
        """Whether the share is what is asked for."""
        if self.at_most:
            return self.reached_percent <= self.percent
        return self.reached_percent >= self.percent

    @property
    def asked(self) -> str:
        """The share that is asked for, in words."""
        return f"{'at most ' if self.at_most else ''}{self.percent:g} %"

    def line(self) -> str:
        """Return the target as a line of text."""
        classes = "" if self.by_class is None else f", {self.by_class} by class"
        added = (
            "" if self.falsely_added is None else f"; effects falsely added: {self.falsely_added}"
        )
        return (
            f"{self.study}: {self.asks}: {self.reached_percent:.1f} % "
            f"({self.reached} of {self.cases}{classes}), asked {self.asked}: "
            f"{'met' if self.is_met else 'not met'}{added}"
        )


class Goal(NamedTuple):
    """A share that is asked of the cases of a study."""

    study: str
    asks: str
    percent: float
    fulfils: Mask
    by_class: str = ""  # column of the cases that fulfil it by class alone


def _silent(j: pd.DataFrame) -> pd.Series[bool]:
    return (j["additions"] == 0) & (j["status"] == "done")


def _true(values: pd.Series[bool]) -> pd.Series[bool]:
    return values == True  # noqa: E712 - None and NaN are neither


def _percent(values: pd.Series[bool]) -> float:
    return 100.0 * float(values.mean()) if len(values) else float("nan")


def _counts(names: pd.Series[str]) -> str:
    return ", ".join(f"{name or 'none'} {count}" for name, count in names.value_counts().items())


def _first_instead(part: pd.DataFrame) -> str:
    return _counts(part[~part["first_right"] & (part["first"] != "")]["first"])


def _done(part: pd.DataFrame) -> pd.DataFrame:
    return part[part["status"] == "done"]


_COLUMNS: Mapping[str, Callable[[pd.DataFrame], object]] = {
    "cases": len,
    "failed": lambda part: int((part["status"] == "failed").sum()),
    "first_percent": lambda part: _percent(part["first_right"]),
    "first_exact": lambda part: _percent(part["first_exact"]),
    "first_by_class": lambda part: _percent(part["first_by_class"]),
    "by_class": lambda part: int(part["first_by_class"].sum()),
    "found_percent": lambda part: _percent(part["found"]),
    "within_percent": lambda part: _percent(part["within"]),
    "named_exact": lambda part: _percent(part["found_exact"]),
    "named_by_class": lambda part: _percent(part["found_by_class"]),
    "explained": lambda part: _percent(part["verdict"] == "explained"),
    "wrong": lambda part: _percent(part["additions"] > 0),
    "wrong_found": lambda part: _percent(part["wrong_found"] > 0),
    "sentences_true": lambda part: _percent(_true(_done(part)["all_true"])),
    "false_additions": lambda part: int(part["additions"].sum()),
    "median_ratio": lambda part: part["ratio"].median(),
    "largest_ratio": lambda part: part["ratio"].max(),
    "median_clean": lambda part: _done(part)["clean_ratio"].median(),
    "verdicts": lambda part: _counts(part["verdict"]),
    "median_seconds": lambda part: part["seconds"].median(),
    "first_instead": _first_instead,
}
"""Columns of a table over groups of cases."""


def group_table(j: pd.DataFrame, by: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
    """Summarise judgements by some of their columns."""
    if j.empty:
        return pd.DataFrame()
    lines = [
        {
            **dict(zip(by, names, strict=True)),
            **{column: _COLUMNS[column](part) for column in columns},
        }
        for names, part in j.groupby(list(by), sort=False)
    ]
    return pd.DataFrame(lines)


_RENAMED = {"by_class": "first_by_class"}


@dataclass(frozen=True)
class Report:
    """Tables of one source of truth."""

    # of the page, and how the rows were made
    title: str
    made: str
    targets: Callable[[Sequence[Row]], list[Target]]  # targets beside what rows reached
    cases: Sequence[str]  # columns of the table of cases
    by_subject: Callable[[Sequence[Row]], pd.DataFrame]  # the table by subject
    sections: Callable[[Sequence[Row]], list[str]]  # parts of the page below the targets

    def case_table(self, rows: Sequence[Row]) -> pd.DataFrame:
        """Return the judged cases, a line each."""
        j = judgements(rows)
        return pd.DataFrame({name: j[_RENAMED.get(name, name)] for name in self.cases})

    def page(self, rows: Sequence[Row], command: str) -> str:
        """Return the page: how the rows were made, the targets, tables."""
        codes, seeds = sorted({r["code"] for r in rows}), sorted({r["seed"] for r in rows})
        written = f"seeds {', '.join(map(str, seeds))}, code {', '.join(codes)}"
        parts = [
            f"# {self.title}",
            f"Written by `python -m benchmarks.{command}`; {written}. {self.made}",
            _target_table(self.targets(rows)),
            *self.sections(rows),
        ]
        return "\n\n".join(parts) + "\n"


def _target_table(targets: Sequence[Target]) -> str:
    has_classes = any(t.by_class is not None for t in targets)
    head = ["study", "target", "asked", "reached"]
    head += ["of these by class", "met"] if has_classes else ["met", "effects falsely added"]
    lines = []
    for t in targets:
        met = "yes" if t.is_met else "no"
        reached = f"{t.reached_percent:.1f} % ({t.reached} of {t.cases})"
        last = [str(t.by_class), met] if has_classes else [met, t.falsely_added or "0"]
        lines.append([t.study, t.asks, t.asked, reached, *last])
    return table(head, lines)


# --- the virtual lab's truth ---

_INDEPENDENT_TARGETS: tuple[Goal, ...] = (
    Goal("single", "the right effect ranked first", 97.0, lambda j: j["first_right"]),
    Goal(
        "single",
        f"validation error at most {LARGEST_RATIO} x noise, the right effect added",
        90.0,
        lambda j: j["within"] & j["found"],
    ),
    Goal("pairs", "both effects found", 85.0, lambda j: j["found"]),
    Goal("pairs", "no third effect", 90.0, _silent),
    Goal(
        "none",
        "`no missing effect`",
        98.0,
        lambda j: (j["verdict"] == "no missing effect") & _silent(j),
    ),
    Goal(
        "outside",
        f"never `explained` with more than {_OUTSIDE_RATIO:g} x noise left",
        100.0,
        lambda j: (
            (j["status"] == "done")
            & ~((j["verdict"] == "explained") & (j["ratio"] > _OUTSIDE_RATIO))
        ),
    ),
)
_BY_SUBJECT = (
    "cases", "failed", "first_percent", "by_class", "found_percent", "within_percent",
    "false_additions", "median_ratio", "largest_ratio", "verdicts", "first_instead",
    "median_seconds",
)  # fmt: skip
_ABOUT_EFFECTS = ("masked", "first_percent", "by_class", "found_percent")


def independent_targets(rows: Sequence[Row]) -> list[Target]:
    """Set every target beside what was reached, the invariance study's variants one by one."""
    j = judgements(rows)
    if j.empty:
        return []
    parts = [(goal, goal.study, j[j["study"] == goal.study]) for goal in _INDEPENDENT_TARGETS]
    nothing, effect = j["subject"] == "nothing", j["subject"].isin(HIDEABLE)
    kinds = {"none": nothing, "single": effect, "outside": ~nothing & ~effect}
    changed = j["study"] == "invariance"
    for variant in j.loc[changed, "variant"].drop_duplicates():
        parts += [
            (
                goal,
                f"{goal.study}, {variant}",
                j[changed & (j["variant"] == variant) & kinds[goal.study]],
            )
            for goal in _INDEPENDENT_TARGETS
            if goal.study in kinds
        ]
    found = []
    for goal, study, part in parts:
        if len(part):
            added, on = int(part["additions"].sum()), int((part["additions"] > 0).sum())
            falsely = f"{added} on {on} of {len(part)}" if added else "0"
            reached = int(goal.fulfils(part).sum())
            asks = (study, goal.asks, goal.percent)
            found.append(Target(*asks, reached, len(part), falsely_added=falsely))
    return found


def by_subject(rows: Sequence[Row]) -> pd.DataFrame:
    """Summarise every study, variant and subject."""
    by = ["study", "variant", "subject"]
    summary = group_table(judgements(rows), by, _BY_SUBJECT)
    if not summary.empty:
        hidden = [
            (r["study"], r["variant"], "+".join(r["subject"]))
            for r in rows
            if r["status"] == "masked"
        ]
        masked = [hidden.count(names) for names in summary[by].itertuples(index=False, name=None)]
        summary.insert(4, "masked", masked)
    return summary


def agreement(rows: Sequence[Row]) -> pd.DataFrame:
    """Compare every changed data set with the plain one of the same draw."""
    j = judgements(rows)
    if j.empty:
        return pd.DataFrame()
    keys = ["subject", "number", "seed"]
    plain = j[j["variant"] == PLAIN]
    both = j[j["study"] == "invariance"].merge(plain, on=keys, suffixes=("", "_plain"))
    lines = []
    for variant, part in both.groupby("variant", sort=False):
        change = (part["ratio"] / part["ratio_plain"] - 1.0).abs()
        lines.append(
            {
                "variant": variant,
                "cases": len(part),
                "same_verdict": int((part["verdict"] == part["verdict_plain"]).sum()),
                "same_steps": int((part["steps"] == part["steps_plain"]).sum()),
                "largest_change_percent": 100.0 * change.max(),
            }
        )
    return pd.DataFrame(lines)


_WORST_FIRST = ["found_percent", "largest_ratio"]


def _independent_sections(rows: Sequence[Row]) -> list[str]:
    parts = []
    summary = by_subject(rows)
    if not summary.empty:
        for (study, variant), part in summary.groupby(["study", "variant"], sort=False):
            title = str(study) if variant == PLAIN else f"{study}: {variant}"
            empty = _ABOUT_EFFECTS if study in ("none", "outside") else ()
            worst = part.sort_values(_WORST_FIRST, ascending=[True, False], kind="stable")
            shown = worst.drop(columns=["study", "variant", *empty])
            parts += [f"## {title}", leading_rows(shown, "by_subject.csv")]
    masked = sorted({" + ".join(row["subject"]) for row in rows if row["status"] == "masked"})
    if masked:
        parts.append(f"No draw shows, beside noise or each other: {', '.join(masked)}.")
    same = agreement(rows)
    return parts if same.empty else [*parts, "## Against the plain data set", frame_table(same)]


# --- the foreign truth ---

_FOREIGN_TARGETS: tuple[Goal, ...] = (
    Goal("single", "the effect named", 95.0, lambda j: j["found"], "found_by_class"),
    Goal("double", "both effects named", 85.0, lambda j: j["found"], "found_by_class"),
    Goal("triple", "all three effects named", 75.0, lambda j: j["found"], "found_by_class"),
    Goal("none", "nothing named", 98.0, _silent),
    Goal("single", "verdict `explained`", 87.0, lambda j: j["verdict"] == "explained"),
)
_WRONG = "a wrong name that is found", "a wrong name that is found or likely"
_WRONG_ASKED: Mapping[str, tuple[float, float]] = {"all": (5.0, 8.0), "outside": (8.0, 15.0)}
"""Most of the cases with a wrong name that is found, and with one that is found or likely (%)."""
_SHARES = (
    "cases", "failed", "first_exact", "first_by_class", "named_exact", "named_by_class", "explained",
    "wrong", "wrong_found", "sentences_true", "median_ratio", "median_clean", "median_seconds", "first_instead",
)  # fmt: skip
_STATEMENTS = (
    ("share_true", f"the interval has the true share, ± {MARGIN:g}"),
    ("hidden_true", "what follows from the input is no more than what could hide"),
    ("explained_true", f"explained, at most {EXPLAINED:g} noise floors of clean error left"),
    ("sampling_true", "sample faster, where sampling matters"),
)


def foreign_targets(rows: Sequence[Row]) -> list[Target]:
    """Set every target of the second study beside what was reached."""
    return name_targets(judgements(rows))


def name_targets(j: pd.DataFrame) -> list[Target]:
    """Set the targets on names, sentences and clock faults beside what judged cases reached."""
    if j.empty:
        return []
    found = []
    for goal in _FOREIGN_TARGETS:
        part = j[j["study"] == goal.study]
        classes = int(part[goal.by_class].sum()) if goal.by_class else 0
        reached = int(goal.fulfils(part).sum())
        found.append(Target(goal.study, goal.asks, goal.percent, reached, len(part), classes))
    for study, limits in _WRONG_ASKED.items():
        part = j if study == "all" else j[j["study"] == study]
        for column, words, most in zip(("wrong_found", "additions"), _WRONG, limits, strict=True):
            wrong = int((part[column] > 0).sum())
            found.append(Target(study, words, most, wrong, len(part), 0, at_most=True))
    done = _done(j)
    true = int(_true(done["all_true"]).sum())
    faults, sound = done[done["is_clock"]], done[done["degraded"] == "none"]
    noticed, stated = int(faults["noticed"].sum()), int(sound["clock_stated"].sum())
    found += [
        Target("all", "what is said about what is left is true", 98.0, true, len(done), 0),
        Target("clock faults", "noticed", 80.0, noticed, len(faults), 0),
        Target("sound records", "a clock fault stated", 2.0, stated, len(sound), 0, at_most=True),
    ]
    return [target for target in found if target.cases]


def _statement_table(j: pd.DataFrame) -> pd.DataFrame:
    """Count, for each kind of statement, how often it was made and how often it was true."""
    lines = []
    for column, name in _STATEMENTS:
        made = j[column].dropna() if column in j else pd.Series(dtype=bool)
        lines.append({"sentence": name, "said": len(made), "true": int(_true(made).sum())})
    return pd.DataFrame(lines)


def _noticed_table(j: pd.DataFrame) -> pd.DataFrame:
    """Count, for each degradation, how often it was found in the data, and what else was."""
    return pd.DataFrame(
        [
            {
                "degraded": degraded,
                "cases": len(part),
                "noticed": int(part["noticed"].sum()),
                "findings": _counts(kinds[kinds != ""]),
            }
            for degraded, part in _done(j).groupby("degraded", sort=False)
            for kinds in [part["findings"].str.split("+").explode()]
        ]
    )


def _foreign_sections(rows: Sequence[Row]) -> list[str]:
    j, parts = judgements(rows), []

    def shares(part: pd.DataFrame, *by: str) -> str:
        return frame_table(group_table(part, by, _SHARES))

    if not j.empty:
        single, outside = (j[j["study"] == study] for study in ("single", "outside"))
        parts += ["## By study", shares(j, "study")]
        parts += ["## What is said about what is left", frame_table(_statement_table(j))]
        if not single.empty:
            parts += ["## Single effects", shares(single, "subject")]
            parts += ["## Single effects by form", shares(single, "subject", "form")]
        if not outside.empty:
            parts += ["## Outside the catalogue", shares(outside, "subject")]
        parts += ["## By protocol", shares(j, "protocol")]
        parts += ["## By degradation", shares(j, "degraded")]
        parts += ["## What was noticed about the data", frame_table(_noticed_table(j))]
        parts += [
            "## By what lies between the samples",
            "Against the noise: what the displacement at the samples changes where the command is "
            "taken as linear between them.",
            shares(j, "between_samples"),
        ]
    masked = [r["key"] for r in rows if r["status"] == "masked"]
    if masked:
        parts.append(f"Cases that no draw shows, {len(masked)} in all: {', '.join(masked)}.")
    return parts


REPORTS: Mapping[str, Report] = {
    "independent": Report(
        "Hidden effects: who finds them",
        f"Random plants of ±40 µm with {1e3 * NOISE_UM[0]:g} to "
        f"{1e3 * NOISE_UM[1]:g} nm of noise, the standard protocol, the truth integrated by "
        "`rdpi_gym/virtual_lab/independent` on a grid of 10 µs or finer. Parameters from their typical ranges, "
        f"drawn until the effect leaves {VISIBLE:g} noise floors rms on one record at least after all "
        "that a refit of the base model can take up. Ratios are validation errors of the final model "
        "over the true noise; seconds are those of one process on one thread.",
        independent_targets,
        (
            "study", "subject", "number", "seed", "variant", "status", "noise_um", "first",
            "first_right", "by_class", "found", "additions", "ratio", "within", "verdict", "steps",
            "seconds",
        ),
        by_subject,
        _independent_sections,
    ),
    "foreign": Report(
        "Foreign effects: who finds them elsewhere",
        "Plants of 1 to 100 µm with unlike plays or a density of them, effects in "
        "other forms than the catalogue's simplest, six protocols of 5,000 to 40,000 samples that the "
        "laboratory does not use itself, one to ten times the first study's noise, a quarter of the "
        "records degraded. The truth is made from turning points of the command, matrix exponentials "
        "and Runge-Kutta steps on the true command between the samples. Every effect leaves three "
        "noise floors at least on one record, after a refit of the base model and of the other effects. "
        "`by class`: the name of another effect that the records of the case cannot tell from the right "
        "one (cosine above 0.95). Seconds are of CPU, of one thread.",
        foreign_targets,
        (
            "study", "subject", "form", "number", "seed", "status", "protocol", "degraded",
            "noise_um", "between_samples", "findings", "noticed", "first", "first_exact",
            "first_by_class", "found_exact", "found_by_class", "additions", "wrong_found", "steps", "verdict",
            "ratio", "seconds", "clean_ratio", "true_share", "share_true", "hidden_true",
            "explained_true", "sampling_true", "all_true",
        ),
        lambda rows: group_table(judgements(rows), ["study", "subject"], _SHARES),
        _foreign_sections,
    ),
}  # fmt: skip
"""The tables by the module of their source of truth."""
