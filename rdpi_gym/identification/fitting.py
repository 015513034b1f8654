"""`fit`: an RDPI plant with uncertainties from measured records (Eq. 9, 10)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rdpi_gym.identification.plausibility import (
    check_motion,
    orientation,
    plausibility_warnings,
)
from rdpi_gym.identification.residuals import (
    RecordResidual,
    pooled_rmse,
    simulate_record,
    with_validated,
)
from rdpi_gym.identification.scale import Bounds, RateSpread, plant_ranges, rate_spread, set_bounds
from rdpi_gym.identification.search import Point, moving_plays, search
from rdpi_gym.identification.stack import Stack, stack_records
from rdpi_gym.identification.uncertainty import (
    Z95,
    Uncertainty,
    correlation_length,
    standard_errors,
)
from rdpi_gym.measurement import Dataset, Quantities, Record
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.parallel import in_one_thread
from rdpi_gym.support.progress import Progress, silent


@dataclass(frozen=True)
class FitResult:
    """An identified RDPI model.

    Parameters
    ----------
    plant
        The model, ready to simulate and to save; its `identification` repeats what stands here.
    parameters
        δ1 (V), δ2 (s) and the weights (µm/V): ``delta1_V``, ``delta2_s``, ``a_0`` ... ``a_n``.
    standard_errors
        Of the parameters, under the same names; infinite where the data say nothing.
    offsets_um, offset_errors_um
        Offset (µm) of each training record by name, and its standard error.
    extrema_V, extremum_errors_V
        Memory extremum (V) of each training record by name, and its standard error; the extrema
        are 0 and the errors empty where memory was not free.
    rmse_um
        Error (µm) of each record by name, one offset free; a held-out part is
        ``NAME (validation)``.
    train_rmse_um, validation_rmse_um
        Error (µm) over all training and all validation records; None without any of the latter.
    warnings
        Samples that do not count, and what the data do not determine, one sentence each.
    seconds
        Time taken (s).
    evaluations
        Passes of the search over the data.
    quantities
        What was measured, by default a voltage in V and a displacement in µm; numbers named ``_V``
        and ``_um`` are in the units of its input and output.

    Examples
    --------
    >>> import numpy as np
    >>> from rdpi_gym.identification import fit
    >>> from rdpi_gym.measurement import Record
    >>> from rdpi_gym.plant import Plant, named_plant
    >>> t = np.arange(0, 0.4, 1e-4)
    >>> u = 20 * np.sin(2 * np.pi * 5 * t) + 8 * np.sin(2 * np.pi * 60 * t)
    >>> y = Plant(named_plant("P5"), 1e-4).simulate(u)
    >>> result = fit([Record("two tones", t, u, y, ts_s=1e-4)], n=5)
    >>> round(result.parameters["delta1_V"], 4)
    1.75
    """

    plant: PlantModel
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float]
    offsets_um: Mapping[str, float]
    offset_errors_um: Mapping[str, float]
    extrema_V: Mapping[str, float]
    extremum_errors_V: Mapping[str, float]
    rmse_um: Mapping[str, float]
    train_rmse_um: float
    validation_rmse_um: float | None
    warnings: tuple[str, ...]
    seconds: float
    evaluations: int
    quantities: Quantities = field(default_factory=Quantities)

    @property
    def intervals_95(self) -> dict[str, tuple[float, float]]:
        """95 % interval of each parameter, cut at 0, below which none of them lies."""
        return {
            name: interval_95(value, self.standard_errors[name], lowest=0.0)
            for name, value in self.parameters.items()
        }


def interval_95(
    value: float, standard_error: float, lowest: float = -math.inf
) -> tuple[float, float]:
    """Return the 95 % interval of a value, cut at `lowest`.

    Examples
    --------
    >>> low, high = interval_95(1.0, 1.0, lowest=0.0)
    >>> low, round(high, 4)
    (0.0, 2.96)
    """
    return max(value - Z95 * standard_error, lowest), value + Z95 * standard_error


def finite(values: Mapping[str, float]) -> dict[str, Any]:
    """Return the values with None for those that are not finite, as JSON needs them."""
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


# Errors correlated over more samples than this are no noise.
_CORRELATED = 3.0


def delta2_warnings(
    point: Point, uncertainty: Uncertainty, spread: RateSpread, bounds: Bounds
) -> list[str]:
    """Say where the data do not determine δ2: rates alike, zero as likely, or a bound."""
    delta2, most = point.theta[1], bounds.delta2_s[1]
    found = []
    if spread.alike:
        same_rate = spread.rate_factor <= spread.pace_factor
        how = "the command keeps one" if same_rate else "every movement takes about the same time"
        found.append(
            f"δ2 is not determined by these data: all rates are alike, {how} (peak rates "
            f"{spread.slowest_V_s:.3g} to {spread.fastest_V_s:.3g} V/s), so a delay, a lag or other "
            "thresholds would explain them as well; record other frequencies before using the "
            "model there"
        )
    if delta2 <= 0.0:
        found.append("δ2 is at its bound 0: thresholds that grow with the rate do not help the fit")
    elif delta2 >= most:
        found.append(
            f"δ2 is at its bound {most:.3g} s, where no play moves even in the slowest record"
        )
    elif delta2 < Z95 * uncertainty.theta[1]:
        found.append(
            "the 95 % interval of δ2 reaches 0: its effect is lost in the error of the fit; "
            "record faster movements"
        )
    return found


def kind_warning(point: Point, moving: Sequence[bool], train: Sequence[Record]) -> list[str]:
    """Offer a kind of hysteresis where no play operator is left: the one that turns as the loops do."""
    if point.passive[1:].any() or not any(moving[1:]):
        return []
    said = "no play operator helps the fit, all weights but a_0 are 0; "
    if orientation(train):
        said += (
            "the loops turn clockwise, which play operators cannot: --core stop fits such a kind, "
        )
    return [f"{said}--core auto compares all kinds"]


def bound_warnings(
    point: Point, moving: Sequence[bool], names: Sequence[str], bounds: Bounds
) -> list[str]:
    """Name the parameters that the search left at a bound."""
    found = []
    delta1, (least, most) = point.theta[0], bounds.delta1_V
    if not least < delta1 < most:
        found.append(
            f"δ1 is at its bound {delta1:.3g} V; between {least:.3g} and {most:.3g} V thresholds "
            "show in these data"
        )
    if not point.passive[0]:
        found.append(
            "a_0 is at its bound: the displacement stands still after every turning point, as with "
            "backlash, and no compensator that divides by a_0 (Eq. 6) will work"
        )
    still = [i for i in range(1, len(moving)) if not moving[i]]
    if still:
        found.append(
            f"{_weights(still)} held at 0: the thresholds are so near to the largest excursion, or "
            "beyond it, that these plays hardly move; record larger amplitudes or take fewer plays"
        )
    zero = [i for i in range(1, len(moving)) if moving[i] and not point.passive[i]]
    if zero and point.passive[1:].any():
        found.append(f"{_weights(zero)} at the bound 0: these plays do not help the fit")
    for name, extremum in zip(names, point.theta[2:], strict=False):
        if abs(extremum) >= bounds.reach_V:
            found.append(f"the memory extremum of {name} is at its bound {extremum:.3g} V")
    return found


def correlation_warning(lengths: Iterable[float]) -> list[str]:
    """Say where the residuals are correlated from sample to sample."""
    longest = max(lengths)
    if longest < _CORRELATED:
        return []
    return [
        f"residuals are correlated over about {longest:.0f} samples, so the model is incomplete; "
        "standard errors are widened for the correlation, not for what is missing"
    ]


def _weights(indices: Sequence[int]) -> str:
    runs = np.split(np.array(indices), np.flatnonzero(np.diff(indices) > 1) + 1)
    parts = [
        f"a_{run[0]} ... a_{run[-1]}" if run.size > 2 else ", ".join(f"a_{i}" for i in run)
        for run in runs
    ]
    return f"{', '.join(parts)} {'is' if len(indices) == 1 else 'are'}"


# Plays that move (rms) less than this part of their command are told from the offset by a sliver
# of the data near the extremes; their weights would fit whatever else happens there.
MIN_MOTION = 0.1
# An error below this part of the stroke is rounding.
_ROUNDING = 1e-9
# Correlation of voltage and displacement from which on the sign of either means something.
_NO_RELATION = 0.1


@in_one_thread
def fit(
    data: Dataset | Sequence[Record],
    n: int = 10,
    *,
    rate_bandwidth_hz: float | None = None,
    free_memory: bool = False,
    min_motion: float = MIN_MOTION,
    name: str = "fit",
    progress: Progress | None = None,
) -> FitResult:
    """Identify an RDPI plant by variable projection.

    For given δ1 and δ2 the weights are non-negative least squares with a_0 > 0 and one free offset
    a record; δ1 and δ2 (and the memory) are searched outside: a grid, then Levenberg-Marquardt
    from its valleys.

    Parameters
    ----------
    data
        A data set, of which the training records are fitted and the validation records judged, or
        records, all of which are fitted. Sampling times may differ; masked samples are simulated
        and not counted; records of constant voltage are left out.
    n
        Number of play operators.
    rate_bandwidth_hz
        Cut-off (Hz) of the low-pass on the model's rate; None is the literal Eq. 5.
    free_memory
        Whether each record's initial memory is fitted: the extremum (V) it came from.
    min_motion
        Plays whose output moves (rms) less than this part of the command in every record are held
        at weight 0.
    name
        Name of the plant.
    progress
        Called as percents are done.

    Returns
    -------
    FitResult

    Raises
    ------
    InputError
        No training record whose voltage moves, nothing counted, n below 1 or more parameters than
        samples, a displacement that does not rise with the voltage.

    Examples
    --------
    >>> from rdpi_gym.plant import Plant, named_plant
    >>> t = np.arange(0, 0.4, 1e-4)
    >>> u = 20 * np.sin(2 * np.pi * 5 * t) + 8 * np.sin(2 * np.pi * 60 * t)
    >>> y = Plant(named_plant("P5"), 1e-4).simulate(u)
    >>> result = fit([Record("two tones", t, u, y, ts_s=1e-4)], n=5)
    >>> round(result.parameters["a_0"], 6), result.warnings
    (0.729, ())

    Notes
    -----
    Aljanaideh, Al Janaideh, Rakotondrabe, Eq. 8 to 10; variable projection as in Golub, Pereyra,
    SIAM J. Numer. Anal. 10 (1973).
    """
    started = time.perf_counter()
    quantities = data.quantities if isinstance(data, Dataset) else Quantities()
    train, validation, title = _records(data)
    _check(train, n, rate_bandwidth_hz, min_motion)
    check_motion(train)
    stack, means_um = stack_records(train, rate_bandwidth_hz)
    _check_gain(stack)
    bounds = set_bounds(stack, n, min_motion)
    point, evaluations = search(
        stack, n, free_memory=free_memory, bounds=bounds, progress=progress or silent
    )
    offsets = means_um + point.offsets
    model = _plant(point, offsets, train, name, rate_bandwidth_hz)

    extrema = {r.name: float(e) for r, e in zip(train, point.theta[2:], strict=True)}
    trained = [simulate_record(model, r, extrema[r.name]) for r in train]
    validated = [simulate_record(model, r, extrema.get(r.name)) for r in validation]
    lengths = [_length(left) for left in trained]
    uncertainty = standard_errors(
        point,
        [left.counted for left in trained],
        [left.rmse_um**2 for left in trained],
        lengths,
        free_memory=free_memory,
    )
    spread = rate_spread(stack)
    delta2_s = float(point.theta[1])
    determined = not spread.alike and delta2_s > Z95 * uncertainty.theta[1]
    moving = moving_plays(point.tangents[:, : n + 2, : n + 2], min_motion).tolist()
    other_kind = kind_warning(point, moving, train)
    warnings = (
        *plausibility_warnings(
            trained, delta2_s if determined else None, quantities, None if other_kind else False
        ),
        *(other_kind or delta2_warnings(point, uncertainty, spread, bounds)),
        *bound_warnings(point, moving, list(extrema) if free_memory else [], bounds),
        *correlation_warning(lengths),
    )
    names = ["delta1_V", "delta2_s", *(f"a_{i}" for i in range(n + 1))]
    errors = np.concatenate([uncertainty.theta[:2], uncertainty.weights]).tolist()
    result = FitResult(
        plant=model,
        parameters=dict(
            zip(names, [*point.theta[:2].tolist(), *point.weights.tolist()], strict=True)
        ),
        standard_errors=dict(zip(names, errors, strict=True)),
        offsets_um=dict(zip(extrema, offsets.tolist(), strict=True)),
        offset_errors_um=dict(zip(extrema, uncertainty.offsets.tolist(), strict=True)),
        extrema_V=extrema,
        extremum_errors_V=dict(zip(extrema, uncertainty.theta[2:].tolist(), strict=True))
        if free_memory
        else {},
        rmse_um=with_validated({t.record.name: t.rmse_um for t in trained}, validated),
        train_rmse_um=pooled_rmse(trained),
        validation_rmse_um=pooled_rmse(validated) if validated else None,
        warnings=tuple(quantities.said(w, [r.name for r in train]) for w in warnings),
        quantities=quantities,
        seconds=time.perf_counter() - started,
        evaluations=evaluations,
    )
    return replace(result, plant=_documented(result, title, spread))


def _records(data: Dataset | Sequence[Record]) -> tuple[list[Record], list[Record], str]:
    if isinstance(data, Dataset):
        return list(data.train), list(data.validation), data.title
    moving = [record for record in data if not record.is_quiet]
    return moving, [], ", ".join(record.name for record in moving)


def _check(
    train: Sequence[Record], n: int, rate_bandwidth_hz: float | None, min_motion: float
) -> None:
    names = [record.name for record in train]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two records are named {name!r}; give each record its own name")
    if n < 1:
        raise InputError(f"{n} play operators; give 1 or more, for example 10")
    if rate_bandwidth_hz is not None and not (
        math.isfinite(rate_bandwidth_hz) and rate_bandwidth_hz > 0
    ):
        raise InputError(
            f"rate_bandwidth_hz is {rate_bandwidth_hz}; give a frequency above 0 Hz, or None for the literal rate"
        )
    if not 0 <= min_motion < 1:
        raise InputError(
            f"min_motion is {min_motion}; give a part of the command from 0 to below 1"
        )
    counted = sum(int(np.count_nonzero(record.error_mask)) for record in train)
    if 0 < counted < 2 * (n + 3 + len(train)):
        raise InputError(
            f"{counted} samples count for {n + 3 + len(train)} parameters; "
            "give twice as many samples as parameters, or fewer play operators"
        )


def _check_gain(stack: Stack) -> None:
    # y is less each record's mean, so that this has the sign of the mean slope
    slope = float(stack.root_weight * stack.u_V @ stack.y_um)
    if slope > 0:
        return
    parts = [stack.record(r) for r in range(len(stack.edges) - 1)]
    swing = sum(float(np.sum((stack.u_V[part] - stack.u_V[part].mean()) ** 2)) for part in parts)
    correlation = slope / math.sqrt(swing * float(stack.y_um @ stack.y_um))
    if correlation > -_NO_RELATION:
        raise InputError(
            f"the displacement does not follow the voltage: their correlation is {correlation:.2g}; "
            "check the columns and the sensor"
        )
    raise InputError(
        "the displacement falls where the voltage rises, unlike the model's; "
        "change the sign of one of the two columns"
    )


def _plant(
    point: Point,
    offsets: Array,
    train: Sequence[Record],
    name: str,
    rate_bandwidth_hz: float | None,
) -> PlantModel:
    counted = [np.count_nonzero(record.error_mask) for record in train]
    command_range_V, reference_um = plant_ranges(train)
    return PlantModel(
        RDPI.from_law(
            point.weights.tolist(), float(point.theta[0]), float(point.theta[1]), rate_bandwidth_hz
        ),
        name,
        command_range_V=command_range_V,
        reference_um=reference_um,
        offset_um=float(np.average(offsets, weights=counted)),
    )


def _length(left: RecordResidual) -> float:
    stroke_um = float(np.ptp(left.record.y_um[left.record.error_mask]))
    if left.rmse_um < _ROUNDING * stroke_um:
        return 1.0
    return correlation_length(left.error_um, left.record.error_mask)


def _documented(result: FitResult, title: str, spread: RateSpread) -> PlantModel:
    identification = {
        "records": list(result.offsets_um),
        "standard_errors": finite(result.standard_errors),
        "offsets_um": dict(result.offsets_um),
        "memory_extrema_V": dict(result.extrema_V),
        "slowest_peak_rate_V_s": spread.slowest_V_s,
        "fastest_peak_rate_V_s": spread.fastest_V_s,
        "rmse_um": dict(result.rmse_um),
        "train_rmse_um": result.train_rmse_um,
        "validation_rmse_um": result.validation_rmse_um,
        "warnings": list(result.warnings),
    }
    if not result.quantities.are_standard:
        identification["quantities"] = result.quantities.to_dict()
    note = " ".join([f"identified from {title}.", *(f"{w}." for w in result.warnings[:1])])
    return replace(result.plant, note=note, identification=identification)
