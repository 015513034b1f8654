"""A controller of one's own, tried for some samples before a long run begins."""

from __future__ import annotations

import traceback
from pathlib import Path

import numpy as np

from baselines import ControllerFactory, make_controller
from benchmarks.tracking.own import Made
from benchmarks.tracking.scoring import one_line
from benchmarks.tracking.stages import Stage
from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.support.errors import InputError

_SAMPLES, _LANES = 5, 2


def try_controller(name: str, stage: Stage, factory: ControllerFactory | None = None) -> None:
    """Run a controller for a few samples of two episodes, and see that it controls."""
    ts_s, belief = min(stage.every_ts_s), stage.belief(name)
    try:
        usual = ObservationLayout.for_plant(stage.plant, ts_s)
        layout = stage.layout(ts_s, make_controller(factory or name, belief, usual))
        layout = factory.layout if isinstance(factory, Made) else layout
        controller = make_controller(factory or name, belief, layout)
        reference = np.full((_SAMPLES, _LANES), stage.rest_um)
        if hasattr(controller, "plan"):
            controller.plan(reference)
        task = TrackingTask([stage.plant] * _LANES, layout)
        observation = task.reset(reference, [np.random.default_rng(0)] * _LANES)
        state, starts = None, np.ones(_LANES, dtype=bool)
        for _ in range(_SAMPLES - 1):
            answer = controller.predict(observation, state, starts, deterministic=True)
            if not (isinstance(answer, tuple) and len(answer) == 2):
                raise InputError(f"its predict returns {_named(answer)}; give (action, state)")
            action, state = answer
            observation = task.step(layout.place_to_V(np.clip(_checked(action), -1.0, 1.0)))
            starts = np.zeros(_LANES, dtype=bool)
    except InputError as error:
        said = str(error)
        raise InputError(said if repr(name) in said else f"{name!r}: {said}") from error
    except Exception as error:  # a user's controller may raise anything
        where = traceback.extract_tb(error.__traceback__)[-1]
        raise InputError(
            f"{name!r} raises {one_line(f'{type(error).__name__}: {error}')} "
            f"({Path(where.filename).name}, line {where.lineno})"
        ) from error


def _checked(action: object) -> np.ndarray:
    try:
        numbers = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"its action is {_named(action)}; give an array of numbers") from None
    if numbers.shape not in ((_LANES, 1), (_LANES,)):
        raise InputError(
            f"it answers {_LANES} observations with an action of shape {numbers.shape}; give ({_LANES}, 1)"
        )
    if not np.isfinite(numbers).all():
        raise InputError("its action is not finite; give numbers from -1 to 1")
    return numbers.reshape(_LANES)


def _named(value: object) -> str:
    return "None" if value is None else f"a {type(value).__name__}"
