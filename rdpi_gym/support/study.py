"""A search by Optuna that is kept in a journal, one file a folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rdpi_gym.support.errors import InputError

if TYPE_CHECKING:
    from optuna import Study


def open_study(
    journal: Path, name: str, direction: Literal["minimize", "maximize"] = "minimize"
) -> Study:
    """Open a study in a journal, or begin it."""
    try:
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend
    except ImportError as error:
        raise InputError(f"tuning needs Optuna ({error}); install rdpi-gym[tune]") from error
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        journal.parent.mkdir(parents=True, exist_ok=True)
        storage = JournalStorage(JournalFileBackend(str(journal)))
        return optuna.create_study(
            storage=storage, study_name=name, load_if_exists=True, direction=direction
        )
    except (OSError, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise InputError(
            f"the search in {journal.parent} cannot be read or written ({reason})"
        ) from error
