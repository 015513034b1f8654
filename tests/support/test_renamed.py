"""Former names of modules import what is there now, with a warning."""

import importlib
import sys

import pytest

from rdpi_gym.support.renamed import _TABLE, FormerNames


def test_a_former_name_imports_the_module_of_today_with_a_warning(monkeypatch):
    table = "rdpi_gym.former rdpi_gym.support.words\nrdpi_gym.room.old rdpi_gym.support.words"
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, FormerNames(table)])
    words = importlib.import_module("rdpi_gym.support.words")
    for former in ("rdpi_gym.former", "rdpi_gym.room.old"):
        with pytest.warns(DeprecationWarning, match=f"{former} is now rdpi_gym.support.words"):
            found = importlib.import_module(former)
        assert found.digits is words.digits, former
    for name in ("rdpi_gym.former", "rdpi_gym.room.old", "rdpi_gym.room"):
        sys.modules.pop(name, None)
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("rdpi_gym.never")


def test_every_former_name_of_the_table_leads_to_a_module():
    for line in _TABLE.strip().splitlines():
        former, present = line.split()
        with pytest.warns(DeprecationWarning, match=present):
            importlib.import_module(former)
        sys.modules.pop(former)
