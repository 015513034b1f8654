"""What the table of planted faults says: a row for every fault, and tests that the default tier runs."""

import ast

from tests.conftest import SECOND_TIER, TESTS
from tests.house import ROOT
from tests.mutations import NOTHING, TABLE, declared, places, read_table


def test_every_planted_fault_has_a_row_and_a_place():
    faults = declared()[1]
    assert list(read_table(TABLE)) == [fault.key for fault in faults]
    assert [fault.key for fault in faults if len(places(fault, ROOT)) != 1] == []


def test_what_finds_a_fault_is_a_test_of_the_default_tier():
    for fault, by in read_table(TABLE).items():
        if by == NOTHING:
            continue
        file, _, name = by.partition("::")
        path = ROOT / file
        assert path.is_file(), fault
        assert name.partition("[")[0] in _default_tests(path), (fault, by)
        assert not any(path.is_relative_to(TESTS / slow) for slow in SECOND_TIER), (fault, by)


def _default_tests(path):
    """Functions of a file whose decorators do not call them slow."""
    return {
        node.name
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef)
        and not any("slow" in ast.unparse(mark) for mark in node.decorator_list)
    }
