"""`inspect` and `respond`: records as a search looks through them, and models on them one by one."""

from __future__ import annotations

from os import PathLike

from rdpi_gym import measurement
from rdpi_gym.diagnosis.search.inspection import Inspection, Response
from rdpi_gym.diagnosis.search.plants import Refit
from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.face.data import as_dataset, in_words_of
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checked import checked

__all__ = ["Inspection", "Refit", "Response", "inspect", "respond"]


@checked
def inspect(data: measurement.Dataset | PathLike[str] | str) -> Inspection:
    """Look through records as a search does, and keep them for models that are tried one by one.

    Parameters
    ----------
    data
        From :func:`rdpi_gym.load`, or the path of a measurement.

    Returns
    -------
    Inspection
        Its ``findings`` say what is no measurement; ``.respond(model)`` simulates a model on every
        record within milliseconds, ``.refit(model, held)`` fits one from where it stands.

    Raises
    ------
    InputError
        No record to fit, or none to validate on; an argument of another type.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    >>> looked = rg.inspect(data.select("stairs", "sine-50hz", "validation-stairs", "quiet"))
    >>> before = looked.respond(rg.plants["P5"]).errors
    >>> looked.refit(rg.plants["P5"]).errors.train_rmse_um < before.train_rmse_um
    True
    """
    dataset = as_dataset(data)
    with in_words_of(dataset):
        return Inspection(dataset)


@checked
def respond(
    model: PlantModel | HasPlant | PathLike[str] | str,
    data: measurement.Dataset | PathLike[str] | str,
) -> Response:
    """Simulate a model on every record as a search does, one offset free in each.

    Parameters
    ----------
    model
        A plant, a result that has one, the path of a plant file, or a plant's name.
    data
        From :func:`rdpi_gym.load`, or the path of a measurement; for one model after another on the
        same records see :func:`inspect`.

    Returns
    -------
    Response
        ``model_um`` (µm) by record, and ``errors`` (µm rms).

    Raises
    ------
    InputError
        As :func:`inspect`; no such plant.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> found = rg.respond("P5", rg.simulate("P5", seed=1, ts_factor=4.0))
    >>> found.errors.validation_rmse_um < 0.02
    True
    """
    plant = as_plant(model)
    return inspect(data).respond(plant)
