"""The search on plants of both studies, on measured and on long records, beside stored rows of the one before.

    python -m studies.one_law --plants 40 --seed 11
    RDPI_DATA=... python -m studies.one_law --part measured
    python -m studies.one_law --part long

Plants are drawn over the strata of the study of foreign effects and, a fifth of them, of the study
of hidden effects; times are processor time. Rows of the search before this one are those of the same
command at commit ad1f42e6, and are not made again.
"""

from __future__ import annotations

import resource
import sys
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from benchmarks.effect_discovery.cases import Case, Source, run_case
from benchmarks.effect_discovery.foreign import FOREIGN
from benchmarks.effect_discovery.independent import INDEPENDENT
from benchmarks.effect_discovery.report import judge
from benchmarks.rows import ROWS_FILE, run_rows, stored_rows
from rdpi_gym.diagnosis.search.discover import Inspection, discover
from rdpi_gym.diagnosis.suitability import falls
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.residuals import centred_residual
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record, Role
from rdpi_gym.plant import CORES, P10, Plant, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.plant.effects.creep import Creep
from rdpi_gym.plant.effects.sensor_lag import SensorLag
from rdpi_gym.support.command import Options
from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.store import Row, named_rows
from studies.measured_effects import SETS, WAYS, fit_by_hand, peak_to_peak, splits
from studies.runner import Files, Study, names_of

RESULTS = Path(__file__).parent / "results" / "one_law"
BEFORE, BEAM = "before", "beam"
SHARES: Mapping[str, tuple[Source, str, float]] = {
    "single": (FOREIGN, "single", 0.3),
    "double": (FOREIGN, "double", 0.2),
    "triple": (FOREIGN, "triple", 0.1),
    "nothing": (FOREIGN, "none", 0.1),
    "outside": (FOREIGN, "outside", 0.1),
    "first study, single": (INDEPENDENT, "single", 0.1),
    "first study, pairs": (INDEPENDENT, "pairs", 0.1),
}
"""Strata: source, its study, and share of the plants."""


@dataclass(frozen=True)
class Unit:
    """One plant."""

    stratum: str
    case: Case

    @property
    def key(self) -> str:
        """Name of its row."""
        return f"{BEAM}/{self.stratum}/{self.case.key}"


def units(plants: int, seed: int) -> list[Unit]:
    """List the plants of all strata; any beginning of them is a fair sample."""
    chosen: list[tuple[float, Unit]] = []
    for stratum, (source, study, share) in SHARES.items():
        count = max(round(share * plants), 1)
        cases = source.cases([study], count, seed, source.effects)
        step = max(len(cases) // count, 1)  # of the first study every subject has so many
        own = cases[::step][:count]
        chosen += [((k + 0.5) / count, Unit(stratum, case)) for k, case in enumerate(own)]
    return [unit for _, unit in sorted(chosen, key=lambda each: each[0])]


def run_unit(unit: Unit, code: str) -> Row:
    """Search the records of one plant, timed in processor time."""
    source = replace(SHARES[unit.stratum][0], clock=time.process_time)
    row = run_case(unit.case, source)
    return row | {"key": unit.key, "engine": BEAM, "stratum": unit.stratum, "code": code}


ROOMS = ("plant", "measurement", "identification", "diagnosis")


def _rows(chosen: Namespace) -> list[Row]:
    asked = units(chosen.plants, chosen.seed)
    before = named_rows(chosen.out / BEFORE / ROWS_FILE).rows
    keys = [f"{BEFORE}/{unit.key.partition('/')[2]}" for unit in asked]
    known = [before[key] for key in keys if key in before]
    if chosen.tables:
        return [*known, *stored_rows(asked, chosen.out / BEAM)]
    code = fingerprint(code_parts(room_files(*ROOMS)))
    with progress_bar() as show:
        run = partial(run_unit, code=code)
        return [*known, *run_rows(asked, chosen.out / BEAM, run, code, chosen.jobs, show)]


def judged(row: Row) -> dict[str, Any]:
    """Judge a row as the studies do, with the grades of wrong names."""
    verdict = judge(row)
    right = set(row["subject"]) | set(row.get("truth", {}).get("excused", ()))
    for name in row["subject"]:
        right |= set(row.get("truth", {}).get("alike", {}).get(name, ()))
    wrong = [s for s in row.get("steps", ()) if s["effect"] not in right]
    found = [s for s in wrong if s.get("grade", "found") == "found"]
    return {
        "plant": _plant(row), "engine": row["engine"], "stratum": row["stratum"], "subject": verdict["subject"],
        "form": verdict["form"], "degraded": verdict["degraded"], "status": row["status"],
        "named": verdict["steps"], "exact": bool(verdict["found_exact"]),
        "found": bool(verdict["found"]), "first_right": bool(verdict["first_right"]),
        "wrong": bool(wrong), "wrong_found": bool(found), "ratio": verdict["ratio"],
        "core": row.get("core", ""), "seconds": row.get("seconds"),
    }  # fmt: skip


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Shares by stratum and search (%), median processor times (s), and the median of their ratios."""
    engines = [engine for engine in (BEFORE, BEAM) if engine in set(rows["engine"])]
    wide = rows.pivot_table(index=["stratum", "plant"], columns="engine", values="seconds")
    lines = []
    for stratum in (*dict.fromkeys(rows["stratum"]), "all"):
        part = rows if stratum == "all" else rows[rows["stratum"] == stratum]
        times = wide if stratum == "all" else wide.loc[[stratum]]
        line: dict[str, Any] = {"stratum": stratum, "plants": len(part) // len(engines)}
        for name in ("exact", "found", "wrong", "wrong_found"):
            for engine in engines:
                own = part[part["engine"] == engine]
                line[f"{name}, {engine}"] = round(100.0 * float(own[name].mean()), 1)
        line |= {
            f"median s, {engine}": round(float(times[engine].median()), 1) for engine in engines
        }
        if len(engines) > 1:
            line["time ratio"] = round(float((times[BEAM] / times[BEFORE]).median()), 2)
        lines.append(line)
    return pd.DataFrame(lines)


@dataclass(frozen=True)
class Trial:
    """One search of records that are not drawn from a study."""

    part: Literal["measured", "long"]
    name: str
    way: str  # Split of measured records; number of samples of long ones

    @property
    def key(self) -> str:
        """Name of its row."""
        return f"{BEAM}/{self.name}/{self.way}"

    def dataset(self) -> Dataset:
        """Return the records."""
        if self.part == "long":
            return LONG[self.name](int(self.way))
        dataset = next(each for each in SETS if each.name == self.name).dataset
        assert dataset is not None
        return splits(dataset)[self.way]


def run_trial(trial: Trial, code: str) -> Row:
    """Search the records; a failure is a row too."""
    row: Row = {"key": trial.key, "code": code, "name": trial.name, "way": trial.way}
    dataset = trial.dataset()
    began = _processor_s()
    try:
        result = discover(dataset)
    except Exception as error:  # one failure must not end the study, and it counts
        return row | {"status": "failed", "error": f"{type(error).__name__}: {error}"}
    variant = Variant(result.plant.hysteresis, result.plant.effects)
    row |= {"status": "done", "seconds": _processor_s() - began, "core": result.core.kind}
    row["named"] = [f"{each.effect} {result.grade(each)}" for each in result.named]
    assert result.probabilities is not None
    row |= {"something_else": result.probabilities.other, "floor_um": result.noise_floor_um}
    row |= {"base_um": result.base.validation_rmse_um}
    row["error_um"] = result.final.validation_rmse_um
    row["explained"] = [round(_explained(variant, record), 3) for record in dataset.test]
    if any(finding.kind == "exchanged" for finding in result.findings):
        refit = Inspection(dataset).refit(result.plant)
        row["as_given_um"] = refit.errors.validation_rmse_um
    if trial.part == "measured":
        branches = next(each for each in SETS if each.name == trial.name).branches
        row["by_hand_um"] = fit_by_hand(dataset.train, dataset.validation, branches)
        row["span_um"] = peak_to_peak(dataset.validation)
    return row


def _processor_s() -> float:
    """Processor time of this process and of those that it has waited for (s)."""
    owners = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    return sum(sum(resource.getrusage(owner)[:2]) for owner in owners)


def _explained(variant: Variant[Core], record: Record) -> float:
    """Share of the variance of a record that a model explains (%); where y falls as u rises, it is of -y."""
    sign = -1.0 if falls([record]) else 1.0
    left = centred_residual(variant, replace(record, y_um=sign * record.y_um))
    return 100.0 * (1.0 - float(np.mean(left**2) / np.var(record.y_um[record.error_mask])))


def _held(names: Sequence[Sequence[str]]) -> str:
    """Say which names all splits have, and how many have each of the others."""
    sets = [{name.split()[0] for name in each} for each in names]
    counts = Counter(sorted(name for each in sets for name in each))
    every = [name for name, count in counts.items() if count == len(sets)]
    some = [f"{name} {count}/{len(sets)}" for name, count in counts.items() if count < len(sets)]
    return ", ".join([*every, *some]) or "nothing"


def _error(row: Row) -> str:
    """Say the error of a row, with that in the roles given where the search exchanged them."""
    given = f" ({row['as_given_um']:.3g})" if "as_given_um" in row else ""
    return f"{row['error_um']:.3g}{given}"


def measured_table(rows: Sequence[Row]) -> pd.DataFrame:
    """One line a set: as published, and how the names held over the splits."""
    lines = []
    for known in SETS:
        own = [r for r in rows if r["name"] == known.name]
        done = [r for r in own if r["status"] == "done"]
        if not done:
            continue
        first = done[0]
        lines.append({
            "records": known.name, "kind": first["core"],
            "named as published": " + ".join(first["named"]) or "nothing",
            "something else %": None if first["something_else"] is None else round(100 * first["something_else"]),
            "error": _error(first),
            "of peak to peak %": f"{100 * first['error_um'] / first['span_um']:.2g}",
            "by hand": f"{first['by_hand_um']:.3g}", "published": known.published,
            "test records explained %": " ".join(f"{e:.0f}" for e in first["explained"]),
            "names over the splits done": f"{_held([r['named'] for r in done])} ({len(done)} of {len(WAYS)})",
            "error over the splits": " ".join(map(_error, done)),
            "processor s": " ".join(f"{r['seconds']:.0f}" for r in done),
        })  # fmt: skip
    return pd.DataFrame(lines)


def _records(
    model: PlantModel[Any], samples: int, count: int = 3, seconds: float = 30.0
) -> Dataset:
    """Records of twelve sines each in bands of their own, noise of 10 nm, the last to judge by."""
    rng, records = np.random.default_rng(0), []
    each = samples // count
    ts_s = seconds / samples
    for k in range(count):
        t = np.arange(each, dtype=np.float64) * ts_s
        u = np.zeros(each)
        for f in np.geomspace(4.5 * 3.0**k / seconds, 150.0 * 3.0**k / seconds, 12):
            u += np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 2.0 * np.pi)) / f**0.3
        u = 60.0 * (u - u[0]) / float(np.max(np.abs(u - u[0])))
        y = Plant(model, ts_s).simulate(u) + 0.01 * rng.normal(size=each)
        role: Role = "validation" if k == count - 1 else "train"
        records.append(Record(f"sines-{k}", t, np.asarray(u), np.asarray(y), ts_s=ts_s, role=role))
    return Dataset("records of a plant with something hidden", tuple(records))


def _hidden(*effects: Effect) -> PlantModel[Any]:
    return replace(P10, effects=effects)


def _bouc_wen() -> PlantModel[Any]:
    core = CORES["bouc_wen"].starts(data_scale(_records(P10, 900).records))[0]
    return PlantModel(core, "outside", P10.command_range_V, P10.reference_um)


LONG: Mapping[str, Callable[[int], Dataset]] = {
    "two effects": lambda n: _records(_hidden(Creep(gain_per_decade=0.02), SensorLag(time_constant_s=1e-3)), n),
    "at its floor": lambda n: _records(P10, n),
    "Bouc-Wen": lambda n: _records(_bouc_wen(), n),
    "two records": lambda n: _records(_hidden(Creep(gain_per_decade=0.02)), n, 2, 100.0),
}  # fmt: skip
"""Records by what is hidden, for a number of samples."""
LONG_TRIALS = (
    ("two records", 3_600), ("at its floor", 100_000), ("two effects", 50_000), ("Bouc-Wen", 50_000),
    ("two effects", 100_000), ("two effects", 1_000_000),
)  # fmt: skip


def _trial_rows(chosen: Namespace, part: Literal["measured", "long"]) -> list[Row]:
    if part == "long":
        names = [(name, str(samples)) for name, samples in LONG_TRIALS]
    else:
        known = [each.name for each in SETS]
        wanted = names_of(
            "set of measured records", [n for n in chosen.records.split(",") if n], known
        )
        there = [each.name for each in SETS if each.name in wanted and each.dataset is not None]
        names = [(name, way) for way in WAYS for name in there]
    asked = [Trial(part, name, way) for name, way in names]
    if chosen.tables:
        return stored_rows(asked, chosen.out / part)
    code = fingerprint(code_parts(room_files(*ROOMS)))
    with progress_bar() as show:
        return run_rows(
            asked, chosen.out / part, partial(run_trial, code=code), code, chosen.jobs, show
        )


def _trial_files(chosen: Namespace, part: Literal["measured", "long"]) -> Files:
    rows = _trial_rows(chosen, part)
    if part == "measured":
        frame = measured_table(rows)
        title = (
            "Measured records, each split in four ways; by hand: a cubic curve, thirty plays or stops and a "
            "rate by linear least squares. Errors in the unit of the output, of the records held out; in brackets, "
            "where the search exchanged the records to fit and those held out, of the same effects refitted in the "
            "roles given."
        )
    else:
        columns = (
            "name",
            "way",
            "status",
            "core",
            "named",
            "error_um",
            "floor_um",
            "seconds",
        )
        frame = pd.DataFrame([{c: row.get(c) for c in columns} for row in rows])
        frame = frame.rename(columns={"way": "samples", "seconds": "processor s"})
        title = "Long records and short ones: what is hidden, named, left (µm), and processor time."
    command = f"python -m studies.one_law --part {part}" + (
        f" --records {chosen.records}" if chosen.records else ""
    )
    text = f"# {title.partition(',')[0].partition(':')[0]}\n\nMade by `{command}`. {title}\n\n"
    return {
        f"{part}.csv": frame,
        f"{part}.md": f"{text}{frame_table(frame, digits=3, rule='plain')}\n",
    }


def _plant(row: Row) -> str:
    return str(row["key"]).partition("/")[2]


def _more(options: Options) -> None:
    options.add_argument(
        "--tables",
        action="store_true",
        help="write the tables of the rows that are there; run nothing",
    )
    options.add_argument(
        "--part", choices=("plants", "measured", "long"), default="plants",
        help="drawn plants, measured records on four splits, or long records (default: plants)",
    )  # fmt: skip
    options.add_argument("--records", default="", help="sets of measured records (default: all)")


def _files(chosen: Namespace) -> Files:
    if chosen.part != "plants":
        return _trial_files(chosen, chosen.part)
    rows = _rows(chosen)
    plants = [{_plant(r) for r in rows if r["engine"] == engine} for engine in (BEFORE, BEAM)]
    both = set.intersection(*(each for each in plants if each))
    frame = pd.DataFrame([judged(r) for r in rows if r["status"] == "done" and _plant(r) in both])
    text = (
        "# The search on drawn plants\n\n"
        f"Made by `python -m studies.one_law --plants {chosen.plants} --seed {chosen.seed}`, {len(both)} "
        "plants, shares in per cent, processor time in seconds. Right: *found* or *likely*. The search "
        "before this one is that of commit ad1f42e6 on the same plants.\n\n"
        f"{frame_table(table(frame), digits=None, rule='plain')}\n"
    )
    files: dict[str, str | bytes | pd.DataFrame] = {"plants.csv": frame}
    return files | {"one_law.md": text}


main = Study(
    "one_law", __doc__, _files, RESULTS, seed=11, jobs=1, csv="%.6g",
    numbers=(("--plants", 40, "drawn over the strata"),), more=_more,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
