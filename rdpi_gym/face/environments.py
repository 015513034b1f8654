"""Environments: what is shown to a controller, and Gymnasium's environments of a plant."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING, Any

from rdpi_gym.envs.layout import ActionMode, ObservationLayout
from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checks import checked

if TYPE_CHECKING:
    import gymnasium

    from rdpi_gym.envs.vector import PiezoTrackingVectorEnv

ID = "rdpi_gym/PiezoTracking-v0"
"""Under this name ``gymnasium.make`` knows the environment."""
TS_S = 1e-4
"""Sampling time (s) where none is given, in environments and layouts alike."""


@checked
def layout(
    plant: PlantModel | HasPlant | PathLike[str] | str = "P10",
    ts_s: float = TS_S,
    *,
    preview: int = 8,
    action: ActionMode = "command",
) -> ObservationLayout:
    """Return what an environment of a plant shows to a controller, and how it reads actions.

    Parameters
    ----------
    plant
        A plant, a result that has one, the path of a plant file, or a name of
        :data:`rdpi_gym.plants`; it sets the scales.
    ts_s
        Sampling time (s).
    preview
        Samples of the reference that are shown ahead.
    action
        ``command``, ``increment`` or ``correction``.

    Returns
    -------
    ObservationLayout

    Raises
    ------
    InputError
        No such plant, a sampling time that is not above zero, an argument of another type.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> rg.environments.layout("P5", ts_s=1e-3).size
    11
    """
    return ObservationLayout.for_plant(as_plant(plant), ts_s, preview, action=action)


def make(
    plant: PlantModel | HasPlant | PathLike[str] | str = "P10", **options: Any
) -> gymnasium.Env[Any, Any]:
    """Make the Gymnasium environment of a plant.

    Parameters
    ----------
    plant
        As :func:`layout`.
    **options
        Those of :class:`rdpi_gym.envs.PiezoTrackingEnv`, and of ``gymnasium.make``.

    Raises
    ------
    InputError
        No such plant, or an option out of range.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> env = rg.environments.make("P5", reference="triangle", frequency_hz=20.0)
    >>> observation, _ = env.reset(seed=0)
    >>> observation.shape
    (11,)
    """
    import gymnasium

    return gymnasium.make(ID, plant=as_plant(plant), **options)


def make_vector(
    plant: PlantModel | HasPlant | PathLike[str] | str = "P10", num_envs: int = 64, **options: Any
) -> PiezoTrackingVectorEnv:
    """Make the vector environment of a plant: many copies side by side.

    Parameters
    ----------
    plant
        As :func:`layout`.
    num_envs
        Number of copies.
    **options
        Those of :class:`rdpi_gym.envs.vector.PiezoTrackingVectorEnv`.

    Raises
    ------
    InputError
        No such plant, or an option out of range.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> env = rg.environments.make_vector("P5", num_envs=4)
    >>> env.reset(seed=0)[0].shape
    (4, 11)
    """
    from rdpi_gym.envs.vector import PiezoTrackingVectorEnv

    return PiezoTrackingVectorEnv(num_envs, plant=as_plant(plant), **options)
