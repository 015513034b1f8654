"""A laboratory that answers at once with made-up records: states that a real session reaches seldom or late."""

from __future__ import annotations

import asyncio
import itertools
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from unittest.mock import patch
from urllib.parse import quote

import numpy as np

import rdpi_gym as rg
from rdpi_gym.laboratory import actions, views
from rdpi_gym.laboratory.server import Server, bind, in_thread
from rdpi_gym.laboratory.session import Session, Step
from rdpi_gym.laboratory.session_json import state_of
from rdpi_gym.measurement import Record
from rdpi_gym.support.errors import InputError

_NOISE_UM = 0.021  # also where the state is an empty one: a page may still ask for views of before
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


PREVIEW = {
    "columns": [{"source": n, "name": n, "unit": n[-3:-1]} for n in ("Time [ms]", "Command [mV]")] + [{"source": 2, "name": "column 2", "unit": ""}],
    "rows": [["0.0", "12", "0.3"], ["0.1", "14", "0.4"]], "separator": {"chosen": "", "found": "semicolon"},
    "chosen": {"t": "Time [ms]", "u": "Command [mV]", "y": 2}, "units": {"t": "ms", "u": "mV", "y": "µm"},
    "ts_s": None, "alike": ["worse"], "taken": [],
}  # fmt: skip


class Laboratory:
    """The state of a session, behind the server of the laboratory on a free port."""

    def __init__(self, samples=20_000):
        self.t_s = np.arange(samples) * 5e-5
        self.seen = []  # what the page asked for: (method, path, body)
        self.refuse = None  # what the next action is answered with
        self.state = empty_state()
        self.told = itertools.count(1)
        self.place, self.port, self.running = None, 0, False
        self.names = {f"sine-{k:02d}" for k in range(3)}

    # -- the data and what a model makes of them: here a model is the names of its effects

    def measured(self, name):
        """Return a record, and the residual (µm) of a model with some effects."""
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
        parts = {effect: size * (shapes[effect] - shapes[effect].mean()) for effect, size in _PARTS}
        noise = 0.02 * np.random.default_rng(3).standard_normal(t.size)
        record = Record(name, t, u, y + noise + sum(parts.values()), ts_s=5e-5)
        return record, lambda effects: noise + sum(p for e, p in parts.items() if e not in effects)

    def displacement(self, effects, name, scale=1.0):
        record, residual = self.measured(name)
        return record.y_um - scale * residual(effects)

    def errors(self, effects):
        by = {r["name"]: float(np.sqrt(np.mean(self.measured(r["name"])[1](effects) ** 2)))
              for r in self.state["records"] if r["role"] in ("train", "validation")}  # fmt: skip
        train = max(by.values(), default=0.1)
        return {"train_um": 0.93 * train, "validation_um": train, "by_record_um": by}

    # -- what the page asks for

    async def act(self, name, _, body):
        self.seen.append(("POST", f"/api/{name}", body))
        if self.refuse:
            problem, self.refuse = self.refuse, None
            raise InputError(problem)
        state = self.state
        match name:
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
                    errors = {"train_um": 0.1 * scale, "validation_um": 0.12 * scale}
                    record, _ = self.measured(body["record"])
                    model_um = self.displacement(names_of(state), record.name, scale)
                    whole = views.stretch(record, None, None)
                    return {"errors": errors, "trace": views.trace(record, model_um, None, whole)}
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
        return self.telling()

    def parameter_of(self, body):
        step = self.state["steps"][self.state["current"]]
        effect = next(e for e in step["model"]["effects"] if e["name"] == body["effect"])
        return next(p for p in effect["parameters"] if p["name"] == body["parameter"])

    def open(self, records, effects=()):
        """Records are there, and the base model (and `effects`) is fitted."""
        roles = ["train", "validation", "train", "quiet", "test", "unused"]
        self.state = empty_state()
        self.state["title"] = "Made-up stage"
        self.state["noise_um"] = _NOISE_UM
        self.state["sentence"] = (
            "0.55 µm rms on held-out records, 26 noise floors: most in slow stretches of sine-05, which drift after every step."
        )
        for i in range(records):
            name = f"sine-{i:02d}"
            record, _ = self.measured(name)
            row = views.record_row(record, f"{name}.csv", {})
            self.state["records"].append(row | {"role": roles[i % 3 if i < 30 else i % 6]})
        self.state["files"] = [
            {"name": r["file"], "bytes": 480_000, "problem": None, "row": None, "column": None}
            for r in self.state["records"]
        ]
        self.step("Base model", [])
        for effect in effects:
            self.add(effect)
        self.push()

    def step(self, label, effects, effect=None):
        state = self.state
        id_ = f"s{len(state['steps'])}"
        plant = replace(rg.plants["P5"], effects=tuple(rg.effects[name]() for name in effects))
        made = {"kind": "added", "effect": effect}
        step = Step(id_, state["current"], label, made, plant, *self.errors(effects).values())
        state["steps"][id_] = views.step_row(step, str)
        state["path"].append(id_)
        state["redo"] = []
        self.go(id_)

    def add(self, effect):
        self.step(f"+ {effect}", [*names_of(self.state), effect], effect)

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

    # -- behind the server

    def telling(self):
        """Return the state with its place among all that were told."""
        return self.state | {"told": next(self.told)}

    def push(self, name="state", body=None):
        """Tell every page what changed."""
        if self.running:
            told = self.telling() if body is None else body
            self.loop.call_soon_threadsafe(self.events.push, name, told)

    def ask(self, name, answer, lab, asked):
        self.seen.append(("GET", f"/api/{name}", dict(asked)))
        if name == "preview":
            return PREVIEW | {"record": asked["file"].partition(".")[0]}
        return answer(lab, asked)

    async def put_file(self, name, write):
        self.seen.append(("PUT", f"/api/files/{quote(name)}", None))
        if name.endswith(".md"):
            raise InputError(f"{name} is no record; give a CSV file")
        entry = {"name": name, "bytes": 1, "problem": None, "row": None, "column": None}
        self.state["files"].append(entry)
        return self.telling()

    async def delete_file(self, name):
        self.state["files"] = [f for f in self.state["files"] if f["name"] != name]
        return self.telling()

    def data(self):
        names = {r["name"] for r in self.state["records"]}  # a page may still ask for one of before
        self.names = asked = self.names | names  # questions are answered in threads
        return SimpleNamespace(records=[self.measured(name)[0] for name in asked])

    def begun(self):
        self.loop, self.running = asyncio.get_running_loop(), True

    def start(self):
        """Serve, at the address of before where there was one."""
        before, self.place = self.place, bind(self.port)
        self.port = self.place.port
        if before is not None:
            self.place = replace(self.place, token=before.token)

        def opened(folder, events, processes):
            self.events = events
            return SimpleNamespace(
                state=self.telling, acting=asyncio.Lock(), start=self.begun, close=lambda: None,
                put_file=self.put_file, delete_file=self.delete_file, displacement=self.displacement,
                session=SimpleNamespace(need_data=self.data), noise_um=lambda: _NOISE_UM,
                plant_shown=lambda step: names_of(self.state),
                plant_with=lambda effect, step: [*names_of(self.state), effect],
            )  # fmt: skip

        self.patches = [
            patch("rdpi_gym.laboratory.server._lab", opened),
            patch.dict(
                actions.QUESTIONS,
                {q: partial(self.ask, q, a) for q, a in actions.QUESTIONS.items()},
            ),
            patch.dict(actions.ACTIONS, {a: partial(self.act, a) for a in actions.ACTIONS}),
        ]
        for each in self.patches:
            each.start()
        self.server = Server(self.place, Path(), processes=1)
        self.thread = in_thread(self.server)

    def stop(self):
        """Die: every connection breaks."""
        self.running = False
        self.server.stop()
        self.thread.join()
        for each in self.patches:
            each.stop()


with TemporaryDirectory(prefix="rdpi-lab-") as _folder:
    _EMPTY = state_of(Session(Path(_folder)), None, None, {})


def names_of(state):
    """Effects of the present model."""
    step = state["steps"].get(state["current"])
    return [e["name"] for e in step["model"]["effects"]] if step else []


def empty_state():
    """Return the state of a session in which nothing has happened."""
    return deepcopy(_EMPTY)


def payoff(step, reference):
    """Make up what compensators reach; one knows its plant exactly."""
    t = np.linspace(0, reference["seconds"], 400)
    r = reference["amplitude_um"] * np.sin(2 * np.pi * 4 * t / reference["seconds"])
    rows = [("none", 1.21, 1.20, None), ("classical inverse", 0.31, 0.302, None),
            ("extended inverse", 0.28, 1.7e-8, None), ("PI", 0.22, 0.17, "Outside its stability limit above 85 Hz: the loop's gain margin is 1.6 dB.")]  # fmt: skip
    return {
        "step": step, "reference": reference,
        "rows": [{"controller": c, "before_um": b, "after_um": a, "before_percent": 20 * b, "after_percent": 20 * a, "warning": w} for c, b, a, w in rows],
        "trace": {"t_s": t.tolist(), "reference_um": r.tolist(), "before_um": (0.9 * r - 0.2).tolist(), "after_um": (0.99 * r).tolist()},
    }  # fmt: skip
