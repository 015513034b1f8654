"""The vector environment: thousands of piezo stages that follow references, in one process."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.limits import COST_KEYS
from rdpi_gym.envs.piezo_tracking import PiezoTrackingEnv, read_options
from rdpi_gym.envs.unit_box import UnitBoxes
from rdpi_gym.envs.vector.lanes import Flags, Floats32, Integers, Words
from rdpi_gym.envs.vector.task import VectorTask
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_whole, shape_of
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

if TYPE_CHECKING:
    from rdpi_gym.envs.rendering import LiveFigure


def checked_count(name: str, value: Any, what: str, most: int) -> int:
    """Return a whole number of at least 1 and at most `most`."""
    if not is_whole(value, 1) or value > most:
        raise InputError(
            f"{name} is {quoted(value)}; give a whole number of {what}, at least 1 and at most {most}"
        )
    return int(value)


def checked_mode(mode: Any) -> AutoresetMode:
    """Return an autoreset mode, given as such or by its value."""
    try:
        return AutoresetMode(mode)
    except (TypeError, ValueError):
        modes = ", ".join(repr(each.value) for each in AutoresetMode)
        raise InputError(f"autoreset_mode is {quoted(mode)}; give one of {modes}") from None


def checked_seeds(seed: Any, lanes: int) -> tuple[Words, Flags]:
    """Seeds of the lanes, and a mask of those that are given one; the others go on as they are."""
    if seed is None:
        return np.zeros(lanes, dtype=np.uint64), np.zeros(lanes, dtype=bool)
    if is_whole(seed, -math.inf):
        first, last = int(seed), int(seed) + lanes - 1
        if first >= 0 and last < 2**64:
            counted = np.uint64(first) + np.arange(lanes, dtype=np.uint64)
            return counted, np.ones(lanes, dtype=bool)
        seeds: list[Any] = [first + lane for lane in range(lanes)]
    elif isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str):
        seeds = list(np.atleast_1d(seed) if isinstance(seed, np.ndarray) else seed)
    else:
        raise InputError(f"seed is {quoted(seed)}; give a whole number, or one for each lane")
    if len(seeds) != lanes:
        raise InputError(f"{len(seeds)} seeds for {lanes} lanes; give one for each lane")
    for lane, each in enumerate(seeds):
        if each is not None and not (is_whole(each, 0) and each < 2**64):
            raise InputError(f"the seed of lane {lane} is {quoted(each)}; seeds are 0 to 2**64 - 1")
    values = np.array([each or 0 for each in seeds], dtype=np.uint64)
    return values, np.array([each is not None for each in seeds])


def checked_mask(mask: Any, lanes: int) -> Flags:
    """Return a mask of lanes."""
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (lanes,):
        found = f"{type(mask).__name__}"
        if isinstance(mask, np.ndarray):
            found = f"{mask.dtype} of shape {mask.shape}"
        raise InputError(f"reset_mask is {found}; give a numpy array of bool of shape ({lanes},)")
    if not mask.any():
        raise InputError("reset_mask is false for every lane; give one that is true somewhere")
    return mask


@njit(cache=True, fastmath={"reassoc"})
def _read(actions: NDArray[np.floating[Any]], numbers: Array) -> float:
    # NaN where a number is NaN or infinite; the sum may be reordered, so it runs on vector units.
    total = 0.0
    for b in range(len(actions)):
        numbers[b] = actions[b]
        total += 0.0 * numbers[b]
    return total


def checked_actions(actions: Any, lanes: int) -> Array:
    """Return actions ``(B, 1)`` as contiguous ``float64[B]``."""
    numeric = isinstance(actions, np.ndarray) and actions.dtype.kind in "fiu"
    if not numeric or actions.shape != (lanes, 1):
        raise InputError(
            f"actions are {type(actions).__name__} of shape {shape_of(actions)}; "
            f"give a numpy array of numbers of shape ({lanes}, 1), -1 to 1"
        )
    if actions.dtype != np.float32:
        actions = actions.astype(np.float64)
    numbers = np.empty(lanes)
    if _read(np.ascontiguousarray(actions.reshape(-1)), numbers) != 0.0:
        lane = int(np.argmin(np.isfinite(numbers)))
        raise InputError(
            f"action of lane {lane} is {numbers[lane]}; give finite numbers of -1 to 1"
        )
    return numbers


_INFO = ("displacement_um", "reference_um", "error_um", "command_V", "saturated")
_MOST_LANES, _MOST_STEPS = 10**7, 10**15
_KEYS = {len(keys): (*keys, *(f"_{key}" for key in keys)) for keys in (_INFO, (*_INFO, *COST_KEYS))}
"""Keys of ``info`` by the number of quantities that are reported, without and with costs."""


class PiezoTrackingVectorEnv(VectorEnv[Floats32, NDArray[Any], NDArray[Any]]):
    """Thousands of :class:`PiezoTrackingEnv` side by side, each with its own plant and reference.

    ## Description
    The vector twin of `rdpi_gym.envs.PiezoTrackingEnv`, which describes the task: lane i seeded
    with s is that environment reset with seed s, step by step and over episodes, to rounding.
    Plants, references, noise and effects are drawn for each lane from a generator of its own.
    It is the `vector_entry_point` of the registered environment:

    ```python
    import gymnasium as gym
    import rdpi_gym

    envs = gym.make_vec("rdpi_gym/PiezoTracking-v0", num_envs=4096, randomise=0.1)
    ```

    ## Spaces
    Batches of the single environment's: actions `(num_envs, 1)`, observations
    `(num_envs, preview + 3)`, float32; rewards are float64. Every array that is returned is the
    caller's own.

    ## Autoreset
    An episode is truncated after `max_episode_steps`; nothing terminates it.

    | `autoreset_mode` | a lane whose episode has ended |
    |---|---|
    | `AutoresetMode.NEXT_STEP` | begins the next one in the following step: its action is not used, its reward is 0 |
    | `AutoresetMode.SAME_STEP` | begins the next one in the same step; `info["final_obs"]` and `info["final_info"]` hold the end |
    | `AutoresetMode.DISABLED` | waits for `reset(options={"reset_mask": mask})` |

    `info` holds the single environment's keys, float64 of `num_envs` (`privileged`: of `num_envs`
    rows), each with a mask `_key`.

    ## Arguments
    All keywords of `PiezoTrackingEnv`, and

    | keyword | default | meaning |
    |---|---|---|
    | `num_envs` | `1` | number of lanes |
    | `max_episode_steps` | `2000` | steps of an episode; `None`: it never ends |
    | `autoreset_mode` | `NEXT_STEP` | member of `gymnasium.vector.AutoresetMode`, or its value |
    | `threads` | `None` | largest number of threads; `None`: one for every 2048 lanes, at most numba's (`NUMBA_NUM_THREADS`, the cores). What a lane does is the same for any number |
    | `render_mode` | `None` | `"rgb_array"`: a frame for each lane |
    | `single` | `PiezoTrackingEnv` | class of the single environment, a task's with the task's laws and history |

    A reset's `seed` is a number (lane i takes seed + i) or one for each lane; its `options` are the
    single environment's, for all lanes that it resets, and `reset_mask`. A `plant` there has the
    same hysteresis core with as many gains, effects and converter as that of the environment.

    Raises
    ------
    InputError
        A keyword has a value that no environment can be made of; the line names it.

    Attributes
    ----------
    single : PiezoTrackingEnv
        An environment of the same options, never stepped.
    task : VectorTask
        The lanes, without the rules of autoreset.

    Examples
    --------
    >>> envs = PiezoTrackingVectorEnv(num_envs=3, plant="P5", preview=2)
    >>> observation, info = envs.reset(seed=0)
    >>> observation.shape, info["displacement_um"].tolist()
    ((3, 5), [0.0, 0.0, 0.0])
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  # the base class declares it so
        "render_modes": ["rgb_array"],
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = 2000,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        render_mode: str | None = None,
        single: type[PiezoTrackingEnv] = PiezoTrackingEnv,
        **options: Any,
    ) -> None:
        self.num_envs = checked_count("num_envs", num_envs, "lanes", _MOST_LANES)
        if max_episode_steps is not None:
            max_episode_steps = checked_count(
                "max_episode_steps", max_episode_steps, "steps", _MOST_STEPS
            )
        if threads is not None:
            threads = checked_count("threads", threads, "threads", _MOST_LANES)
        if not (isinstance(single, type) and issubclass(single, PiezoTrackingEnv)):
            raise InputError(f"single is {quoted(single)}; give a class of PiezoTrackingEnv")
        self._mode = checked_mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        # It makes and checks what the lanes draw; it is never stepped.
        self.single = single(render_mode=render_mode, **options)
        self.render_mode = render_mode
        self.single_observation_space = self.single.observation_space
        self.single_action_space = self.single.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = UnitBoxes(self.num_envs)
        self.task = VectorTask(self.single, self.num_envs, max_episode_steps, threads)
        self._seeded: Flags = np.zeros(self.num_envs, dtype=bool)
        self._begun = False
        self._over: Integers = np.empty(0, dtype=np.int64)
        self._figures: list[LiveFigure] = []

    @property
    def layout(self) -> ObservationLayout:
        """Fields of an observation."""
        return self.single.layout

    @property
    def history(self) -> History:
        """Earlier samples in an observation."""
        return self.single.history

    @property
    def nominal(self) -> PlantModel:
        """The plant about which those of the lanes are drawn."""
        return self.single.nominal

    @property
    def belief(self) -> PlantModel:
        """Model of the plants that a baseline uses."""
        return self.single.belief

    @property
    def threads(self) -> int:
        """Number of threads that share a step."""
        return self.task.threads

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats32, dict[str, Any]]:
        """Begin episodes in all lanes, or in those of ``options["reset_mask"]``.

        Parameters
        ----------
        seed
            A number s: lane i is seeded with s + i; or one for each lane, None to leave it.
        options
            As the class says.

        Returns
        -------
        observation : float32[B, D]
            Of all lanes; those that are not reset show what they showed last.
        info : dict
            Of the lanes that are reset; zeros, and false in the masks, elsewhere.

        Raises
        ------
        InputError
            A bad seed, mask or option.
        gymnasium.error.ResetNeeded
            A mask, and there was no reset of all lanes yet.
        """
        chosen = read_options(options, "reset_mask")
        mask = chosen.pop("reset_mask", None)
        seeds, given = checked_seeds(seed, self.num_envs)
        lanes = np.arange(self.num_envs)
        if mask is not None:
            lanes = np.flatnonzero(checked_mask(mask, self.num_envs))
            if not self._begun:
                raise ResetNeeded("call reset() for all lanes before reset with a reset_mask")
        super().reset(seed=int(seeds[0]) if given[0] else None)
        self._seed(seeds, given, lanes)
        observation, shown = self.task.begin(lanes, chosen)
        self._begun = True
        if len(self._over):
            self._over = np.setdiff1d(self._over, lanes)
        rows = np.zeros((len(shown), self.num_envs))
        rows[:, lanes] = shown
        self._record(rows, lanes, lanes)
        begun = np.zeros(self.num_envs, dtype=bool)
        begun[lanes] = True
        infos = _infos(rows, begun)
        if self.single.latents:
            infos |= {"privileged": self.task.latents(), "_privileged": begun.copy()}
        return (observation if mask is None else self.task.stacked()), infos

    def step(self, actions: NDArray[Any]) -> tuple[Floats32, Array, Flags, Flags, dict[str, Any]]:
        """Set the next command of every lane; the class says what is returned.

        Raises
        ------
        InputError
            Actions of another shape, or one that is not finite; no lane has moved then.
        gymnasium.error.ResetNeeded
            There was no reset yet, or a lane waits for one.
        """
        if not self._begun:
            raise ResetNeeded("call reset() before step()")
        begun = self._over
        if len(begun) and self._mode is AutoresetMode.DISABLED:
            raise ResetNeeded(
                f"the episode of lane {begun[0]} has ended; reset it with a reset_mask before step()"
            )
        task = self.task
        out = task.advance(checked_actions(actions, self.num_envs))
        flat, reward, truncated, shown = out
        observation = flat.reshape(self.num_envs, -1)
        ends = task.step >= task.next_end
        latents = task.latents() if self.single.latents else None
        if len(begun):
            observation[begun], shown[:, begun] = task.begin(begun, {})
            reward[begun], truncated[begun] = 0.0, False
            self._over = begun[:0]
        infos: dict[str, Any] = {}
        if ends:
            self._over = np.flatnonzero(truncated)
            if len(self._over) and self._mode is AutoresetMode.SAME_STEP:
                begun, self._over = self._over, self._over[:0]
                infos = _finals(observation, shown, begun)
                if latents is not None:
                    final = infos["final_info"]
                    final |= {"privileged": latents, "_privileged": infos["_final_obs"].copy()}
                observation[begun], shown[:, begun] = task.begin(begun, {})
        every = np.arange(self.num_envs) if self.render_mode is not None else begun
        self._record(shown, every, begun)
        infos |= _infos(shown, True)
        if latents is not None:
            now = task.latents() if len(begun) else latents
            infos |= {"privileged": now, "_privileged": np.ones(self.num_envs, dtype=bool)}
        return observation, reward, np.zeros(self.num_envs, dtype=bool), truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a frame for each lane, ``uint8[480, 960, 3]``; None, with a warning, without a render mode."""
        if self.render_mode is None:
            gym.logger.warn('no render_mode was given; make the environment with "rgb_array"')
            return None
        return tuple(figure.draw() for figure in self._live_figures())

    def _seed(self, seeds: Words, given: Flags, lanes: Integers) -> None:
        """Begin the generators of lanes with a seed anew, and those that never had one."""
        seeded, others = lanes[given[lanes]], lanes[~(given | self._seeded)[lanes]]
        self.task.seed(seeded, seeds[seeded])
        if len(others):
            fresh: Words = np.random.SeedSequence().generate_state(len(others), np.uint64)  # type: ignore[assignment]  # the stubs leave the type open
            self.task.seed(others, fresh)
        self._seeded[lanes] = True

    def _record(self, shown: Array, lanes: Integers, begun: Integers) -> None:
        """Give the figures of some lanes a sample, the first of an episode for those that begin."""
        if self.render_mode is None:
            return
        figures = self._live_figures()
        for lane in begun.tolist():
            figures[lane].reset()
        for lane in lanes.tolist():
            displacement, reference, _, command = shown[:4, lane].tolist()
            figures[lane].record(command, reference, displacement)

    def _live_figures(self) -> list[LiveFigure]:
        if not self._figures:
            from rdpi_gym.envs.rendering import LiveFigure  # matplotlib, only where it is needed

            title = f"PiezoTracking, {self.nominal.name}"
            self._figures = [
                LiveFigure(self.layout, f"{title}, lane {lane}") for lane in range(self.num_envs)
            ]
        return self._figures


def _infos(shown: Array, lanes: Flags | bool) -> dict[str, Any]:
    """Return what lanes show by its keys, each with a mask of the lanes that have it."""
    masks = np.empty(shown.shape, dtype=bool)
    masks[:] = lanes
    return dict(zip(_KEYS[len(shown)], (*shown, *masks), strict=True))


def _finals(observation: Floats32, shown: Array, ended: Integers) -> dict[str, Any]:
    """Return the last observations and infos of lanes that have ended, with masks, as copies."""
    lanes = len(observation)
    mask = np.zeros(lanes, dtype=bool)
    mask[ended] = True
    last = np.full(lanes, None, dtype=object)
    for lane, row in zip(ended.tolist(), observation[ended], strict=True):
        last[lane] = row
    rows = np.zeros((len(shown), lanes))
    rows[:, ended] = shown[:, ended]
    return {
        "final_obs": last,
        "_final_obs": mask,
        "final_info": _infos(rows, mask),
        "_final_info": mask.copy(),
    }
