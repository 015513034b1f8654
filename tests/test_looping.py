"""A loop inside a test runs every case, and names those that fail and those that are skipped."""

import pytest

from tests.looping import over


def test_every_case_runs_and_every_failure_names_its_own():
    seen = []

    @over("k", range(5))
    def odd_ones_fail(k):
        seen.append(k)
        if k == 0:
            pytest.skip("too small")
        assert k != 1
        if k == 3:
            pytest.fail("three")

    with pytest.raises(BaseExceptionGroup, match="2 of 5 cases") as found:
        odd_ones_fail()
    assert seen == [0, 1, 2, 3, 4]
    first, second = found.value.exceptions
    assert (first.__notes__, second.__notes__) == (["case k = 1"], ["case k = 3"])
    assert isinstance(second, pytest.fail.Exception)


def test_one_failure_is_raised_as_itself():
    @over("k", [1, 2])
    def second_fails(k):
        assert k < 2

    with pytest.raises(AssertionError) as found:
        second_fails()
    assert found.value.__notes__ == ["case k = 2"]


def test_a_skip_ends_its_own_case_only():
    seen = []

    @over("k, why", [(1, "no gcc"), (2, None)])
    def first_is_skipped(k, why):
        seen.append(k)
        if why:
            pytest.skip(why)

    with pytest.raises(pytest.skip.Exception) as found:
        first_is_skipped()
    assert found.value.msg == "1 of 2 cases: case k, why = (1, 'no gcc'): no gcc"
    assert seen == [1, 2]


def test_an_interrupt_ends_the_loop():
    @over("k", [1, 2])
    def interrupted(k):
        assert k == 1
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
