"""Tables of the study, and each target beside what was reached."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pandas as pd

from benchmarks.foreign_effects.scoring import judgements
from benchmarks.foreign_effects.sentences import EXPLAINED, MARGIN
from rdpi_gym.support.markdown import frame_table, table
from rdpi_gym.support.store import Row

_STUDIES = ("single", "double", "triple", "none", "outside")


@dataclass(frozen=True)
class Target:
    """A figure that is asked for, and what the study reached.

    Parameters
    ----------
    study, asks
        The study, and the figure in words.
    percent
        Share of the cases that is asked for (%).
    reached, cases
        Cases that fulfil it, and all that it is asked of.
    by_class
        Of those that fulfil it, how many name another member of a class that the records of the
        case cannot tell apart.
    at_most
        Whether the share is a limit from above.
    """

    study: str
    asks: str
    percent: float
    reached: int
    cases: int
    by_class: int = 0
    at_most: bool = False

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
        """What is asked, in words."""
        return f"{'at most ' if self.at_most else ''}{self.percent:g} %"


Counts = Callable[[pd.DataFrame], "pd.Series[bool]"]


def _never(j: pd.DataFrame) -> pd.Series[bool]:
    return pd.Series(False, index=j.index)


def _first(j: pd.DataFrame) -> pd.Series[bool]:
    return j["first_exact"] | j["first_by_class"]


def _found(j: pd.DataFrame) -> pd.Series[bool]:
    return j["found_exact"] | j["found_by_class"]


def _silent(j: pd.DataFrame) -> pd.Series[bool]:
    return (j["status"] == "done") & (j["additions"] == 0)


def _explained(j: pd.DataFrame) -> pd.Series[bool]:
    return j["verdict"] == "explained"


_TARGETS: tuple[tuple[str, str, float, Counts, Counts], ...] = (
    ("single", "the right effect ranked first", 95.0, _first, lambda j: j["first_by_class"]),
    ("double", "both effects named", 85.0, _found, lambda j: j["found_by_class"]),
    ("triple", "all three effects named", 80.0, _found, lambda j: j["found_by_class"]),
    ("none", "nothing named", 98.0, _silent, _never),
    ("single", "verdict `explained`", 85.0, _explained, _never),
)


def targets(rows: Sequence[Row]) -> list[Target]:
    """Set every target beside what was reached."""
    j = judgements(rows)
    if j.empty:
        return []
    found = []
    for study, asks, percent, fulfils, by_class in _TARGETS:
        part = j[j["study"] == study]
        if len(part):
            counts = int(fulfils(part).sum()), len(part), int(by_class(part).sum())
            found.append(Target(study, asks, percent, *counts))
    done = j[j["status"] == "done"]
    wrong = int((j["additions"] > 0).sum())
    found.append(
        Target("all", "an effect added that is not there", 5.0, wrong, len(j), at_most=True)
    )
    true = int((done["all_true"] == True).sum())  # noqa: E712
    found.append(Target("all", "what is said about what is left is true", 98.0, true, len(done)))
    return found


def shares(j: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Summarise judgements by some of their columns."""
    lines: list[dict[str, object]] = []
    if j.empty:
        return pd.DataFrame(lines)
    for names, part in j.groupby(list(by), sort=False):
        done = part[part["status"] == "done"]
        instead = part[~_first(part) & (part["first"] != "")]["first"]
        lines.append(
            {
                **dict(zip(by, names, strict=True)),
                "cases": len(part),
                "failed": int((part["status"] == "failed").sum()),
                "first_exact": _percent(part["first_exact"]),
                "first_by_class": _percent(part["first_by_class"]),
                "named_exact": _percent(part["found_exact"]),
                "named_by_class": _percent(part["found_by_class"]),
                "explained": _percent(_explained(part)),
                "wrong": _percent(part["additions"] > 0),
                "sentences_true": _percent(done["all_true"] == True),  # noqa: E712
                "median_ratio": part["ratio"].median(),
                "median_clean": done["clean_ratio"].median() if len(done) else float("nan"),
                "median_seconds": part["seconds"].median(),
                "first_instead": ", ".join(f"{n} {c}" for n, c in instead.value_counts().items()),
            }
        )
    return pd.DataFrame(lines)


def _percent(values: pd.Series[bool]) -> float:
    return 100.0 * float(values.mean()) if len(values) else float("nan")


def sentence_table(j: pd.DataFrame) -> pd.DataFrame:
    """Count, for each kind of sentence, how often it was said and how often it was true."""
    lines = []
    for column, name in (
        ("share_true", f"the interval has the true share, ± {MARGIN:g}"),
        ("hidden_true", "what follows from the input is no more than what could hide"),
        ("explained_true", f"explained, at most {EXPLAINED:g} noise floors of clean error left"),
        ("sampling_true", "sample faster, where sampling matters"),
    ):
        said = j[column].dropna() if column in j else pd.Series(dtype=bool)
        true = int((said == True).sum())  # noqa: E712
        lines.append({"sentence": name, "said": len(said), "true": true})
    return pd.DataFrame(lines)


def noticed_table(j: pd.DataFrame) -> pd.DataFrame:
    """Count, for each degradation, how often it was found in the data, and what else was."""
    lines: list[dict[str, object]] = []
    for degraded, part in j[j["status"] == "done"].groupby("degraded", sort=False):
        kinds = part["findings"].str.split("+").explode()
        counts = kinds[kinds != ""].value_counts()
        lines.append(
            {
                "degraded": degraded,
                "cases": len(part),
                "noticed": int(part["noticed"].sum()),
                "findings": ", ".join(f"{kind} {count}" for kind, count in counts.items()),
            }
        )
    return pd.DataFrame(lines)


def as_markdown(rows: Sequence[Row]) -> str:
    """Return the document: how it was made, the targets, tables by study, effect and protocol."""
    j = judgements(rows)
    codes, seeds = sorted({r["code"] for r in rows}), sorted({r["seed"] for r in rows})
    masked = [r["key"] for r in rows if r["status"] == "masked"]
    parts = [
        "# Foreign effects: who finds them elsewhere",
        f"Written by `python -m benchmarks.foreign_effects`; seeds {', '.join(map(str, seeds))}, code "
        f"{', '.join(codes)}. Plants of 1 to 100 µm with unlike plays or a density of them, effects in "
        "other forms than the catalogue's simplest, six protocols of 5,000 to 40,000 samples that the "
        "laboratory does not use itself, one to ten times the first study's noise, a quarter of the "
        "records degraded. The truth is made from turning points of the command, matrix exponentials "
        "and Runge-Kutta steps on the true command between the samples. Every effect leaves three "
        "noise floors at least on one record, after a refit of the base model and of the other effects. "
        "`by class`: the name of another effect that the records of the case cannot tell from the right "
        "one (cosine above 0.95). Seconds are of CPU, of one thread.",
        table(
            ["study", "target", "asked", "reached", "of these by class", "met"],
            [
                [
                    t.study, t.asks, t.asked,
                    f"{t.reached_percent:.1f} % ({t.reached} of {t.cases})", str(t.by_class),
                    "yes" if t.is_met else "no",
                ]
                for t in targets(rows)
            ],
        ),
    ]  # fmt: skip
    if not j.empty:
        single = j[j["study"] == "single"]
        parts += ["## By study", frame_table(shares(j, ["study"]))]
        parts += ["## What is said about what is left", frame_table(sentence_table(j))]
        if not single.empty:
            parts += ["## Single effects", frame_table(shares(single, ["subject"]))]
            parts += ["## Single effects by form", frame_table(shares(single, ["subject", "form"]))]
        outside = j[j["study"] == "outside"]
        if not outside.empty:
            parts += ["## Outside the catalogue", frame_table(shares(outside, ["subject"]))]
        parts += ["## By protocol", frame_table(shares(j, ["protocol"]))]
        parts += ["## By degradation", frame_table(shares(j, ["degraded"]))]
        parts += ["## What was noticed about the data", frame_table(noticed_table(j))]
        parts += [
            "## By what lies between the samples",
            "Against the noise: what the displacement at the samples changes where the command is "
            "taken as linear between them.",
            frame_table(shares(j, ["between_samples"])),
        ]
    if masked:
        parts.append(f"Cases that no draw shows, {len(masked)} in all: {', '.join(masked)}.")
    return "\n\n".join(parts) + "\n"
