"""Two pages act at once on one session, whose server is killed: nothing is mixed, lost or left over."""

import http.client
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from rdpi_gym.laboratory.session import Session

SEED = int(os.environ.get("RDPI_FUZZ_SEED", "0"))
TOP = Path(__file__).parents[2]
NAMES = ("a.csv", "b.csv", "validation-c.csv", "bad.csv", "dataset.toml")
ODD = (
    ("DELETE", "/api/files/a%00.csv"), ("DELETE", "/api/files/..%2f..%2fjournal.jsonl"),
    ("DELETE", "/api/files/.."), ("DELETE", "/api/files/%ff"), ("PUT", "/api/files/a%00.csv"),
    ("PUT", "/api/files/..%2f..%2fescaped.csv"), ("PUT", "/api/files/%0a.csv"), ("PUT", "/api/files/.csv"),
    ("GET", "/api/trace?record=a&points=" + "9" * 400), ("GET", "/api/trace?record=a&from_s=1e400"),
    ("GET", "/api/take/%00"), ("GET", "/api/brush?record=a&by=%00"), ("GET", "/api/views?record=%00"),
)  # fmt: skip
ACTIONS = 40
"""Actions of a page, of each of which the server may be killed."""
SAID = (
    ("parameter", {"effect": "", "parameter": "delta2_s", "value": 10**400, "commit": True}),
    ("parameter", {"effect": [], "parameter": "delta2_s", "value": 1e-3}),
    ("go", {"step": "s" + "9" * 5000}), ("go", {"step": 10**400}), ("settings", {"records": 3}),
    ("settings", {"title": ["\0"]}), ("settings", {"records": {"a": {"mask_s": [[10**400, 1]]}}}),
    ("core", {"core": "\0"}), ("payoff", {"reference": {"seconds": 10**400}}), ("example", {"key": {}}),
    ("hold", {"effect": {}, "parameter": "a", "held": 3}),
)  # fmt: skip
SENSIBLE = (
    ("open", {}), ("cancel", {}), ("rank", {}), ("undo", {}), ("redo", {}), ("refit", {}),
    ("add", {"effect": "creep"}), ("remove", {"effect": "creep"}), ("go", {"step": "s1"}),
    ("settings", {"records": {"a": {"role": "train"}}}), ("settings", {"title": "mine"}),
    ("parameter", {"effect": "", "parameter": "delta2_s", "value": 1e-3, "commit": True}),
    ("hold", {"effect": "", "parameter": "delta2_s", "held": True}),
)  # fmt: skip


def content(name, version):
    """Return a whole file that says which upload it is, from its first line to its last."""
    if name == "dataset.toml":
        return f'title = "{version}"\n'.encode() + f"# {version}\n".encode() * 2000
    rows = "".join(f"{0.02 * k:.2f},{k % 7},{(k % 7) * 2 + version % 5}\n" for k in range(400))
    rows = "no,numbers,here\n" if name == "bad.csv" else rows
    mark = f"# {version}\n"
    return (mark + "t,u,y\n" + rows + mark * 4000).encode()


class Page:
    """One tab: acts by chance, until the server dies."""

    def __init__(self, port, token, seed, sent, wrong):
        self.port, self.token, self.sent, self.wrong = port, token, sent, wrong
        self.rng = random.Random(f"page/{seed}")
        self.done = 0

    def ask(self, method, path, body=b"", kind="application/json"):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        headers = {"Authorization": f"Bearer {self.token}", "Content-Type": kind}
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        said = answer.read()
        connection.close()
        if answer.status >= 500 or (answer.status == 400 and b"\n" in said):
            self.wrong.append(f"{method} {path[:80]} {body[:80]!r}: {answer.status} {said[:300]!r}")
        self.done += 1
        return answer.status, said

    def upload(self, name, slowly=False):
        version = self.rng.randrange(10**9)
        whole = content(name, version)
        self.sent.setdefault(name, []).append(whole)

        def parts():
            for k in range(0, len(whole), len(whole) // 5):
                if slowly:
                    time.sleep(0.003)
                yield whole[k : k + len(whole) // 5]

        self.ask("PUT", f"/api/files/{name}", parts(), "application/octet-stream")

    def act(self):
        rng = self.rng
        what = rng.random()
        if what < 0.35:
            self.upload(rng.choice(NAMES), slowly=rng.random() < 0.5)
        elif what < 0.5:
            self.ask("DELETE", f"/api/files/{rng.choice(NAMES)}")
        elif what < 0.6:
            method, path = rng.choice(ODD)
            self.ask(method, path, b"a" if method == "PUT" else b"", "application/octet-stream")
        else:
            path, said = rng.choice(SAID if what < 0.7 else SENSIBLE)
            self.ask("POST", f"/api/{path}", json.dumps(said).encode())

    def run(self):
        try:
            for _ in range(ACTIONS):
                self.act()
        except (OSError, http.client.HTTPException):
            pass  # the server was killed


def begin(folder):
    command = [sys.executable, "-m", "tests.laboratory.served", str(folder)]
    place = {**os.environ, "PYTHONPATH": str(TOP)}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=TOP, env=place
    )
    port, token = process.stdout.readline().split()
    return process, int(port), token


def check_files(folder, sent):
    """Each file that is there is one upload, whole."""
    for place in (folder / "data", folder / "refused"):
        for path in place.iterdir() if place.exists() else ():
            if path.name.startswith(".") or path.name == "dataset.toml":
                continue  # of a writer that was killed; settings are written anew
            found = path.read_bytes()
            assert found == b"a" or found in sent[path.name], f"{path} is a mixture"
    assert not (folder.parent / "escaped.csv").exists()


@pytest.mark.skipif(os.name != "posix", reason="a process is killed by a signal")
def test_two_pages_at_once_and_a_server_that_is_killed(tmp_path):
    folder, sent, wrong, done = tmp_path / "session", {}, [], 0
    rng = random.Random(SEED)
    for lap in range(4):
        process, port, token = begin(folder)
        pages = [Page(port, token, f"{SEED}/{lap}/{k}", sent, wrong) for k in range(2)]
        pages[0].ask("GET", "/api/state")
        threads = [threading.Thread(target=page.run) for page in pages]
        for thread in threads:
            thread.start()
        last = lap == 3
        if not last:
            killed_after = rng.randrange(5, ACTIONS)
            while sum(page.done for page in pages) < killed_after:
                time.sleep(0.001)
            process.send_signal(signal.SIGKILL)
        for thread in threads:
            thread.join(120)
            assert not thread.is_alive(), "a request is never answered"
        done += sum(page.done for page in pages)
        if last:
            for name in NAMES:  # the next writer clears away what killed ones left
                pages[0].upload(name)
            state = json.loads(pages[0].ask("GET", "/api/state")[1])
            process.terminate()
        _, errors = process.communicate(timeout=20)
        assert "Traceback" not in errors, errors[-3000:]
        assert not wrong, "\n".join(wrong)
        check_files(folder, sent)
        again = Session(folder)  # the journal is readable, and folds to what the page was told
    assert done > 2 * ACTIONS
    assert (again.path, again.redo) == (state["path"], state["redo"])
    assert sorted(again.steps) == sorted(state["steps"])
    assert sorted(again.files) == [file["name"] for file in state["files"]]
    left = [path for path in folder.rglob(".*") if path.is_file()]
    assert not left, f"left over: {left}"
