"""Tasks: their declaration, their draws of plants, references and noise, and changes within an episode."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from rdpi_gym.envs.draw_laws import Ageing, ColouredNoise, DrawLaw, NoiseLaw, Schedule
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.limits import Limits
from rdpi_gym.envs.tracking import NoiseSource, TrackingTask
from rdpi_gym.envs.truth import (
    ReferenceChoice,
    ReferenceSource,
    draw_truth,
    frequency_at,
)
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


class ChangingPlant(Plant):
    """Plants that become others at certain samples, behind a converter of finite resolution.

    `later` says for each lane what it becomes, by the sample of the episode. Displacements and
    velocities go on where a mode moves, see :meth:`Plant.retune`. `command_step_V` is the smallest
    step (V) of the converter; 0: none.
    """

    def __init__(
        self,
        models: Sequence[PlantModel],
        ts_s: float,
        later: Sequence[Mapping[int, PlantModel]],
        command_step_V: float = 0.0,
    ) -> None:
        self._first, self._later = tuple(models), tuple(later)
        self._turns = frozenset(sample for each in later for sample in each)
        self._step_V, self._sample = command_step_V, 0
        self._is_as_begun = True
        super().__init__(models, ts_s)

    def reset(self, *args: object, **options: object) -> None:
        """Begin an episode, as the plants that were there at first; see :meth:`Plant.reset`."""
        if not self._is_as_begun:
            self.retune(self._first)
        self._sample, self._is_as_begun = 0, True
        super().reset(*args, **options)  # type: ignore[arg-type]  # handed on as they came

    def step(self, u_V: Array) -> Array:
        """Advance one sample; see :meth:`Plant.step`."""
        if self._sample in self._turns:
            pairs = zip(self.models, self._later, strict=True)
            self.retune([later.get(self._sample, model) for model, later in pairs])
            self._is_as_begun = False
        self._sample += 1
        if self._step_V:
            u_V = np.rint(u_V / self._step_V) * self._step_V
        return super().step(u_V)


Split = Literal["training", "validation", "test"]
PUBLIC_SEED = 2026
"""Seed of the test draws, unless a leaderboard keeps one of its own."""
SAMPLES, FIRST = 2500, 1000
"""Samples of every episode, and the first of them that is scored."""

REFERENCES: tuple[ReferenceChoice, ...] = (
    "sine",
    "sine",
    {"signal": "triangle", "frequency_hz": 20.0},
    {"signal": "multisine", "frequency_hz": 10.0, "lines": 10},
    {"signal": "raster", "frequency_hz": 20.0},
    {"signal": "nested-loops", "frequency_hz": 20.0},
)
"""Two sines of frequencies that are drawn, and one each of what scans and laboratories drive."""

# Begins the entropy of every draw: no training of agents draws from it.
_KEY = 2**34 + 12
_WORDS: Mapping[str, int] = {name: i for i, name in enumerate(get_args(Split), start=1)}


@dataclass(frozen=True)
class Draw:
    """One plant of a task with every reference: ``references_um`` (µm), ``(K, R)``, one a column.

    `later` is what the plant becomes, by the sample of the episode; `belief` what a controller is
    told: the nominal plant, with its effects. Each of the sensor's `noises`, one for each reference,
    serves one episode.
    """

    number: int
    truth: PlantModel
    later: Mapping[int, PlantModel]
    belief: PlantModel
    names: tuple[str, ...]
    references_um: Array
    noises: tuple[NoiseSource, ...]


@dataclass(frozen=True)
class StageTask:
    """A stage with its references, what is believed of it, and the protocol of a score.

    Parameters
    ----------
    name
        Short name; the id is made of it, see :attr:`id`.
    title
        In words.
    about
        One paragraph: what is hard here, and what it stands for.
    nominals
        Plants as they were designed, sensor and effects included; what is drawn is drawn about
        them, in turn.
    beliefs
        What controllers are told in place of each; empty: the nominal plants themselves.
    hidden
        What an observation does not show, so that the task is no Markov process.
    history
        Earlier samples in an observation of the id.
    references
        As the environment takes them; every plant meets all of them.
    frequency_hz
        Lowest and highest frequency (Hz) of those that state none.
    amplitude_share
        Amplitude over that of the references that suit the plant's stroke.
    ts_s
        Sampling time (s).
    preview
        Samples of the reference that are shown ahead.
    smooth_start_s
        Of the references (s).
    samples, first
        Of an episode: how many, and the first that is scored.
    half_width, effects_half_width
        Relative half-widths of the hysteresis' numbers and of the effects' parameters.
    noise
        What the sensor adds.
    command_bits
        Of the converter over the command's range; None: no step.
    ageing
        What a life does to a plant; each draw has lived a share of it, drawn uniformly.
    schedule
        What happens within an episode.
    rate_share, ringing_share, stroke_share
        Limits of safe operation: change of the command in a sample over its range; second difference
        of the error in a sample, and farthest displacement, over the references' amplitude.
    rank
        Place in :data:`~rdpi_gym.envs.tasks.TASKS`, from easy to hard.

    Examples
    --------
    >>> from rdpi_gym.envs.tasks import TASKS
    >>> one = TASKS["Stage"].draw("test", number=3, seed=7)
    >>> one.references_um.shape, one.truth == TASKS["Stage"].draw("training", 3, 7).truth
    ((2500, 6), False)
    """

    name: str
    title: str
    about: str
    nominals: tuple[PlantModel, ...]
    hidden: str
    beliefs: tuple[PlantModel, ...] = ()
    history: int = 0
    references: tuple[ReferenceChoice, ...] = REFERENCES
    frequency_hz: tuple[float, float] = (20.0, 100.0)
    amplitude_share: float = 1.0
    ts_s: float = 1e-4
    preview: int = 8
    smooth_start_s: float = 0.05
    samples: int = SAMPLES
    first: int = FIRST
    half_width: float = 0.05
    effects_half_width: float = 0.4
    noise: NoiseLaw | None = None
    command_bits: int | None = None
    ageing: Ageing | None = None
    schedule: Schedule | None = None
    rate_share: float = 0.125
    ringing_share: float = 0.02
    stroke_share: float = 1.25
    rank: int = 1000

    @property
    def id(self) -> str:
        """Name for ``gymnasium.make``."""
        return f"rdpi_gym/Piezo{self.name}-v0"

    @property
    def limits(self) -> Limits:
        """Limits of safe operation, whose costs the environment reports."""
        low, high = self.nominals[0].command_range_V
        amplitude_um = self.layout().scale_um
        return Limits(
            self.rate_share * (high - low) / self.ts_s,
            self.ringing_share * amplitude_um / self.ts_s**2,
            self.stroke_share * amplitude_um,
        )

    @property
    def is_markov(self) -> bool:
        """False: no task here shows the memory of its hysteresis."""
        return not self.hidden

    @property
    def changes(self) -> bool:
        """Whether draws go beyond numbers about one nominal plant."""
        return self.law != DrawLaw(self.nominals[:1])

    @property
    def law(self) -> DrawLaw:
        """Laws of a draw beyond numbers about one nominal plant."""
        return DrawLaw(self.nominals, self.noise, self.command_step_V, self.ageing, self.schedule)

    @property
    def noise_um(self) -> float:
        """Root mean square (µm) of what the sensor adds, its resolution aside."""
        stated: float = self.nominals[0].sensor.noise_um
        return stated * (1.0 if self.noise is None else self.noise.rms)

    def nominal(self, number: int = 0) -> PlantModel:
        """Return the nominal plant of a draw."""
        return self.nominals[number % len(self.nominals)]

    def belief(self, number: int = 0) -> PlantModel:
        """Return what a controller is told of a draw's plant, effects included."""
        return (self.beliefs or self.nominals)[number % len(self.nominals)]

    def layout(self, number: int = 0, **options: Any) -> ObservationLayout:
        """Return what is shown of a draw's plant; `options` are further fields of the layout."""
        fields = {"preview": self.preview, **options}
        centre, amplitude = self.nominal(number).reference_um
        return ObservationLayout(
            centre_um=centre,
            scale_um=amplitude * self.amplitude_share,
            command_range_V=self.nominal(number).command_range_V,
            ts_s=self.ts_s,
            **fields,
        )

    def truth(
        self, rng: np.random.Generator, number: int = 0
    ) -> tuple[PlantModel, Mapping[int, PlantModel]]:
        """Draw a plant, and what it becomes within an episode."""
        return draw_truth(self.law, self.half_width, self.effects_half_width, rng, number)

    def noise_of(self, rng: np.random.Generator) -> NoiseSource:
        """Return the noise of an episode."""
        return rng if self.noise is None else ColouredNoise(self.noise, self.ts_s, rng)

    @property
    def command_step_V(self) -> float:
        """Smallest step of the command (V); 0: none."""
        low, high = self.nominals[0].command_range_V
        return 0.0 if self.command_bits is None else (high - low) / 2**self.command_bits

    def draw(
        self, split: Split, number: int, seed: int | None = None, *, samples: int | None = None
    ) -> Draw:
        """Draw one plant of a split, the same at every call.

        Parameters
        ----------
        split
            ``training``, ``validation`` or ``test``: its name is among the random words, so that
            no two splits have a plant in common, whatever the seeds.
        number
            Which, from 0.
        seed
            Of the split; 0 by default, ``PUBLIC_SEED`` of the test.
        samples
            Of the references, whose beginning stays the same: more than the task's for what is
            learned within an episode.

        Raises
        ------
        InputError
            No such split, or a number or a seed that is not whole, or below 0.
        """
        if split not in _WORDS:
            raise InputError(f"split is {quoted(split)}; give {', '.join(_WORDS)}")
        used = (PUBLIC_SEED if split == "test" else 0) if seed is None else seed
        for what, value in (("number", number), ("seed", used)):
            if not is_whole(value, 0):
                raise InputError(f"{what} is {quoted(value)}; give a whole number of 0 or above")
        count = self.samples if samples is None else samples
        if not is_whole(count, 1):
            raise InputError(f"samples is {quoted(samples)}; give a whole number of 1 or above")
        words = [_KEY, _WORDS[split], zlib.crc32(self.name.encode()), int(used), int(number)]
        plant, reference, noise = np.random.SeedSequence(words).spawn(3)
        truth, later = self.truth(np.random.default_rng(plant), number)
        source, rng = self._source(number), np.random.default_rng(reference)
        names, columns = [], []
        time = self.ts_s * np.arange(count + self.preview)
        for i, choice in enumerate(self.references, start=1):
            hz = frequency_at(self.frequency_hz, float(rng.random()))
            signal = source.make(choice, hz, int(rng.integers(2**31)))
            names.append(f"{i} {signal.name}")
            columns.append(signal(time))
        sources = [np.random.default_rng(each) for each in noise.spawn(len(columns))]
        return Draw(
            number,
            truth,
            later,
            self.belief(number),
            tuple(names),
            np.stack(columns, axis=1)[:count],
            tuple(self.noise_of(each) for each in sources),
        )

    def lanes(
        self,
        split: Split,
        plants: int | Sequence[int],
        seed: int | None = None,
        *,
        samples: int | None = None,
    ) -> list[Lanes]:
        """Draw plants of a split as lanes side by side, each plant with every reference.

        Parameters
        ----------
        split, seed, samples
            As :meth:`draw`.
        plants
            How many, or their numbers.

        Returns
        -------
        list of Lanes
            One for each nominal plant: its lanes have one belief.
        """
        numbers = range(plants) if isinstance(plants, int) else plants
        groups: dict[int, list[Draw]] = {}
        for number in numbers:
            each = self.draw(split, number, seed, samples=samples)
            groups.setdefault(number % len(self.nominals), []).append(each)
        return [Lanes(self, tuple(draws)) for draws in groups.values()]

    def _source(self, number: int) -> ReferenceSource:
        layout = self.layout(number)
        return ReferenceSource(
            self.references,
            self.frequency_hz,
            layout.scale_um,
            layout.centre_um,
            self.smooth_start_s,
        )

    @property
    def options(self) -> dict[str, Any]:
        """Keywords of :class:`~rdpi_gym.envs.PiezoTrackingEnv` that make it this task's."""
        layout = self.layout()
        return {
            "plant": self.nominals[0],
            "belief": self.belief(),
            "rate_bandwidth_hz": None,  # the plants are band-limited already
            "ts_s": self.ts_s,
            "preview": self.preview,
            "reference": list(self.references),
            "frequency_hz": self.frequency_hz,
            "amplitude_um": layout.scale_um,
            "smooth_start_s": self.smooth_start_s,
            "randomise": self.half_width,
            "randomise_effects": self.effects_half_width,
            "limits": self.limits,
        }


@dataclass(frozen=True)
class Lanes:
    """Draws of one nominal plant side by side: a lane is a plant with one of its references."""

    task: StageTask
    draws: tuple[Draw, ...]

    @property
    def belief(self) -> PlantModel:
        """Models of all of them for a controller, effects included."""
        return self.draws[0].belief

    @property
    def numbers(self) -> list[int]:
        """The plant of each lane."""
        return [draw.number for draw in self.draws for _ in draw.names]

    @property
    def names(self) -> list[str]:
        """The reference of each lane."""
        return [name for draw in self.draws for name in draw.names]

    @property
    def references_um(self) -> Array:
        """References (µm), ``(K, B)``."""
        return np.concatenate([draw.references_um for draw in self.draws], axis=1)

    @property
    def noises(self) -> list[NoiseSource]:
        """Noise of each lane; good for one run."""
        return [noise for draw in self.draws for noise in draw.noises]

    def layout(self, **options: Any) -> ObservationLayout:
        """Return what is shown, with the task's preview unless `options` say otherwise."""
        return self.task.layout(self.draws[0].number, **options)

    def plant(self) -> ChangingPlant:
        """Return the true plants, at rest: what no controller may hold."""
        each = [draw for draw in self.draws for _ in draw.names]
        return ChangingPlant(
            [draw.truth for draw in each],
            self.task.ts_s,
            [draw.later for draw in each],
            self.task.command_step_V,
        )

    def track(self, layout: ObservationLayout) -> TrackingTask:
        """Return the tracking problems, for a layout of :meth:`layout`."""
        return TrackingTask(self.plant(), layout)
