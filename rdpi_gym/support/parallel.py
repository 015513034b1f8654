"""Parallel runs of cases: in processes, or on the nodes of a Ray cluster."""

from __future__ import annotations

import logging
import os
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import chdir, contextmanager
from functools import lru_cache, partial, wraps
from multiprocessing import resource_tracker
from pathlib import Path
from pickle import loads
from tempfile import TemporaryDirectory
from typing import Any, ParamSpec, TypeVar
from urllib.parse import urlsplit

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.backend.reduction import dumps
from joblib.externals.loky.backend.resource_tracker import ensure_running
from threadpoolctl import threadpool_limits

from rdpi_gym.support.command import uninterrupted_children
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.guard import SAFE_PATH

C = TypeVar("C")
P = ParamSpec("P")
R = TypeVar("R")

_PATIENCE_S = 5.0
# Work (s) of one map from which on processes pay: each takes 1.5 s to import and to load kernels, and
# a search has several maps.
_WORTH_S = 1.5


def in_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let the linear algebra of a function run in one thread, as it does in processes of `run_cases`.

    Threads of a library double the processor time of a fit of few parameters and end no sooner, and
    their sums are rounded otherwise.

    Examples
    --------
    >>> in_one_thread(abs)(-1)
    1
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


def run_cases(
    function: Callable[[C], R], cases: Sequence[C], jobs: int = 1, ray_address: str | None = None
) -> Iterator[R]:
    """Call a function with every case, and yield each result as soon as it is there.

    Whoever writes a result down as it comes loses none of it to an interruption.
    """
    if not cases:
        return
    if ray_address is not None:
        yield from _on_ray(function, cases, ray_address)
    elif jobs == 1:
        yield from map(function, cases)
    else:
        with parallel_config(backend="loky", inner_max_num_threads=1):
            # one case at a time to a worker: results come early
            parallel = Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")
        results: Generator[R] | None = None
        try:
            with isolated_children():
                # they would lift what holds interrupts back from the workers, were they started after it
                resource_tracker.ensure_running()
                ensure_running()
                with uninterrupted_children():
                    results = parallel(delayed(function)(case) for case in cases)
            # an interrupt held back until here ends the sweep as one that comes later
            for result in results:  # noqa: UP028 - `yield from` would close it before `finally` is reached
                yield result
        finally:
            if results is not None:
                _leave(results)


class Pool:
    """Processes of one search, started once it has enough to do for them.

    Whoever watches is `told` of each result.

    Examples
    --------
    >>> Pool(jobs=2).map(abs, [-1, 2])
    [1, 2]
    """

    def __init__(self, jobs: int, told: Callable[[], None] = lambda: None) -> None:
        self._jobs, self._started, self._told = jobs, jobs == 1, told

    def map(
        self,
        function: Callable[[C], R],
        cases: Sequence[C],
        seen: Callable[[R], None] = lambda result: None,
    ) -> list[R]:
        """Return the results in the order of the cases; each is `seen` as soon as it is there."""
        results: dict[int, R] = {}
        began = time.perf_counter()

        def spent_s() -> float:
            return time.perf_counter() - began

        while len(results) < len(cases):
            done, left = len(results), len(cases) - len(results)
            if self._jobs != 1 and left > 1:
                self._started = self._started or spent_s() * left > _WORTH_S * done > 0
                if self._started:
                    break
            results[done] = function(cases[done])
            self._told()
            seen(results[done])
        rest = list(enumerate(cases))[len(results) :]
        if not rest:
            return list(results.values())
        with TemporaryDirectory() as folder:
            # a function has the records with it: they are sent once, and not with each case
            told = Path(folder, "function")
            told.write_bytes(dumps(function))
            for place, result in run_cases(partial(_numbered, str(told)), rest, self._jobs):
                results[place] = result
                self._told()
                seen(result)
        return [results[place] for place in range(len(cases))]


def _numbered(told: str, case: tuple[int, C]) -> tuple[int, Any]:
    return case[0], _told(told)(case[1])


@lru_cache(maxsize=1)
def _told(path: str) -> Callable[[Any], Any]:
    """Return the function that the process which has written a file wants to be called."""
    function: Callable[[Any], Any] = loads(Path(path).read_bytes())
    return function


ALONE = Pool(1)
"""No process beside this one."""


@contextmanager
def isolated_children() -> Iterator[None]:
    """Let Python processes that are started inside find no module in the current folder.

    What they import is found where this process finds it: joblib hands its path over.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before


def _leave(results: Generator[R]) -> None:
    """Cancel what is not finished, without joblib's advice on it: a sweep is left early on purpose.

    Where it is left as its processes start, joblib's thread may miss a case that is cancelled.
    """
    hook = threading.excepthook

    def report(what: threading.ExceptHookArgs) -> None:
        if what.thread is None or what.thread.name != "ExecutorManagerThread":
            hook(what)

    threading.excepthook = report
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="joblib")
            results.close()
    finally:
        threading.excepthook = hook


def _on_ray(function: Callable[[C], R], cases: Sequence[C], address: str) -> Iterator[R]:
    # Not joblib's Ray backend: it gives no result before all are there (return_as must be "list"),
    # and where a node dies the cases of its actors fail. Ray's own tasks are waited for one by one
    # and run again on another node.
    with _cluster(address):
        import ray

        task = ray.remote(num_cpus=1)(_call)
        waiting = [task.remote(function, case, sys.path) for case in cases]
        while waiting:
            finished, waiting = ray.wait(waiting)
            try:
                results = ray.get(finished)
            except ray.exceptions.RayTaskError as error:
                raise error.cause from error
            yield from results


def _call(function: Callable[[C], R], case: C, path: Sequence[str]) -> R:
    """Call a function on a node, where modules that the user named are found as they are here."""
    sys.path += [entry for entry in path if entry not in sys.path]
    return function(case)


@contextmanager
def _cluster(address: str) -> Iterator[None]:
    """Connect this process to a cluster, and leave it at the end unless it was connected before."""
    try:
        import ray
    except ModuleNotFoundError as error:
        raise InputError("--ray needs Ray; pip install 'rdpi-gym[ray]'") from error
    if ray.is_initialized():
        yield
        return
    _knock(address)
    try:
        # Ray puts the current folder on the path of every worker: let it be one that is there already
        with chdir(Path(__file__).parents[2]):
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (AssertionError, ConnectionError, RuntimeError, ValueError) as error:
        raise _unreachable(address, error) from error
    try:
        yield
    finally:
        ray.shutdown()  # cancels what is still running


def _knock(address: str) -> None:
    """Ray itself would try for minutes to reach a host that is not there."""
    try:
        place = urlsplit(address if "://" in address else f"//{address}")
        if place.hostname and place.port:
            socket.create_connection((place.hostname, place.port), _PATIENCE_S).close()
    except (OSError, ValueError) as error:
        raise _unreachable(address, error) from error


def _unreachable(address: str, error: Exception) -> InputError:
    reason = " ".join(str(error).split())
    return InputError(
        f"--ray {address}: no connection to a Ray cluster there ({reason}); give the host:port that `ray start --head` printed"
    )
