"""Settings: what a controller may be turned to, and which of the committed ones it takes."""

import json
from dataclasses import replace
from importlib.util import find_spec

import pytest

from baselines import CONTROLLERS, make_controller, tuning
from baselines.feedforward import StaticGain
from baselines.tuning import Knob, Tunable, Tuning, read_tunings, write_tunings
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.tasks import TASKS
from rdpi_gym.plant import P5
from rdpi_gym.plant.effects import load_effect
from rdpi_gym.support.errors import InputError

FOLDER = tuning.TUNED
KNOBS = (Knob("share", 0.5, 1.5, 1.0), Knob("cutoff_hz", 1.0, 1e3, 10.0, "Hz", True))
LAYOUT = ObservationLayout.for_plant(P5, ts_s=1e-3)
RINGING = replace(P5, effects=(load_effect("resonance")(f0_hz=400.0),))


def found(share, effects=()):
    return Tuning({"share": share}, effects, "rdpi tune turned", 3, 1000, 0.5)


@pytest.fixture
def turned(tmp_path, monkeypatch):
    """A controller with knobs, and settings of it for two tasks."""

    class Turned(Tunable, StaticGain):
        name = "turned"
        knobs = KNOBS

    monkeypatch.setattr(tuning, "TUNED", tmp_path)
    tasks = {"Resonance": found(1.2, ("resonance",)), "Bare": found(0.9)}
    write_tunings(tmp_path / "turned.json", "turned", tasks)
    return Turned


def test_the_settings_of_the_task_that_differs_in_the_fewest_effects_are_taken(turned):
    assert turned(P5, LAYOUT).settings == {"share": 0.9, "cutoff_hz": 10.0}
    assert turned(RINGING, LAYOUT).settings["share"] == 1.2
    creeping = replace(P5, effects=(load_effect("creep")(),))
    assert turned(creeping, LAYOUT).settings["share"] == 0.9
    given = turned(RINGING, LAYOUT, {"share": 0.7})
    assert given.settings["share"] == 0.7
    assert (given.plant_samples, turned(RINGING, LAYOUT).plant_samples) == (0, 1000)


REFUSED = (
    ({"shade": 1.0}, "turned has no setting 'shade'; did you mean 'share'? It has share, cut"),
    ({"share": 2.0}, "share is 2.0; give 0.5 to 1.5"),
    ({"cutoff_hz": float("nan")}, "cutoff_hz is nan; give 1 to 1000 Hz"),
    ({"cutoff_hz": "10"}, "cutoff_hz is '10'; give 1 to 1000 Hz"),
)
DAMAGED = (
    (["controller"], "pi", "holds settings of 'pi'; give those of turned"),
    (["tasks"], [], "tasks is []"),
    (["tasks", "Bare", "settings", "share"], 7, "task Bare: share is 7; give 0.5 to 1.5"),
    (["tasks", "Bare", "settings"], {"os": 1}, "task Bare: turned has no setting 'os'"),
    (["tasks", "Bare", "seed"], -1, "task Bare: seed is -1"),
    (["tasks", "Bare"], 3, "task Bare is 3; give command"),
)


def test_bad_settings_and_damaged_files_are_one_clear_line(turned, tmp_path):
    for settings, words in REFUSED:
        with pytest.raises(InputError) as error:
            turned(P5, LAYOUT, settings)
        assert str(error.value).startswith(words)
        assert "\n" not in str(error.value)
    for keys, value, words in DAMAGED:
        path = write_tunings(tmp_path / "turned.json", "turned", {"Bare": found(0.9)})
        document = place = json.loads(path.read_text())
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value
        path.write_text(json.dumps(document))
        with pytest.raises(InputError, match=r"turned\.json") as error:
            read_tunings(path, "turned", KNOBS)
        assert words in str(error.value)


def test_every_committed_file_is_of_a_controller_that_takes_it():
    for path in tuning.TUNED.glob("*.json"):
        factory = CONTROLLERS[path.stem]
        kind = getattr(factory, "func", factory)
        assert read_tunings(path, kind.name, kind.knobs), path


def test_no_settings_that_ship_leave_a_loop_outside_its_stability_limit():
    for file in sorted(FOLDER.glob("*.json")):
        if file.stem == "h-infinity" and not find_spec("slycot"):
            continue
        for name in json.loads(file.read_text())["tasks"]:
            task = TASKS[name]
            controller = make_controller(file.stem, task.belief(), task.layout())
            assert "stability limit" not in (controller.warning() or ""), (file.stem, name)
