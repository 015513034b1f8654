"""The observation of an environment: its named fields, their places, units and encodings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.plant import PlantModel, check_ts
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite, is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

_FARTHEST = 100_000  # samples ahead

ActionMode = Literal["command", "increment", "correction"]


class Field(NamedTuple):
    """One quantity of the observation.

    Parameters
    ----------
    name
        Under it the field is found, in every layout that shows it.
    scale
        Its encoding: of a displacement (µm) ``(x - centre_um) / scale_um``, of a difference of two
        ``x / scale_um``, of a command (V) its place in the range, -1 to 1.
    ahead
        Whether it stands for each sample from k to k + preview; otherwise for k alone.
    limited
        Whether it ends where the sensor's range does.
    scaling
        Its form behind :class:`~rdpi_gym.envs.wrappers.scaling.Scaling`: the value and its
        increments, the difference of the reference from it, or the value alone.
    """

    name: str
    scale: Literal["displacement", "difference", "command"]
    ahead: bool = False
    limited: bool = False
    scaling: Literal["increments", "error", "value"] = "value"


FIELDS = (
    Field("reference", "displacement", ahead=True, scaling="increments"),
    Field("measured", "displacement", limited=True, scaling="error"),
    Field("command", "command", scaling="increments"),
)
"""Every field that an observation may have. One more is an entry here and a value in :func:`field_values`."""

NAMES = tuple(field.name for field in FIELDS)
# Columns of the table for kernels, see `ObservationLayout.encoder`.
COLUMN, GAIN, ZERO, SPAN, SHIFT, LIMIT, AHEAD = range(7)
DEFAULT_FIELDS = ("reference", "measured", "command")
"""The observation of every registered id, in its order, and of layouts saved without names of fields."""


@njit(cache=True)
def field_values(ahead_um: Any, now_um: Any, measured_um: Any, command_V: Any) -> tuple[Any, ...]:
    """Values of ``FIELDS`` (µm, V) from r(k + preview), r(k), the reading and u(k), in their order.

    Every environment, on every device, takes them from here; kernels that call it are compiled anew
    where ``__pycache__`` is deleted.
    """
    return ahead_um, measured_um, command_V


@dataclass(frozen=True)
class ObservationLayout:
    """Fields of an observation with their scales, and the meaning of an action.

    The observation is ``[r(k), r(k+1) ... r(k+preview), measured(k), command(k)]``. Displacements stand as ``(x - centre_um) / scale_um``, the command as its place in
    `command_range_V`, -1 to 1. The action at step k sets the command u(k+1): its place in the range
    (``command``), its change in units of `action_scale_V` (``increment``), or what is added to a
    baseline's command, in the same unit (``correction``).

    Parameters
    ----------
    preview
        Samples of the reference shown ahead, at least 1.
    centre_um, scale_um
        Centre and unit (µm) of displacements.
    command_range_V
        Lowest and highest command (V).
    ts_s
        Sampling time (s).
    action
        How actions are read.
    action_scale_V
        Command change (V) of an action of 1, for ``increment`` and ``correction``.
    fields
        Names among ``FIELDS``, in the order of the observation; the default ones among them.
    history
        Earlier samples of each field that an environment appends, see
        :class:`~rdpi_gym.envs.wrappers.history.History`; they are no part of `size`.

    Raises
    ------
    InputError
        A value out of range, an unknown action mode or field.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> layout = ObservationLayout.for_plant(named_plant("P5"), ts_s=1e-4, preview=2)
    >>> layout.size, layout.entries[-3:], layout.columns["reference"]
    (5, ['reference(k+2)', 'measured(k)', 'command(k)'], slice(0, 3, None))
    """

    preview: int
    centre_um: float
    scale_um: float
    command_range_V: tuple[float, float]
    ts_s: float
    action: ActionMode = "command"
    action_scale_V: float = 1.0
    fields: Sequence[str] = DEFAULT_FIELDS
    history: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "ts_s", check_ts(self.ts_s))
        if not is_whole(self.preview, 1) or self.preview > _FARTHEST:
            raise InputError(
                f"preview is {quoted(self.preview)}; show a whole number of samples ahead, at least 1 "
                f"and at most {_FARTHEST}"
            )
        object.__setattr__(self, "preview", int(self.preview))
        if not isinstance(self.action, str) or self.action not in get_args(ActionMode):
            raise InputError(
                f"action {quoted(self.action)} is unknown; choose {', '.join(get_args(ActionMode))}"
            )
        if not is_finite(self.centre_um):
            raise InputError(
                f"centre_um is {quoted(self.centre_um)}; give a finite displacement (µm)"
            )
        if not is_whole(self.history, 0):
            raise InputError(
                f"history is {quoted(self.history)}; give the number of earlier samples, 0 or above"
            )
        for name in ("scale_um", "action_scale_V"):
            value = getattr(self, name)
            if not (is_finite(value) and value > 0):
                raise InputError(f"{name} is {quoted(value)}; give a finite value above 0")
        for name in ("centre_um", "scale_um", "action_scale_V"):
            object.__setattr__(self, name, float(getattr(self, name)))
        given = self.fields if isinstance(self.fields, list | tuple) else ()
        fields = tuple(name for name in given if isinstance(name, str))
        if not set(DEFAULT_FIELDS) <= set(fields) <= set(NAMES) or len(set(fields)) < len(given):
            raise InputError(
                f"fields is {quoted(self.fields)}; give names among {', '.join(NAMES)}, each once, "
                f"{', '.join(DEFAULT_FIELDS)} among them"
            )
        object.__setattr__(self, "fields", fields)

    @classmethod
    def for_plant(
        cls, plant: PlantModel, ts_s: float, preview: int = 4, **options: Any
    ) -> ObservationLayout:
        """Scale to a plant's usual reference and command range; `options` are further fields."""
        centre, amplitude = plant.reference_um
        return cls(preview, centre, amplitude, plant.command_range_V, ts_s, **options)

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> ObservationLayout:
        """Layout from the dictionary of :meth:`to_dict`."""
        return cls(**{"fields": DEFAULT_FIELDS, **document})

    def to_dict(self) -> dict[str, Any]:
        """Every parameter as JSON holds it, `fields` and `history` only where they are not the default ones."""
        document = asdict(self)
        if self.fields == DEFAULT_FIELDS:
            del document["fields"]
        if not self.history:
            del document["history"]
        return document

    @property
    def shown(self) -> list[Field]:
        """The fields, in the order of the observation."""
        known = dict(zip(NAMES, FIELDS, strict=True))
        return [known[name] for name in self.fields]

    @cached_property
    def columns(self) -> Mapping[str, slice]:
        """Columns of each field by its name."""
        found, begin = {}, 0
        for field in self.shown:
            end = begin + (self.preview + 1 if field.ahead else 1)
            found[field.name] = slice(begin, end)
            begin = end
        return found

    @cached_property
    def _encoders(self) -> dict[tuple[float, bool], Array]:
        return {}

    @cached_property
    def now(self) -> list[int]:
        """Column of each field's value of sample k."""
        return [self.columns[name].start for name in self.fields]

    def columns_of(self, other: ObservationLayout) -> list[int]:
        """Columns of this layout that show what another with no longer preview shows, in its order."""
        columns: list[int] = []
        for name, own in other.columns.items():
            if name not in self.columns:
                raise InputError(f"this layout shows {', '.join(self.fields)} and no {name}")
            begin = self.columns[name].start
            columns += range(begin, begin + own.stop - own.start)
        return columns

    @property
    def size(self) -> int:
        """Length of the observation."""
        return int(self.columns[self.fields[-1]].stop)

    @property
    def entries(self) -> list[str]:
        """Name of every number of the observation."""
        return [
            f"{name}(k+{i})" if i else f"{name}(k)"
            for name, columns in self.columns.items()
            for i in range(columns.stop - columns.start)
        ]

    def shown_now(self, observation: NDArray[Any]) -> NDArray[Any]:
        """Observations ``(B, size)`` of observations behind which their history may stand."""
        stacked = self.size + len(self.fields) * self.history
        if self.history and observation.shape[-1] == stacked:
            return np.ascontiguousarray(observation[..., : self.size])
        return observation

    def bounds(self, range_um: float) -> NDArray[np.float32]:
        """Largest magnitudes of an observation whose displacements are within `range_um` of the centre."""
        bound = np.ones(self.size, dtype=np.float32)
        for field in self.shown:
            if field.scale != "command":
                bound[self.columns[field.name]] = range_um / self.scale_um
        return bound

    def encoder(self, range_um: float, *, reciprocal: bool = False) -> Array:
        """Table for kernels, float64[len(FIELDS), 7]: the column of each field's newest value, its law, its samples ahead.

        The law is ``gain (x - zero) / span - shift``, within ±`limit`; with `reciprocal` it is
        ``(x - zero) span``, which is faster and rounds otherwise. The column is -1 where the field is
        not shown. The table is shared, and read alone.
        """
        known = self._encoders.get((range_um, reciprocal))
        if known is not None:
            return known
        low, high = self.command_range_V
        # In float32, as it is shown: the end of the range is inside it.
        limit = float(np.float32(range_um / self.scale_um))
        laws = {
            "displacement": (1.0, self.centre_um, self.scale_um, 0.0),
            "difference": (1.0, 0.0, self.scale_um, 0.0),
            "command": (2.0, low, high - low, 1.0),
        }
        if reciprocal:
            laws = {
                "displacement": (1.0, self.centre_um, 1.0 / self.scale_um, 0.0),
                "difference": (1.0, 0.0, 1.0 / self.scale_um, 0.0),
                "command": (1.0, 0.5 * (low + high), 2.0 / (high - low), 0.0),
            }
        table = np.empty((len(FIELDS), 7))
        for row, field in zip(table, FIELDS, strict=True):
            row[COLUMN] = self.columns[field.name].stop - 1 if field.name in self.fields else -1
            row[GAIN : SHIFT + 1] = laws[field.scale]
            row[LIMIT] = limit if field.limited else math.inf
            row[AHEAD] = self.preview if field.ahead else 0
        self._encoders[(range_um, reciprocal)] = table
        return table

    def encode(self, shown: Any, ends_um: Any, measured_um: Any, command_V: Any) -> list[Any]:
        """Blocks of the observation, one a field, each ``(width, B)``, in any library's arrays.

        `shown` is the encoded reference, ``(preview + 1, B)``, `ends_um` are r(k + preview) and r(k).
        """
        low, high = self.command_range_V
        values = field_values.py_func(*ends_um, measured_um, command_V)
        known = dict(zip(NAMES, values, strict=True))
        blocks = []
        for field in self.shown:
            value = known[field.name]
            if field.ahead:
                blocks.append(shown)
            elif field.scale == "command":
                blocks.append((2.0 * (value - low) / (high - low) - 1.0)[None])
            elif field.scale == "difference":
                blocks.append((value / self.scale_um)[None])
            else:
                blocks.append(((value - self.centre_um) / self.scale_um)[None])
        return blocks

    def reference_um(
        self, observation: NDArray[np.floating], samples: slice = slice(None)
    ) -> Array:
        """Reference now and ahead (µm), ``(..., preview + 1)``, of observations ``(..., size)``.

        `samples` are some of k ... k + preview: ``slice(2)`` gives r(k) and r(k+1) alone.
        """
        window = np.asarray(observation)[..., self.columns["reference"]][..., samples]
        return window.astype(np.float64) * self.scale_um + self.centre_um

    def measured_um(self, observation: NDArray[np.floating]) -> Array:
        """Measured displacement (µm), ``(...)``."""
        shown = np.asarray(observation)[..., self.columns["measured"].start]
        return np.asarray(shown.astype(np.float64) * self.scale_um + self.centre_um)

    def command_V(self, observation: NDArray[np.floating]) -> Array:
        """Command that holds now (V), ``(...)``."""
        shown = np.asarray(observation)[..., self.columns["command"].start]
        return self.place_to_V(shown.astype(np.float64))

    def place_to_V(self, place: Array) -> Array:
        """Command (V) at a place of -1 to 1 in the range."""
        low, high = self.command_range_V
        return np.asarray(low + 0.5 * (place + 1.0) * (high - low))

    def action_for(
        self, command_V: Array, observation: NDArray[np.floating]
    ) -> NDArray[np.float32]:
        """Action ``(..., 1)`` that sets a command (V), clipped to [-1, 1]; not for ``correction``."""
        if self.action == "command":
            low, high = self.command_range_V
            action = 2.0 * (command_V - low) / (high - low) - 1.0
        else:
            action = (command_V - self.command_V(observation)) / self.action_scale_V
        return np.minimum(np.maximum(action, -1.0), 1.0)[..., None].astype(np.float32)
