"""`load_result`: any saved result, of whatever kind."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from rdpi_gym.face.display import Result
from rdpi_gym.face.saving import read_result
from rdpi_gym.support.checks import checked


@checked
def load_result(path: PathLike[str] | str) -> Result:
    """Load what the method ``save`` of a result wrote; nothing in the file is run.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Result
        Of the class that was saved.

    Raises
    ------
    InputError
        The file is missing, damaged, or no saved result.

    Examples
    --------
    >>> import tempfile
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", seed=1, ts_factor=4.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = rg.load_result(data.save(Path(folder) / "data.npz"))
    >>> type(again).__name__, again.title == data.title
    ('Simulation', True)
    """
    kinds: dict[str, Any] = {kind.saved_as: kind for kind in _kinds()}
    found: Result = read_result(Path(path), kinds)
    return found


def _kinds() -> list[Any]:
    from rdpi_gym.face.benchmarking import Evaluation
    from rdpi_gym.face.comparison import Comparison, ModelComparison
    from rdpi_gym.face.data import Dataset
    from rdpi_gym.face.fitting import CoreFit, FitResult, KindChoice
    from rdpi_gym.face.paper import PaperResults
    from rdpi_gym.face.search import SearchResult
    from rdpi_gym.face.simulation import Simulation

    return [
        Dataset, Simulation, FitResult, CoreFit, KindChoice, Comparison, ModelComparison, SearchResult, Evaluation,
        PaperResults,
    ]  # fmt: skip
