"""`plan_experiment`: the experiment that an advice asks for, as a command to play on the rig."""

from __future__ import annotations

from dataclasses import dataclass, field
from io import StringIO
from os import PathLike
from pathlib import Path

import numpy as np

from rdpi_gym import measurement
from rdpi_gym.diagnosis.notices import Notice
from rdpi_gym.diagnosis.words import notice_of, text_of
from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.face.data import as_dataset
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Quantities
from rdpi_gym.plant import PlantModel
from rdpi_gym.signals.experiments import PAUSE_S, standard_protocol
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import checked
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.words import joined

_MOST = 5_000_000  # samples
_SLOWEST = 0.1  # of the rate that the standard protocol gives a record
_SMALLEST = 0.02  # of the span: where δ1 is taken to be at least


@dataclass(frozen=True)
class PlannedExperiment:
    """A command to play on the rig, and to record the displacement with.

    Parameters
    ----------
    title
        Which records of the standard protocol it plays, one after the other.
    advice
        The sentence that asks for it.
    rate_hz
        Samples a second.
    t_s, u_V
        Times (s) and command (V), ``(T,)``, within the range of the commands that were recorded.
        It begins and ends at the command of that range that is nearest 0 V, and goes slowly from
        one record to the next.
    quantities
        What the data measure: the command is in the unit of their input.
    """

    title: str
    advice: str
    rate_hz: float
    t_s: Array
    u_V: Array
    quantities: Quantities = field(default_factory=Quantities)

    @property
    def seconds(self) -> float:
        """Duration (s)."""
        return self.t_s.size / self.rate_hz

    def __repr__(self) -> str:
        """The title with length, rate and range."""
        low, high = self.u_V.min(), self.u_V.max()
        return (
            f"{self.title}: {self.seconds:.3g} s at {self.rate_hz:g} samples a second, "
            f"{low:.4g} to {high:.4g} {self.quantities.input.unit}"
        )

    def csv(self) -> str:
        """Return it as CSV: ``t_s`` and ``u_V``, or the input's own unit, twelve digits a value."""
        text = StringIO()
        unit = self.quantities.input.unit.replace(",", " ")
        table = np.column_stack([self.t_s, self.u_V])
        np.savetxt(text, table, "%.12g", ",", header=f"t_s,u_{unit}", comments="")
        return text.getvalue()

    def write(self, path: PathLike[str] | str) -> Path:
        """Write :meth:`csv` to a file, whole or not at all.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        return write_atomic(Path(path), self.csv())


@checked
def plan_experiment(
    advice: Notice | str | None,
    data: measurement.Dataset | PathLike[str] | str,
    model: PlantModel | HasPlant | PathLike[str] | str,
    rate_hz: float | None = None,
) -> PlannedExperiment | None:
    """Turn the advice of a search into the command that it asks for.

    Parameters
    ----------
    advice
        Of a search, or its code or text where it names no record, effect or kind.
    data
        The records that were searched: the command stays within their range.
    model
        What was found: one record stays below its first threshold.
    rate_hz
        Samples a second; by default those that the standard protocol asks for.

    Returns
    -------
    PlannedExperiment or None
        None where the advice is no motion, or there is none.

    Raises
    ------
    InputError
        A rate that the motion cannot be played at.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", seed=1, ts_factor=4.0)
    >>> rg.plan_experiment("steps with holds", data, "P5")
    stairs: 62 s at 200 samples a second, -8.217 to 8.217 V
    """
    dataset = as_dataset(data)
    notice = notice_of(advice) if isinstance(advice, str) else advice
    if notice is None:
        return None
    if rate_hz is not None and not (np.isfinite(rate_hz) and rate_hz > 0):
        raise InputError(f"rate_hz is {rate_hz:g}; give samples a second above 0")
    if notice.again is not None and dataset.train:
        return _same_again(notice, notice.again, dataset, rate_hz)
    scale = data_scale((*dataset.train, *dataset.validation))
    first_V = max(as_plant(model).hysteresis.first_threshold_V, _SMALLEST * scale.span_V)
    names = notice.records
    slowness = scale.slowness
    protocol = standard_protocol(scale.centre_V, scale.span_V, first_V, slowness=slowness)
    known = {e.name: e for e in protocol}
    parts = [known[name] for name in names if name in known]
    if not parts:
        return None
    fastest = max(1.0 / part.ts_s for part in parts)
    rate = fastest if rate_hz is None else float(rate_hz)
    if rate < _SLOWEST * fastest:
        raise InputError(
            f"rate_hz is {rate:g}, too slow for {parts[0].name}; give {_SLOWEST * fastest:g} to {fastest:g}"
        )
    low, high = scale.centre_V - scale.span_V, scale.centre_V + scale.span_V
    played = [part.command_V(1.0 / rate) for part in parts if _fits(part.duration_s, rate)]
    rest = min(max(0.0, low), high)
    u_V = np.clip(
        _one_after_the_other(played, rest, max(round(slowness * PAUSE_S * rate), 1)), low, high
    )
    text = text_of(notice)
    return PlannedExperiment(joined(names), text, rate, *_timed(u_V, rate), dataset.quantities)


def _fits(seconds: float, rate_hz: float) -> bool:
    if seconds * rate_hz > _MOST:
        raise InputError(
            f"rate_hz is {rate_hz:g}: {seconds:g} s would be more than {_MOST:,} samples; "
            f"give {_MOST / seconds:.0f} at most"
        )
    return True


def _same_again(
    advice: Notice, times: float, data: measurement.Dataset, rate_hz: float | None
) -> PlannedExperiment:
    """Return the motion of the first record to fit, at so many times its rate."""
    record = data.train[0]
    own = 1.0 / record.ts_s
    rate = rate_hz or times * own
    seconds = float(record.t_s[-1] - record.t_s[0])
    _fits(seconds, rate)
    t_s, _ = _timed(np.zeros(round(seconds * rate) + 1), rate)
    u_V = np.interp(t_s, record.t_s - record.t_s[0], record.u_V)
    return PlannedExperiment(
        f"{record.name} again", text_of(advice), rate, t_s, u_V, data.quantities
    )


def _one_after_the_other(parts: list[Array], rest: float, pause: int) -> Array:
    """Join commands: from rest to the first, from each to the next, and back, each within a pause."""
    ends = [rest, *(float(part[-1]) for part in parts)]
    begins = [*(float(part[0]) for part in parts), rest]
    ways = [np.linspace(a, b, pause + 1)[:-1] for a, b in zip(ends, begins, strict=True)]
    pieces = [piece for pair in zip(ways, parts, strict=False) for piece in pair]
    return np.concatenate([*pieces, ways[-1], [rest]])


def _timed(u_V: Array, rate_hz: float) -> tuple[Array, Array]:
    return np.arange(u_V.size) / rate_hz, u_V
