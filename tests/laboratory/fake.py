"""A laboratory that answers at once with made-up records: states that a real session reaches seldom or late."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, unquote, urlsplit

import numpy as np
from plotly.offline import get_plotlyjs

import rdpi_gym

PAGE = Path(rdpi_gym.__file__).parent / "laboratory" / "page"
CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: "
    "blob:; connect-src 'self'; font-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
_PARTS = (("creep", 0.5), ("resonance", 0.22), ("delay", 0.09))  # µm that each leaves


def candidate(effect, title, mechanism, validation_um, **more):
    """Make a card; `state` and the rest as given."""
    x = np.linspace(0.0, 1.0, 40)
    without = np.sin(2 * np.pi * x)
    card = {
        "effect": effect,
        "title": title,
        "mechanism": mechanism,
        "picture": {
            "kind": "time",
            "x": x.tolist(),
            "y": (without + 0.3 * np.sin(9 * x + len(effect))).tolist(),
            "without": without.tolist(),
        },
        "state": "tried",
        "form": None,
        "validation_um": validation_um,
        "train_um": None if validation_um is None else 0.9 * validation_um,
        "share": None,
        "probability": None,
        "confidence": None,
        "rivals": [],
        "parameters": [{"name": "time constant", "symbol": "τ", "value_text": "0.42 s ± 0.03 s"}],
        "remarks": ["The time constant is the longest that the records can tell."],
        "added": False,
    }
    return card | more


CARDS = [
    candidate("creep", "Creep", "Domains go on switching after a step.", 0.118, share=0.81, probability=0.93, state="final"),
    candidate("thermal_drift", "Thermal drift", "Warming adds a slow displacement.", 0.261, share=0.44, probability=0.04, rivals=["creep"], state="final"),
    candidate("resonance", "Resonance", "The stage rings at its first mode.", 0.402, share=0.18, probability=0.02, state="final"),
    candidate("asymmetry", "Asymmetry", "Loops bend more on one side than on the other.", 0.455, share=0.07, probability=0.01, state="final"),
    candidate("sensor_lag", "Sensor lag", "The sensor's filter follows late.", None, state="refitting"),
    candidate("delay", "Delay", "Samples arrive some microseconds late.", None, state="waiting"),
    candidate("saturation", "Saturation", "The amplifier softens near its limits.", None, state="failed", remarks=["No start of the search converged."]),
]  # fmt: skip


def parameter(name, symbol, unit, value, **more):
    """Make one parameter of an effect."""
    known = {
        "standard_error": 0.04 * abs(value),
        "low": value / 50,
        "high": value * 50,
        "log": True,
    }
    return (
        {"name": name, "symbol": symbol, "unit": unit, "value": value, "held": False} | known | more
    )


PREVIEW = {
    "columns": [{"source": n, "name": n, "unit": n[-3:-1]} for n in ("Time [ms]", "Command [mV]")] + [{"source": 2, "name": "column 2", "unit": ""}],
    "rows": [["0.0", "12", "0.3"], ["0.1", "14", "0.4"]], "separator": {"chosen": "", "found": "semicolon"},
    "chosen": {"t": "Time [ms]", "u": "Command [mV]", "y": 2}, "units": {"t": "ms", "u": "mV", "y": "µm"},
    "ts_s": None, "alike": ["worse"],
}  # fmt: skip
EFFECTS = {
    "creep": ("Creep", [parameter("strength", "γ", "", 0.0153, low=0.0, high=0.1, log=False), parameter("time_constant_s", "τ", "s", 0.42)]),
    "resonance": ("Resonance", [parameter("frequency_hz", "f₀", "Hz", 812.0), parameter("damping", "ζ", "", 0.021)]),
    "delay": ("Delay", [parameter("delay_s", "τ", "s", 1.2e-4)]),
}  # fmt: skip


class Laboratory:
    """The state of a session, and a server on a free port that tells it."""

    def __init__(self, samples=20_000):
        self.t_s = np.arange(samples) * 5e-5
        self.seen = []  # what the page asked for: (method, path, body)
        self.refuse = None  # what the next action is answered with
        self.more = []  # events that wait to be sent
        self.clients = []
        self.state = empty_state()
        self.told = itertools.count(1)
        self.undone_cards = {}
        self.server = None
        self.port = 0

    # -- the data and what a model makes of them

    def signals(self, name, effects=(), scale=1.0):
        t = self.t_s
        f = 3.0 + 2.0 * (sum(map(ord, name)) % 5)
        u = 75 + 60 * np.sin(2 * np.pi * f * t) * (0.6 + 0.4 * np.sin(2 * np.pi * t))
        rising = np.gradient(u) > 0
        y = 0.12 * u + 1.1 * np.where(rising, -1.0, 1.0) * (1 - ((u - 75) / 62) ** 2)
        shapes = {
            "creep": 1 - np.exp(-t / 0.3),
            "resonance": np.sin(2 * np.pi * 90 * t) * np.abs(np.sin(2 * np.pi * f * t)),
            "delay": np.cos(2 * np.pi * f * t),
        }
        left = 0.02 * np.random.default_rng(3).standard_normal(t.size)
        for effect, size in _PARTS:
            left = left + (0.0 if effect in effects else size) * (
                shapes[effect] - shapes[effect].mean()
            )
        return t, u, y + left, y, scale * left

    def errors(self, effects):
        by = {r["name"]: float(np.sqrt(np.mean(self.signals(r["name"], effects)[4] ** 2)))
              for r in self.state["records"] if r["role"] in ("train", "validation")}  # fmt: skip
        train = max(by.values(), default=0.1)
        return {"train_um": 0.93 * train, "validation_um": train, "by_record_um": by}

    def trace(self, asked, scale=1.0):
        effects = [] if self.state["current"] is None else names_of(self.state)
        t, u, y, model, left = self.signals(asked["record"], effects, scale)
        first, last = float(asked.get("from_s") or t[0]), float(asked.get("to_s") or t[-1])
        k = np.flatnonzero((t >= first - 1e-12) & (t <= last + 1e-12))
        k = k[:: max(1, k.size // int(asked.get("points") or 3000))]
        other = None
        if asked.get("effect"):
            other = self.signals(asked["record"], [*effects, asked["effect"]])[4][k].tolist()
        masked = [r["masked_s"] for r in self.state["records"] if r["name"] == asked["record"]]
        return {
            "record": asked["record"], "t_s": t[k].tolist(), "u": u[k].tolist(), "y_um": y[k].tolist(),
            "model_um": model[k].tolist(), "residual_um": left[k].tolist(), "other_um": other,
            "counted": masked[0] if masked else [],
        }  # fmt: skip

    def views(self, asked, part=None):
        _, u, y, model, left = self.signals(asked["record"], names_of(self.state))
        k = slice(None, None, 20) if part is None else slice(part[0], part[1], 20)
        over = np.linspace(15, 135, 25)
        size = 0.1 + 0.3 * np.abs(np.sin(over / 30)) * math.sqrt(np.mean(left[k] ** 2))
        rate = np.geomspace(1, 2000, 20)
        hz = np.geomspace(1, 2000, 60)
        if part is not None:
            over, size, rate, hz = over[5:12], size[5:12], rate[4:9], hz[20:30]
        spread = {
            "mean_um": (0.3 * size).tolist(),
            "low_um": (-size).tolist(),
            "high_um": size.tolist(),
        }
        made = {
            "command": {"u": over.tolist(), "rms_um": size.tolist(), **spread},
            "rate": {"rate": rate.tolist(), "rms_um": (0.02 + 0.1 * np.log10(1 + rate)).tolist()},
            "frequency": {"hz": hz.tolist(), "um": (0.2 / (1 + hz / 10)).tolist()},
            "rest": {"s": [], "um": []},
            "loop": {"u": u[k].tolist(), "y_um": y[k].tolist(), "model_um": model[k].tolist()},
            "noise_um": self.state["noise_um"],
        }
        return (
            made if part is None else made | {"spans_s": [[0.2, 0.3], [0.6, 0.7]], "rms_um": 0.21}
        )

    # -- what the page asks for

    def act(self, path, body):
        if self.refuse:
            problem, self.refuse = self.refuse, None
            return 400, {"problem": problem}
        state = self.state
        match path.removeprefix("/api/"):
            case "open" | "example":
                self.open(3)
            case "add":
                self.add(body["effect"])
            case "remove":
                kept = [e for e in names_of(state) if e != body["effect"]]
                self.step(f"without {body['effect']}", kept)
            case "undo":
                state["redo"].append(state["path"].pop())
                self.go(state["path"][-1])
            case "redo":
                state["path"].append(state["redo"].pop())
                self.go(state["path"][-1])
            case "go":
                self.go(body["step"])
            case "hold":
                self.parameter_of(body)["held"] = body["held"]
            case "parameter":
                scale = 0.5 + body["value"] / (2 * self.parameter_of(body)["value"])
                if not body["commit"]:
                    return 200, {
                        "errors": {"train_um": 0.1 * scale, "validation_um": 0.12 * scale},
                        "trace": self.trace(body, scale),
                    }
                self.step("set by hand", names_of(state))
                self.parameter_of(body)["value"] = body["value"]
            case "settle":
                self.step("In few numbers", names_of(state))
            case "cancel":
                state["job"] = None
                if state["ranking"]:
                    state["ranking"]["status"] = "cancelled"
            case "settings":
                for name, change in body.get("records", {}).items():
                    for record in [r for r in state["records"] if r["name"] == name]:
                        record.update(change)
                state["files"] = [f for f in state["files"] if not f["problem"]]
            case "payoff":
                state["payoff"] = payoff(state["current"], body["reference"])
        self.push()
        return 200, self.telling()

    def parameter_of(self, body):
        step = self.state["steps"][self.state["current"]]
        effect = next(e for e in step["model"]["effects"] if e["name"] == body["effect"])
        return next(p for p in effect["parameters"] if p["name"] == body["parameter"])

    def open(self, records, effects=()):
        """Records are there, and the base model (and `effects`) is fitted."""
        roles = ["train", "validation", "train", "quiet", "test", "unused"]
        self.state = empty_state()
        self.state["title"] = "Made-up stage"
        self.state["noise_um"] = 0.021
        self.state["sentence"] = (
            "0.55 µm rms on held-out records, 26 noise floors: most in slow stretches of sine-05, which drift after every step."
        )
        for i in range(records):
            name = f"sine-{i:02d}"
            t, u, y, *_ = self.signals(name)
            self.state["records"].append({
                "name": name, "file": f"{name}.csv", "role": roles[i % 3 if i < 30 else i % 6], "rows": t.size, "ts_s": 5e-5,
                "duration_s": float(t[-1]), "u": [float(u.min()), float(u.max())], "y": [float(y.min()), float(y.max())],
                "skip_s": 0.0, "masked_s": [], "thumbnail": {"u": u[:4000:50].tolist(), "y": y[:4000:50].tolist()},
            })  # fmt: skip
        self.state["files"] = [
            {"name": r["file"], "bytes": 480_000, "problem": None, "row": None, "column": None}
            for r in self.state["records"]
        ]
        self.state["settings"] = {
            "cores": [{"key": "rdpi", "title": "Rate-dependent Prandtl-Ishlinskii"}, {"key": "preisach", "title": "Preisach"}],
        }  # fmt: skip
        self.step("Base model", [])
        for effect in effects:
            self.add(effect)
        self.push()

    def step(self, label, effects, effect=None):
        state = self.state
        id_ = f"s{len(state['steps'])}"
        have = [
            {
                "name": e,
                "title": EFFECTS[e][0],
                "form": None,
                "parameters": [dict(p) for p in EFFECTS[e][1]],
            }
            for e in effects
        ]
        model = {
            "core": "rdpi",
            "core_title": "Rate-dependent Prandtl-Ishlinskii, 48 plays",
            "core_parameters": [parameter("delta2_s", "δ2", "s", 1.5e-4)],
            "effects": have,
        }
        state["steps"][id_] = {
            "id": id_,
            "parent": state["current"],
            "label": label,
            "effect": effect,
            "errors": self.errors(effects),
            "model": model,
        }
        state["path"].append(id_)
        state["redo"] = []
        self.go(id_)

    def add(self, effect):
        self.step(f"+ {EFFECTS[effect][0].lower()}", [*names_of(self.state), effect], effect)

    def go(self, step):
        state = self.state
        state["current"] = step
        have = names_of(state)
        state["ranking"] = {
            "step": step, "status": "done", "verdict": "Creep is missing, at 93 %: it takes 81 % of what is left above the noise.",
            "cards": [card | {"added": card["effect"] in have} for card in CARDS],
            "lines": ["On records held out the error falls from 0.55 to 0.12 µm.", "Thermal drift explains half as much and is told apart by the holds."],
            "left": {
                "sentence": "0.12 µm is left, 5.6 noise floors; it follows from the command.",
                "portrait_lines": ["It sits behind the hysteresis, has a memory of about 2 ms, and grows with the rate."],
                "next_experiment": "A chirp from 100 Hz to 2 kHz at 2 V would tell a resonance from a sensor lag.",
                "experiment": {"title": "Chirp, 100 Hz to 2 kHz", "rate_hz": 20000.0, "seconds": 1.0, "unit": "V",
                               "t_s": np.linspace(0, 1, 400).tolist(), "u": np.sin(60 * np.linspace(0, 1, 400) ** 2).tolist()},
            },
        }  # fmt: skip

    # -- the server

    def telling(self):
        """Return the state with its place among all that were told."""
        return self.state | {"told": next(self.told)}

    def push(self, name="state", body=None):
        """Tell every page what changed."""
        told = json.dumps(self.telling() if body is None else body)
        data = f"event: {name}\ndata: {told}\n\n".encode()
        for client in list(self.clients):
            client.append(data)

    def start(self, port=0):
        laboratory = self

        class Handler(_Handler):
            lab = laboratory

        self.server = _Server(("127.0.0.1", port), Handler)
        self.port = self.server.server_port
        self.running = True
        threading.Thread(
            target=self.server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True
        ).start()

    def stop(self):
        """Die: every connection breaks."""
        self.running = False
        self.server.shutdown()
        self.server.server_close()
        self.clients.clear()


class _Server(ThreadingHTTPServer):
    allow_reuse_address = True
    daemon_threads = True
    # A page asks for two dozen files at once. Of five that wait the sixth is dropped, and asked for
    # again after one, three, seven seconds.
    request_queue_size = 128


class _Handler(BaseHTTPRequestHandler):
    lab: Laboratory

    def log_message(self, *args):
        pass

    def answer(self, status, content, kind="application/json"):
        data = content if isinstance(content, bytes) else json.dumps(content).encode()
        self.send_response(status)
        for name, value in (
            ("Content-Type", f"{kind}; charset=utf-8"),
            ("Content-Length", len(data)),
            ("Content-Security-Policy", CSP),
        ):
            self.send_header(name, str(value))
        self.end_headers()
        self.wfile.write(data)

    def body(self):
        return self.rfile.read(int(self.headers.get("Content-Length") or 0))

    def do_GET(self):
        path, asked = (
            urlsplit(self.path).path,
            {k: v[0] for k, v in parse_qs(urlsplit(self.path).query).items()},
        )
        lab = self.lab
        if path.startswith("/api/"):
            lab.seen.append(("GET", path, asked))
        match path:
            case "/":
                self.answer(200, (PAGE / "index.html").read_bytes(), "text/html")
            case "/plotly.js":
                self.answer(200, _plotly(), "text/javascript")
            case "/api/state":
                self.answer(200, lab.telling())
            case "/api/events":
                self.events()
            case "/api/examples":
                self.answer(200, EXAMPLES)
            case "/api/preview":
                self.answer(200, PREVIEW | {"record": asked["file"].partition(".")[0]})
            case "/api/trace":
                self.answer(200, lab.trace(asked))
            case "/api/views":
                self.answer(200, lab.views(asked))
            case "/api/brush":
                self.answer(200, lab.views(asked, part=(2000, 6000)))
            case _ if (file := PAGE / path.lstrip("/")).is_file():
                self.answer(200, file.read_bytes(), _TYPES[file.suffix])
            case _:
                self.answer(404, {"problem": f"Nothing is at {path}."})

    def do_POST(self):
        body = json.loads(self.body() or b"{}")
        self.lab.seen.append(("POST", self.path, body))
        self.answer(*self.lab.act(self.path, body))

    def do_PUT(self):
        name = unquote(self.path.rpartition("/")[2])
        self.lab.seen.append(("PUT", self.path, self.body()))
        if name.endswith(".md"):
            self.answer(400, {"problem": f"{name} is no record; give a CSV file"})
            return
        self.lab.state["files"].append(
            {"name": name, "bytes": 1, "problem": None, "row": None, "column": None}
        )
        self.answer(200, self.lab.telling())

    def do_DELETE(self):
        name = unquote(self.path.rpartition("/")[2])
        self.lab.state["files"] = [f for f in self.lab.state["files"] if f["name"] != name]
        self.answer(200, self.lab.telling())

    def events(self):
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.end_headers()
        mine, lab = [], self.lab
        lab.clients.append(mine)
        with contextlib.suppress(OSError):
            while lab.running:
                while mine:
                    self.wfile.write(mine.pop(0))
                self.wfile.flush()
                threading.Event().wait(0.01)
            self.connection.close()


def _plotly(cache=[]):  # noqa: B006
    if not cache:
        cache.append(get_plotlyjs().encode())
    return cache[0]


EXAMPLES = [
    {"key": "stage", "title": "A slow stage", "text": "One effect is hidden. It shows in the holds.", "kind": "exercise", "records": 6, "samples": 120_000},
    {"key": "fast", "title": "A scanner at its limits", "text": "Two effects are hidden; the second shows when the first is found.", "kind": "exercise", "records": 5, "samples": 90_000},
    {"key": "picma", "title": "PICMA stack", "text": "Measured stack actuator, 0 to 100 V.", "kind": "measured", "records": 1, "samples": 100_000},
]  # fmt: skip


def names_of(state):
    """Effects of the present model."""
    step = state["steps"].get(state["current"])
    return [e["name"] for e in step["model"]["effects"]] if step else []


def empty_state():
    """Return the state of a session in which nothing has happened."""
    quantities = {
        "input": {"name": "voltage", "symbol": "u", "unit": "V"},
        "output": {"name": "displacement", "symbol": "y", "unit": "µm"},
    }
    return {
        "title": "", "session_folder": "rdpi-lab-2026-01-01-120000", "problem": None, "quantities": quantities, "files": [],
        "records": [], "settings": {}, "noise_um": None, "steps": {}, "path": [], "redo": [], "current": None, "sentence": None,
        "ranking": None, "job": None, "payoff": None,
    }  # fmt: skip


def payoff(step, reference):
    """Make up what compensators reach."""
    t = np.linspace(0, reference["seconds"], 400)
    r = reference["amplitude_um"] * np.sin(2 * np.pi * 4 * t / reference["seconds"])
    rows = [("none", 1.21, 1.20, None), ("classical inverse", 0.31, 0.302, None),
            ("extended inverse", 0.28, 0.031, None), ("PI", 0.22, 0.17, "Outside its stability limit above 85 Hz: the loop's gain margin is 1.6 dB.")]  # fmt: skip
    return {
        "step": step, "reference": reference,
        "rows": [{"controller": c, "before_um": b, "after_um": a, "before_percent": 20 * b, "after_percent": 20 * a, "warning": w} for c, b, a, w in rows],
        "trace": {"t_s": t.tolist(), "reference_um": r.tolist(), "before_um": (0.9 * r - 0.2).tolist(), "after_um": (0.99 * r).tolist()},
    }  # fmt: skip
