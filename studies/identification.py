"""Identification (Eq. 9, 10): recovery, coverage, the measured stack, and the paper's way beside ours.

    python -m studies.identification           # the tables
    python -m studies.identification --plant   # also the plant `picma` that ships

Tables go to ``studies/results/identification``: ``summary`` (what is wanted, what is reached),
``recovery``, ``coverage``, ``speed``.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

import rdpi_gym.plant
from rdpi_gym.identification import fit, validation_rmse
from rdpi_gym.identification.scale import data_scales
from rdpi_gym.identification.stack import Stack, stack_records
from rdpi_gym.measurement import Dataset, Record, example_folder, load
from rdpi_gym.plant import P10, RDPI, Plant, PlantModel, empty_state
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from studies.runner import Files, Study

Method = Literal["trf", "SLSQP"]


@dataclass(frozen=True)
class Yardstick:
    """Result of the yardstick."""

    hysteresis: RDPI  # the model
    train_rmse_um: float  # its error (µm) on the records, one offset free in each
    seconds: float  # time taken (s)
    evaluations: int  # simulations of all records


def yardstick(records: Sequence[Record], n: int = 10, method: Method = "trf") -> Yardstick:
    """Identify δ1, δ2, a_0 ... a_n as the paper did: all at once, with finite differences.

    The paper used MATLAB's constrained optimisation with δ1, δ2 > 0. Here the same problem goes to
    SciPy's trust-region least squares, which sees the errors one by one, or to its sequential
    quadratic programming, which MATLAB's toolbox is closer to; with the plant's compiled kernel, bounds on every parameter, parameters
    scaled by the start, offsets taken out exactly, and a start from the data: equal weights, half
    of the mean slope in a_0, thresholds over the whole excursion.
    """
    from scipy.optimize import least_squares, minimize

    if n < 1:
        raise InputError(f"{n} play operators; give 1 or more, for example 10")
    started = time.perf_counter()
    stack, _ = stack_records(records, None)
    start = _start(stack, n)
    lowest = np.concatenate([[1e-6, 0.0, 1e-6], np.zeros(n)])
    counted = np.count_nonzero(stack.root_weight)
    evaluations = 0

    def errors(scaled: Array) -> Array:
        nonlocal evaluations
        evaluations += 1
        return _errors(stack, scaled * start)

    def cost(scaled: Array) -> float:
        left = errors(scaled)
        return float(left @ left) / counted

    if method == "SLSQP":
        found = minimize(
            cost,
            np.ones(n + 3),
            method="SLSQP",
            bounds=[(low, None) for low in lowest],
            options={"ftol": 1e-10, "maxiter": 1000},
        ).x
    elif method == "trf":
        found = least_squares(errors, np.ones(n + 3), bounds=(lowest, np.inf), x_scale="jac").x
    else:
        raise InputError(f"method {method!r} is unknown; give trf or SLSQP")
    delta1, delta2, *weights = (found * start).tolist()
    return Yardstick(
        hysteresis=RDPI.from_law(weights, delta1, delta2),
        train_rmse_um=float(np.sqrt(cost(found))),
        seconds=time.perf_counter() - started,
        evaluations=evaluations,
    )


def _start(stack: Stack, n: int) -> Array:
    excursion, _, fastest = data_scales(stack)
    slope = float(stack.u_V @ stack.y_um) / float(stack.u_V @ stack.u_V)
    weights = np.full(n, 0.5 * slope / n)
    return np.concatenate([[excursion / (n + 1), 0.1 * excursion / fastest, 0.5 * slope], weights])


def _errors(stack: Stack, values: Array) -> Array:
    n = values.size - 3
    rows = np.concatenate([values[2:], values[0] * np.arange(1, n + 1), [values[1], 0.0, 0.0]])
    parts = []
    for r in range(stack.edges.size - 1):
        part = stack.record(r)
        y = np.empty((part.stop - part.start, 1))
        given_rate_block(
            stack.u_V[part, None], stack.rate_V_s[part, None], rows[:, None], empty_state(n, 1), y
        )
        error = (y[:, 0] - stack.y_um[part])[stack.root_weight[part] > 0]
        parts.append(error - error.mean())
    return np.concatenate(parts)


RESULTS = Path(__file__).parent / "results" / "identification"
LIBRARY = Path(rdpi_gym.plant.__file__).parent / "library"
NOISE_UM = 0.02
# frequency (Hz), amplitude (V), sampling time (s), offset (µm): three periods each
EXPERIMENTS = (
    (1.0, 40.0, 1e-3, 0.0),
    (10.0, 30.0, 2e-4, 1.0),
    (50.0, 40.0, 5e-5, -2.0),
    (100.0, 20.0, 2e-5, 3.0),
)


def records_of(model: PlantModel, noise_um: float = 0.0, seed: int = 0) -> list[Record]:
    """Sines of several frequencies, amplitudes and sampling times, from a plant at rest."""
    rng = np.random.default_rng(seed)
    records = []
    for frequency_hz, amplitude_V, ts_s, offset_um in EXPERIMENTS:
        t = np.arange(0.0, 3.0 / frequency_hz, ts_s)
        u = amplitude_V * np.sin(2 * np.pi * frequency_hz * t)
        y = Plant(model, ts_s).simulate(u) + offset_um + noise_um * rng.standard_normal(t.size)
        records.append(Record(f"{frequency_hz:g} Hz, {amplitude_V:g} V", t, u, y, ts_s=ts_s))
    return records


def true_parameters(model: PlantModel) -> dict[str, float]:
    """δ1 (V), δ2 (s) and weights (µm/V) of a plant, under the names of a fit."""
    law = model.hysteresis
    weights = {f"a_{i}": a for i, a in enumerate(law.weights)}
    return {"delta1_V": law.thresholds_V[0], "delta2_s": law.delta2_s, **weights}


def recovery() -> pd.DataFrame:
    """Fit noise-free data of P10: every parameter beside the true one."""
    found = fit(records_of(P10)).parameters
    truth = true_parameters(P10)
    return pd.DataFrame(
        {
            "parameter": list(truth),
            "true": list(truth.values()),
            "found": [found[name] for name in truth],
            "error_percent": [100 * abs(found[name] / value - 1) for name, value in truth.items()],
        }
    )


def coverage(draws: int, seed: int) -> pd.DataFrame:
    """Fit noisy data of P10 again and again: how often an interval holds the true value."""
    truth = true_parameters(P10)
    results = [fit(records_of(P10, NOISE_UM, seed + k)) for k in range(draws)]
    rows = []
    for name, value in truth.items():
        intervals = [result.intervals_95[name] for result in results]
        inside = sum(low <= value <= high for low, high in intervals)
        rows.append(
            {
                "parameter": name,
                "true": value,
                "inside_percent": 100 * inside / draws,
                "spread": float(np.std([result.parameters[name] for result in results], ddof=1)),
                "mean_standard_error": float(
                    np.mean([result.standard_errors[name] for result in results])
                ),
            }
        )
    return pd.DataFrame(rows)


def speed(
    name: str, records: Sequence[Record], validation: Sequence[Record], rounds: int
) -> pd.DataFrame:
    """Time the fit and both forms of the yardstick in turn, on the same records."""
    fit(records), yardstick(records, method="trf"), yardstick(records, method="SLSQP")  # compile
    ours, theirs, quadratic = [], [], []
    for _ in range(rounds):
        ours += [fit(records) for _ in range(5)]
        theirs.append(yardstick(records, method="trf"))
        quadratic.append(yardstick(records, method="SLSQP"))
    rows = []
    fitted = np.median([result.seconds for result in ours])
    for method, result, runs in (
        ("variable projection", ours[0].plant.hysteresis, ours),
        ("all parameters, trust region", theirs[0].hysteresis, theirs),
        ("all parameters, SQP", quadratic[0].hysteresis, quadratic),
    ):
        model = ours[0].plant.with_hysteresis(result)
        seconds = float(np.median([run.seconds for run in runs]))
        rows.append(
            {
                "data": name,
                "method": method,
                "train_rmse_um": runs[0].train_rmse_um,
                "validation_rmse_um": validation_rmse(model, validation) if validation else np.nan,
                "seconds": seconds,
                "passes": runs[0].evaluations,
                "times_the_fit": seconds / fitted,
            }
        )
    return pd.DataFrame(rows)


@contextmanager
def single_threaded() -> Iterator[ProcessPoolExecutor]:
    """A process whose linear algebra keeps to one thread.

    Matrices this small gain nothing from threads, and the yardstick loses much where other work
    shares the cores.
    """
    names = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            yield pool
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


def summary(recovered: pd.DataFrame, covered: pd.DataFrame, timed: pd.DataFrame) -> pd.DataFrame:
    """Goals of identification beside the values reached."""
    rows: list[dict[str, Any]] = []

    def add(figure: str, wanted: str, measured: float, met: bool) -> None:
        rows.append({"figure": figure, "wanted": wanted, "measured": measured, "met": met})

    worst = float(recovered["error_percent"].max())
    add("largest error of a parameter, noise-free (%)", "<= 0.1", worst, worst <= 0.1)
    inside = covered["inside_percent"]
    overall, least = float(inside.mean()), float(inside.min())
    add("true values inside 95 % intervals (%)", ">= 90", overall, overall >= 90)
    add("the same, worst parameter (%)", ">= 90", least, least >= 90)
    for name, part in timed.groupby("data", sort=False):
        ours, theirs, _ = part.to_dict("records")
        if name == "picma":
            train, held = ours["train_rmse_um"], ours["validation_rmse_um"]
            add("picma: training error (µm rms)", "<= 0.39", train, train <= 0.39)
            add("picma: validation error (µm rms)", "<= 0.38", held, held <= 0.38)
            add("picma: seconds", "<= 0.3", ours["seconds"], ours["seconds"] <= 0.3)
        faster = theirs["times_the_fit"]
        add(f"{name}: times faster than the yardstick", ">= 20", faster, faster >= 20)
        # two searches that meet the same optimum differ by rounding
        excess = round(100 * (ours["train_rmse_um"] / theirs["train_rmse_um"] - 1), 9)
        add(f"{name}: error over the yardstick's (%)", "<= 0", excess, excess <= 0)
    return pd.DataFrame(rows)


def ship_plant(folder: Path, records: Dataset) -> Path:
    """Identify the measured stack and write it as the plant `picma`.

    Its displacement counts from rest at 0 V: where a sensor has its zero is no part of a plant, and
    references start where the plant does.
    """
    model = fit(records, name="picma").plant
    centre, amplitude = model.reference_um
    shipped = replace(
        model, name="picma", offset_um=0.0, reference_um=(centre - model.offset_um, amplitude)
    )
    path: Path = shipped.save(folder / "picma.json")
    return path


def as_markdown(tables: dict[str, pd.DataFrame], draws: int, rounds: int) -> str:
    """Return the tables with what was measured and how."""
    sines = "; ".join(f"{f:g} Hz, {a:g} V, Ts = {ts:g} s" for f, a, ts, _ in EXPERIMENTS)
    words = {
        "summary": "",
        "recovery": f"Noise-free data of P10: three periods each of sines of {sines}.",
        "coverage": (
            f"The same records with {NOISE_UM:g} µm of white noise, {draws} draws: how often the "
            "95 % interval holds the true value, the spread of the estimates, and the mean of the "
            "standard errors stated."
        ),
        "speed": (
            "The yardstick is the paper's own identification, constrained least squares over all "
            "parameters at once, with the same compiled kernel. Median of "
            f"{rounds} rounds in one process, one thread, compiled code; `passes` counts "
            "simulations of the data (of thinned data too). Trust region is the stronger form and "
            "the one that counts."
        ),
    }
    parts = ["# Identification", "Written by `python -m studies.identification`."]
    for name, table in tables.items():
        parts += [f"## {name.capitalize()}", words[name], frame_table(table)]
    parts.append(
        f"NumPy {version('numpy')}, SciPy {version('scipy')}, numba {version('numba')}, "
        f"Python {platform.python_version()}, {platform.machine()}."
    )
    return "\n\n".join(part for part in parts if part) + "\n"


def _measure_all(chosen: Namespace) -> Files:
    measured = load(example_folder("picma"))
    recovered, covered = recovery(), coverage(chosen.draws, chosen.seed)
    cases: list[tuple[str, Sequence[Record], Sequence[Record]]] = [
        ("picma", measured.train, measured.validation),
        ("P10 with noise", records_of(P10, NOISE_UM, chosen.seed), ()),
    ]
    with single_threaded() as pool:
        timed = pd.concat([pool.submit(speed, *case, chosen.rounds).result() for case in cases])
    tables = {
        "summary": summary(recovered, covered, timed),
        "recovery": recovered,
        "coverage": covered,
        "speed": timed,
    }
    text = as_markdown(tables, chosen.draws, chosen.rounds)
    if chosen.plant:
        print(ship_plant(LIBRARY, measured))
    return {**{f"{name}.csv": table for name, table in tables.items()}, "identification.md": text}


def _more(options: Options) -> None:
    options.add_argument("--plant", action="store_true", help="write the plant that ships")


main = Study(
    "identification", __doc__, _measure_all, RESULTS, seed=0,
    numbers=(("--draws", 50, "noise realisations"), ("--rounds", 9, "of timing")), more=_more,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
