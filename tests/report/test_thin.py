"""Thinned traces keep every peak and stay small."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rdpi_gym.report.traces import thin_index


@given(
    total=st.integers(1, 5000),
    samples=st.integers(4, 400),
    traces=st.integers(1, 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_extremes_and_ends_are_kept(total, samples, traces, seed):
    values = np.random.default_rng(seed).standard_normal((traces, total))
    k = thin_index(*values, samples=samples)
    assert np.all(np.diff(k) > 0)
    assert k[0] == 0
    assert k[-1] == total - 1
    assert k.size <= max(samples, 2 * traces) + 2
    for trace in values:
        assert trace[k].min() == trace.min()
        assert trace[k].max() == trace.max()


def test_short_traces_are_whole():
    assert thin_index(np.zeros(10), samples=10).tolist() == list(range(10))


def test_nan_is_no_value():
    trace = np.full(1000, np.nan)
    trace[345] = 1.0
    assert 345 in thin_index(trace, samples=50)
