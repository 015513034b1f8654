"""Controllers beside the registered ones: trained policies, and objects of a user."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import baselines
from baselines import CONTROLLERS, LEARNED, Controller, ControllerFactory, policy_of
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checks import shown
from rdpi_gym.support.errors import InputError

if TYPE_CHECKING:
    from baselines.learned.imitation.policy import StudentPolicy
    from baselines.learned.policy import Policy


POLICIES = Path(baselines.__file__).parent / "learned" / "policies"
"""Folder of the policies of this release, each in a folder of its name."""
_DESCRIPTION = "policy.json"


def is_learned(controller: str) -> bool:
    """Whether a controller's name is that of a trained policy."""
    return policy_of(controller) is not None


def shipped_policies() -> tuple[list[str], tuple[str, ...]]:
    """Return the shipped policies that can run here, and one sentence where torch is missing."""
    names = sorted(path.parent.name for path in POLICIES.glob(f"*/{_DESCRIPTION}"))
    if names and find_spec("torch") is None:
        left_out = f"Left out, since torch is not installed (rdpi-gym[rl]): {', '.join(names)}."
        return [], (left_out,)
    return [LEARNED + name for name in names], ()


def read_policy(controller: str) -> Policy | StudentPolicy:
    """Read the policy of a learned controller."""
    try:
        from baselines.learned.controller import find_learned  # torch, only where needed
    except ImportError as error:
        raise InputError(f"{controller!r} needs torch ({error}); install rdpi-gym[rl]") from error
    return find_learned(policy_of(controller) or "")


def trained_at_s(controller: str) -> float:
    """Return the sampling time (s) of a learned controller's training: it runs at no other."""
    return read_policy(controller).layout.ts_s


def corrected_by(controller: str) -> str | None:
    """Return the name of the baseline that a learned controller corrects; None where there is none."""
    return read_policy(controller).baseline


def policy_bytes(controller: str) -> bytes:
    """Return a policy's description, which holds a hash of its weights; nothing where it is none."""
    name = policy_of(controller) or ""
    shipped = POLICIES / name / _DESCRIPTION
    path = shipped if shipped.is_file() else Path(name) / _DESCRIPTION
    return path.read_bytes() if path.is_file() else b""


@dataclass(frozen=True)
class Made:
    """A controller that was made with a belief and a layout of its own; it is scored as it is.

    Parameters
    ----------
    controller
        With ``predict``.
    layout
        What it is shown; its sampling time is the one that it is scored at.
    """

    controller: Controller
    layout: ObservationLayout

    def __call__(self, belief: PlantModel, layout: ObservationLayout) -> Controller:
        """Return the controller; what the benchmark would have it believe does not matter."""
        return self.controller


def named(controllers: Sequence[Any]) -> Mapping[str, ControllerFactory]:
    """Name callables and controllers, and return what makes each."""
    found: dict[str, ControllerFactory] = {}
    for each in controllers:
        if isinstance(each, Controller) and not isinstance(each, type):
            layout = getattr(each, "layout", None)
            if not isinstance(layout, ObservationLayout):
                raise InputError(
                    f"controller {shown(each)} has no layout; give a callable (belief, layout) that makes it"
                )
            label, factory = f"{type(each).__name__} (made)", Made(each, layout)
        elif callable(each):
            label, factory = str(getattr(each, "__name__", type(each).__name__)), each
        else:
            raise InputError(
                f"controller {shown(each)}: give a name, a callable (belief, layout), or a controller"
            )
        count = 1
        while (name := label if count == 1 else f"{label} {count}") in {*found, *CONTROLLERS}:
            count += 1
        found[name] = factory
    return found
