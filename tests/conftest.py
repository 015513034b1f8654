"""Two tiers of tests, and what a test may assume of the machine.

`make test` runs the first tier, `make test-all` both. Tests of the second have the marker `slow`: the
doctests, the paths of `SECOND_TIER`, and single tests that carry the marker in their file. Property
tests draw the same examples in continuous integration, and fresh ones elsewhere.
"""

import os
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import settings

TESTS = Path(__file__).parent

SECOND_TIER = (
    "baselines/test_imitation.py",  # training
    "baselines/test_learned_training.py",
    "baselines/test_ppo_from_scratch.py",
    "baselines/test_recurrent_ppo_example.py",
    "baselines/test_student_onnx.py",
    "benchmarks/test_diagnosis.py",  # studies with committed tables
    "benchmarks/test_effect_discovery.py",
    "benchmarks/test_payoff.py",
    "benchmarks/test_reproduce_command.py",
    "benchmarks/test_tracking_learned.py",
    "studies",
    "cli/test_ordinary_records.py",  # searches and environments by the dozen
    "envs/test_fuzzed_steps.py",
    "cli/test_foreign_folder.py",  # processes, signals, damaged and foreign files by the thousand
    "faults",
    "fuzz",
    "support/test_ray_cluster.py",
    "support/test_terminal.py",
    "docs",  # pages, their blocks, the gallery
    "envs/test_rllib.py",
    "face/test_twelve_lines.py",
    "laboratory/test_chooser.py",  # a browser
    "laboratory/test_end_to_end.py",
    "laboratory/test_interleaved.py",
    "laboratory/test_page.py",
    "report/test_pages_in_browser.py",
    "firmware/test_bare_metal.py",  # other compilers, boards, packages
    "firmware/writing/test_fmu.py",
    "firmware/writing/test_package.py",
    "test_contributing.py",  # a copy of the checkout
    "test_types.py",
    "test_wheel.py",
)
"""Files and folders of the second tier, relative to the tests."""

BEGUN_FIRST = (
    "test_contributing.py",
    "test_types.py",
    "fuzz",
    "laboratory/test_end_to_end.py",
    "envs",
    "baselines",
    "face",
)
"""In this order. What takes longest, begun last, would end long after the other processes. The first half of
the first tier begins with environments while the other compiles fits, and shares the results of the face."""

MAY_SKIP = (
    "h-infinity",  # slycot, of the extra robust alone
    "test_linear_loops",
    "test_dlpack",  # jax
    "test_a_folder_that_may_not_be_read_is_not_said_to_be_missing",  # root may read any folder
)
"""Pieces of the names of tests that a machine with every tool of `.ci/run` may skip."""

settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("default", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "default")


@cache
def _lies_in(file: Path, paths: tuple[str, ...]) -> bool:
    return any(file.is_relative_to(TESTS / path) for path in paths)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Read no file in the first tier that is of the second: what they import takes seconds."""
    first_tier = config.option.markexpr == "not slow"
    return (first_tier and _lies_in(collection_path, SECOND_TIER)) or None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if isinstance(item, pytest.DoctestItem) or _lies_in(item.path, SECOND_TIER):
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: [not _lies_in(item.path, (path,)) for path in BEGUN_FIRST])


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip `h-infinity` without slycot: it is GPL, and so of an extra that no other one asks for."""
    parameters = getattr(item, "callspec", None)
    asked = parameters is not None and "h-infinity" in parameters.id
    if asked and find_spec("slycot") is None:
        pytest.skip("h-infinity needs slycot, of the extra robust alone")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run that skips a test where `RDPI_ALL_TOOLS` states that every tool is installed.

    Tests of published measurements may skip where `RDPI_DATA` names none.
    """
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or not os.environ.get("RDPI_ALL_TOOLS"):
        return
    skipped = [
        report.nodeid
        for report in reporter.stats.get("skipped", [])
        if "RDPI_DATA" in os.environ or "RDPI_DATA" not in str(report.longrepr)
    ]
    wrong = [node for node in skipped if not any(piece in node for piece in MAY_SKIP)]
    for node in wrong:
        reporter.write_line(f"skipped although every tool is installed: {node}", red=True)
    if wrong and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
