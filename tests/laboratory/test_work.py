"""Worker processes: progress as it comes, a cancel that takes effect at once, a death that is said."""

import queue
import sys
import time
from functools import partial

import pytest

from rdpi_gym.laboratory.work import Worker, Workers

TASKS = """
import os, subprocess, sys, time
from rdpi_gym.support.errors import InputError

def count(tell, to):
    for done in range(to + 1):
        tell.progress("counting", done, to)
        tell.news("number", done)
    print("a library talks")
    return to

def refuse(tell):
    raise InputError("run.csv, line 3: no number")

def fail(tell):
    raise ZeroDivisionError("nobody foresaw\\nthis")

def die(tell):
    os._exit(3)

def sleep(tell):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    tell.news("child", child.pid)
    time.sleep(60)
"""


@pytest.fixture
def tasks(tmp_path, monkeypatch):
    (tmp_path / "lab_tasks.py").write_text(TASKS)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", ":".join(filter(None, sys.path)))
    import lab_tasks

    yield lab_tasks
    sys.modules.pop("lab_tasks")


@pytest.fixture
def workers():
    made = Workers(partial(Worker, warm=False))
    yield made
    made.close()


def done(worker, task, **arguments):
    """Return all messages of a task."""
    heard, found = queue.Queue(), []
    worker.begin(task, arguments, heard.put)
    while not found or found[-1][0] not in ("done", "refused", "died"):
        found.append(heard.get(timeout=20))
    return found


def test_one_worker_after_the_other_task_says_what_it_does_and_what_was_wrong(tasks, workers):
    *told, end = done(workers, tasks.count, to=1000)
    assert end == ("done", 1000)
    assert [m[2] for m in told if m[0] == "news"] == list(range(1001))
    progress = [m[2] for m in told if m[0] == "progress"]
    assert (progress[0], progress[-1]) == (0, 1000)
    assert len(progress) < 20  # often enough
    assert done(workers, tasks.refuse) == [("refused", "run.csv, line 3: no number")]
    (failed,) = done(workers, tasks.fail)
    assert failed[1].count("\n") == 0
    assert "ZeroDivisionError: nobody foresaw this" in failed[1]
    (died,) = done(workers, tasks.die)
    assert died == ("died", "the process that did the work died (status 3); start it again")
    assert done(workers, tasks.count, to=1)[-1] == ("done", 1)


def test_a_cancel_ends_the_process_and_its_own_within_half_a_second(tasks, workers):
    heard = queue.Queue()
    workers.begin(tasks.sleep, {}, heard.put)
    _, _, child = heard.get(timeout=20)
    began = time.perf_counter()
    assert workers.cancel()
    assert time.perf_counter() - began < 0.5
    assert _ended(child)
    assert not workers.cancel()
    assert heard.empty()  # nothing is heard of it any more
    workers.begin(tasks.die, {}, heard.put, lambda: False)  # cancelled before it began
    assert not workers.cancel()


def _ended(pid):
    from pathlib import Path

    for _ in range(50):
        status = Path(f"/proc/{pid}/stat")
        if not status.exists() or status.read_text().rpartition(")")[2].split()[0] == "Z":
            return True
        time.sleep(0.01)
    return False
