"""Tables of the study, and each target beside what was reached."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pandas as pd

from benchmarks.hidden_effects.plants import NOISE_UM
from benchmarks.hidden_effects.scoring import LARGEST_RATIO, judgements
from benchmarks.hidden_effects.transform import PLAIN
from rdpi_gym.support.markdown import frame_table, table
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.draws import HIDEABLE, VISIBLE

_OUTSIDE_RATIO = 2.0
_ABOUT_EFFECTS = ("masked", "first_percent", "by_class", "found_percent")


@dataclass(frozen=True)
class Target:
    """A figure that is asked for, and what a study reached.

    Parameters
    ----------
    study, asks
        The study, and the figure in words.
    least_percent
        Share of the cases that is asked for (%).
    reached, cases
        Cases that fulfil it, and all.
    false_additions, falsely_added_to
        Effects added that were not hidden, and on how many of the cases.
    """

    study: str
    asks: str
    least_percent: float
    reached: int
    cases: int
    false_additions: int = 0
    falsely_added_to: int = 0

    @property
    def percent(self) -> float:
        """Share that was reached (%)."""
        return 100.0 * self.reached / self.cases if self.cases else float("nan")

    @property
    def falsely_added(self) -> str:
        """The effects added that were not hidden, in words."""
        if not self.false_additions:
            return "0"
        return f"{self.false_additions} on {self.falsely_added_to} of {self.cases}"

    @property
    def is_met(self) -> bool:
        """Whether the share is at least what is asked for."""
        return self.percent >= self.least_percent


def _right_first(j: pd.DataFrame) -> pd.Series[bool]:
    return j["first_right"]


def _no_addition(j: pd.DataFrame) -> pd.Series[bool]:
    return (j["additions"] == 0) & (j["status"] == "done")


def _silent(j: pd.DataFrame) -> pd.Series[bool]:
    return (j["verdict"] == "no missing effect") & _no_addition(j)


def _honest(j: pd.DataFrame) -> pd.Series[bool]:
    return (j["status"] == "done") & ~(
        (j["verdict"] == "explained") & (j["ratio"] > _OUTSIDE_RATIO)
    )


_TARGETS: tuple[tuple[str, str, float, Callable[[pd.DataFrame], pd.Series[bool]]], ...] = (
    ("single", "the right effect ranked first", 97.0, _right_first),
    (
        "single",
        f"validation error at most {LARGEST_RATIO} x noise, the right effect added",
        90.0,
        lambda j: j["within"] & j["found"],
    ),
    ("pairs", "both effects found", 85.0, lambda j: j["found"]),
    ("pairs", "no third effect", 90.0, _no_addition),
    ("none", "`no missing effect`", 98.0, _silent),
    (
        "outside",
        f"never `explained` with more than {_OUTSIDE_RATIO:g} x noise left",
        100.0,
        _honest,
    ),
)


def targets(rows: Sequence[Row]) -> list[Target]:
    """Set every target beside what was reached, the invariance study's variants one by one."""
    table = judgements(rows)
    if table.empty:
        return []
    found = [
        _target(table[table["study"] == study], study, asks, least, fulfils)
        for study, asks, least, fulfils in _TARGETS
    ]
    nothing, effect = table["subject"] == "nothing", table["subject"].isin(HIDEABLE)
    kinds = {"none": nothing, "single": effect, "outside": ~nothing & ~effect}
    changed = table["study"] == "invariance"
    for variant in table.loc[changed, "variant"].drop_duplicates():
        for study, asks, least, fulfils in _TARGETS:
            if study in kinds:
                part = table[changed & (table["variant"] == variant) & kinds[study]]
                found.append(_target(part, f"{study}, {variant}", asks, least, fulfils))
    return [target for target in found if target.cases]


def _target(
    part: pd.DataFrame, study: str, asks: str, least: float,
    fulfils: Callable[[pd.DataFrame], pd.Series[bool]],
) -> Target:  # fmt: skip
    if part.empty:
        return Target(study, asks, least, 0, 0)
    return Target(
        study, asks, least, int(fulfils(part).sum()), len(part),
        int(part["additions"].sum()), int((part["additions"] > 0).sum()),
    )  # fmt: skip


def by_subject(rows: Sequence[Row]) -> pd.DataFrame:
    """Summarise every study, variant and subject."""
    table = judgements(rows)
    masked = pd.Series(
        [
            (r["study"], r["variant"], "+".join(r["subject"]))
            for r in rows
            if r["status"] == "masked"
        ]
    ).value_counts()
    lines: list[dict[str, object]] = []
    if table.empty:
        return pd.DataFrame(lines)
    for names, part in table.groupby(["study", "variant", "subject"], sort=False):
        wrong = part[~part["first_right"] & (part["first"] != "")]
        lines.append(
            {
                **dict(zip(("study", "variant", "subject"), names, strict=True)),
                "cases": len(part),
                "masked": int(masked.get(names, 0)),
                "failed": int((part["status"] == "failed").sum()),
                "first_percent": 100.0 * part["first_right"].mean(),
                "by_class": int(part["by_class"].sum()),
                "found_percent": 100.0 * part["found"].mean(),
                "within_percent": 100.0 * part["within"].mean(),
                "false_additions": int(part["additions"].sum()),
                "median_ratio": part["ratio"].median(),
                "largest_ratio": part["ratio"].max(),
                "verdicts": _counts(part["verdict"]),
                "first_instead": _counts(wrong["first"]),
                "median_seconds": part["seconds"].median(),
            }
        )
    return pd.DataFrame(lines)


def agreement(rows: Sequence[Row]) -> pd.DataFrame:
    """Compare every changed data set with the plain one of the same draw."""
    table = judgements(rows)
    if table.empty:
        return pd.DataFrame()
    keys = ["subject", "number", "seed"]
    plain = table[table["variant"] == PLAIN]
    both = table[table["study"] == "invariance"].merge(plain, on=keys, suffixes=("", "_plain"))
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


def _counts(names: pd.Series[str]) -> str:
    return ", ".join(f"{name or 'none'} {count}" for name, count in names.value_counts().items())


def as_markdown(rows: Sequence[Row]) -> str:
    """Return the document: how it was made, the targets, a table for each study."""
    codes = sorted({row["code"] for row in rows})
    seeds = sorted({row["seed"] for row in rows})
    parts = [
        "# Hidden effects: who finds them",
        f"Written by `python -m benchmarks.hidden_effects`; seeds {', '.join(map(str, seeds))}, code "
        f"{', '.join(codes)}. Random plants of ±40 µm with {1e3 * NOISE_UM[0]:g} to "
        f"{1e3 * NOISE_UM[1]:g} nm of noise, the standard protocol, the truth integrated by "
        "`rdpi_gym/virtual_lab/independent` on a grid of 10 µs or finer. Parameters from their typical ranges, "
        f"drawn until the effect leaves {VISIBLE:g} noise floors rms on one record at least after all "
        "that a refit of the base model can take up. Ratios are validation errors of the final model "
        "over the true noise; seconds are those of one process on one thread.",
        table(
            ["study", "target", "asked", "reached", "met", "effects falsely added"],
            [
                [
                    t.study, t.asks, f"{t.least_percent:g} %",
                    f"{t.percent:.1f} % ({t.reached} of {t.cases})", "yes" if t.is_met else "no",
                    t.falsely_added,
                ]
                for t in targets(rows)
            ],
        ),
    ]  # fmt: skip
    summary = by_subject(rows)
    if not summary.empty:
        for (study, variant), part in summary.groupby(["study", "variant"], sort=False):
            title = str(study) if variant == PLAIN else f"{study}: {variant}"
            empty = _ABOUT_EFFECTS if study in ("none", "outside") else ()
            shown = part.drop(columns=["study", "variant", *empty])
            parts += [f"## {title}", frame_table(shown)]
    masked = sorted({" + ".join(row["subject"]) for row in rows if row["status"] == "masked"})
    if masked:
        parts.append(f"No draw shows, beside noise or each other: {', '.join(masked)}.")
    same = agreement(rows)
    if not same.empty:
        parts += [
            "## Against the plain data set",
            frame_table(same),
        ]
    return "\n\n".join(parts) + "\n"
