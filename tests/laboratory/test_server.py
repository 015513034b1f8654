"""The server as it is asked: a record goes in, a model comes out, and it is there again afterwards."""

import http.client
import json
import subprocess
import sys
import time

import pytest

import rdpi_gym as rg
from rdpi_gym.cli import main
from rdpi_gym.laboratory.server import Server, bind, in_thread
from rdpi_gym.laboratory.session import Session


class Client:
    """Asks a server as the page does."""

    def __init__(self, place):
        self.place = place

    def ask(self, method, path, body=None, kind="application/json"):
        connection = http.client.HTTPConnection("127.0.0.1", self.place.port, timeout=60)
        sent = json.dumps(body).encode() if isinstance(body, dict) else body
        headers = {"Authorization": f"Bearer {self.place.token}", "Content-Type": kind}
        connection.request(method, path, sent, headers)
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())

    def get(self, path):
        status, found = self.ask("GET", path)
        assert status == 200, found
        return found

    def post(self, path, **said):
        status, found = self.ask("POST", f"/api/{path}", said)
        assert status == 200, found
        return found

    def refused(self, path, **said):
        status, found = self.ask("POST", f"/api/{path}", said)
        assert status == 400
        return found["problem"]

    def when(self, holds, seconds=60):
        for _ in range(5 * seconds):
            state = self.get("/api/state")
            if holds(state):
                return state
            time.sleep(0.2)
        raise AssertionError(state["problem"] or state["job"])


@pytest.fixture
def lab(tmp_path):
    server = Server(bind(), tmp_path / "session", processes=1)
    thread = in_thread(server)
    yield Client(server.place)
    server.stop()
    thread.join(10)


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    few = data.select("stairs", "sine-50hz", "validation-stairs", "quiet")
    return few.write(tmp_path_factory.mktemp("rig") / "records")


@pytest.mark.slow
def test_from_files_to_a_model_that_is_there_again(lab, records, tmp_path):
    for file in records.iterdir():
        status, state = lab.ask(
            "PUT", f"/api/files/{file.name}", file.read_bytes(), "application/octet-stream"
        )
        assert status == 200, state
    assert lab.refused("add", effect="creep").startswith("there is no model yet; drop a file")
    state = lab.post("open")
    roles = {record["name"]: record["role"] for record in state["records"]}
    assert roles.pop("quiet") == "quiet"
    assert roles == {"stairs": "train", "sine-50hz": "train", "validation-stairs": "validation"}
    state = lab.when(lambda s: s["path"])
    assert state["steps"]["s1"]["errors"]["validation_um"] < 0.1
    trace = lab.get("/api/trace?record=stairs&points=500")
    assert 200 < len(trace["t_s"]) == len(trace["residual_um"]) <= 502
    # a hand on a parameter moves the trace at once, and nothing else
    moved = lab.post("parameter", effect="", parameter="delta2_s", value=1e-3, record="stairs")
    assert moved["errors"]["train_um"] > state["steps"]["s1"]["errors"]["train_um"]
    assert moved["trace"]["model_um"] != trace["model_um"]
    assert lab.get("/api/state")["path"] == ["s1"]
    assert lab.refused("parameter", effect="creep", parameter="x", value=1).startswith(
        "creep has no parameter 'x'"
    )
    assert lab.refused("add", effect="crep").startswith("effect 'crep' is unknown; give one of ")
    assert lab.refused("undo") == "there is nothing to undo: this is the base model"
    began = time.perf_counter()
    state = lab.post("cancel")
    assert time.perf_counter() - began < 0.5
    assert state["job"] is None
    state = lab.post("parameter", effect="", parameter="delta2_s", value=1e-3, commit=True)
    assert state["path"] == ["s1", "s2"]
    state = lab.post("undo")
    assert (state["path"], state["redo"]) == (["s1"], ["s2"])
    again = Session(tmp_path / "session")  # as a server that follows reads it
    assert (again.path, again.redo) == (["s1"], ["s2"])
    assert [r.name for r in again.data.records] == [r["name"] for r in state["records"]]


def test_what_is_too_large_or_no_json_or_no_data_is_one_line(lab, monkeypatch):
    monkeypatch.setattr("rdpi_gym.laboratory.data_import.MOST_BYTES", 2**20)
    kind = "application/octet-stream"
    status, said = lab.ask("PUT", "/api/files/run.csv", bytes(2**20 + 1), kind)
    assert (status, said["problem"]) == (400, "the file is larger than 1 MiB; give a smaller one")
    assert lab.get("/api/state")["files"] == []
    assert lab.ask("POST", "/api/add", b"[1")[1] == {"problem": "the request is not JSON"}
    assert lab.ask("POST", "/api/add", b"3")[1]["problem"].startswith(
        "the request is no JSON object"
    )
    assert lab.refused("open") == "there are no data yet; drop a file"
    status, said = lab.ask("PUT", "/api/files/notes.docx", b"", kind)
    assert (status, said["problem"][:10]) == (400, "notes.docx")
    assert lab.get("/api/state")["files"][0]["problem"] == said["problem"]


@pytest.mark.parametrize(
    ("words", "line", "bound"),
    [(["nowhere.csv"], "nowhere.csv does not exist; give a data file or a folder of data files", ""),
     (["--session", "taken"], "--session taken holds no session of the laboratory; give its folder", ""),
     (["--port", "70000"], "'--port': ", "65535")],
)  # fmt: skip
def test_the_command_refuses_in_one_line_before_it_serves(
    words, line, bound, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "thesis.tex").touch()
    assert main(["lab", "--no-browser", *words]) == 2
    said = capsys.readouterr().err
    assert line in said
    assert bound in said.partition(line)[2]
    assert said.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]  # no session was begun


def test_a_port_that_is_taken_and_an_extra_that_is_missing_are_one_line(tmp_path, monkeypatch):
    place = bind()
    with pytest.raises(rg.InputError, match=f"--port {place.port} cannot be taken .*give another"):
        bind(place.port)
    place.socket.close()
    monkeypatch.setitem(sys.modules, "rdpi_gym.laboratory.server", None)
    monkeypatch.delattr("rdpi_gym.laboratory.server")
    with pytest.raises(rg.InputError, match=r"is missing; pip install 'rdpi-gym\[lab\]'"):
        rg.lab(browser=False, session=tmp_path)


def test_the_command_serves_until_it_is_interrupted(tmp_path):
    command = [sys.executable, "-m", "rdpi_gym", "lab", "--no-browser", "--session", "s"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path)
    address = process.stdout.readline().split()[-1]
    host, _, token = address.removeprefix("http://").partition("/#token=")
    connection = http.client.HTTPConnection(host, timeout=20)
    connection.request("GET", "/")
    page = connection.getresponse()
    assert page.status == 200
    assert b"<html" in page.read()
    for given, status in ((token, 200), ("other", 403)):
        connection.request("GET", "/api/state", headers={"Authorization": f"Bearer {given}"})
        answer = connection.getresponse()
        answer.read()
        assert answer.status == status
    process.terminate()
    assert process.wait(20) in (0, -15, 143)
    assert (tmp_path / "s" / "journal.jsonl").exists()
