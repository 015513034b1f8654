"""Property tests draw the same examples in continuous integration, and fresh ones elsewhere.

Tests of `h-infinity` skip without slycot: it is GPL, and so of an extra that no other one asks for.
"""

import os
from importlib.util import find_spec

import pytest
from hypothesis import settings

settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("default", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "default")


def pytest_runtest_setup(item: pytest.Item) -> None:
    parameters = getattr(item, "callspec", None)
    asked = parameters is not None and "h-infinity" in parameters.id
    if asked and find_spec("slycot") is None:
        pytest.skip("h-infinity needs slycot, of the extra robust alone")
