"""The catalogue: files found by themselves, installed effects, a user's own."""

import subprocess
import sys
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

import rdpi_gym.plant.effects as room
from rdpi_gym.plant import P5, Plant
from rdpi_gym.plant.effects import (
    CATALOGUE,
    SLOTS,
    Effect,
    Parameter,
    check_effect,
    forms_of,
    load_effect,
)
from rdpi_gym.plant.effects.description import describe, page, pages
from rdpi_gym.support.errors import InputError
from tests.looping import over
from tests.plant.additions import EFFECT

OWN = EFFECT["rdpi_gym/plant/effects/lever_ratio.py"]


@pytest.fixture
def own_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])

    def write(text: str = OWN) -> str:
        name = f"own_effect_{abs(hash((text, str(tmp_path))))}"
        Path(f"{name}.py").write_text(text)
        return f"{name}:Bend"

    return write


def installed(monkeypatch, *entries: EntryPoint) -> room.Catalogue:
    monkeypatch.setattr(
        room, "entry_points", lambda group: [e for e in entries if e.group == group]
    )
    return room.Catalogue()


def test_the_catalogue_stands_in_the_order_of_the_chain():
    assert list(CATALOGUE)[:4] == ["saturation", "slew_limit", "actuator_lag", "rate_law"]
    assert list(CATALOGUE)[-3:] == ["delay", "sensor_lag", "mains_hum"]
    places = [(SLOTS.index(kind.slot), kind.order) for kind in CATALOGUE.values()]
    assert places == sorted(set(places))
    assert all(CATALOGUE[name].name == name for name in CATALOGUE)


def test_a_file_of_the_room_is_a_helper_or_holds_the_effect_that_it_is_named_after():
    files = {path.stem for path in Path(room.__file__).parent.glob("*.py")}
    helpers = {"__init__", "base", "description", "knots", "linear"}
    assert files - {*CATALOGUE, "unknown"} == helpers
    for name in {*CATALOGUE, "unknown"}:
        assert CATALOGUE[name].__module__ == f"{room.__name__}.{name}"


@over("name", CATALOGUE)
def test_what_an_effect_says_of_itself_is_whole(name):
    kind = CATALOGUE[name]
    assert check_effect(kind, name) is kind
    assert set(kind.mistaken_for) <= set(CATALOGUE) - {name}
    for text in (kind.equation, kind.source, kind.signature, kind.experiment):
        assert len(text) > 10
        assert "\n" not in text
    told = describe(kind)
    assert all(p["meaning"] and p["unit"] for p in told["parameters"])
    words = page(kind)
    for text in (kind.equation, kind.source, kind.signature, kind.experiment):
        assert text in words
    assert words in pages(CATALOGUE.values())


def test_who_is_mistaken_for_whom_goes_both_ways_within_the_family_of_lags():
    family = {"delay", "actuator_lag", "sensor_lag", "resonance"}
    for name in family:
        assert family - {name} <= set(CATALOGUE[name].mistaken_for)


def test_a_users_own_effect_takes_under_forty_lines_and_runs_in_a_plant(own_file):
    assert len(OWN.splitlines()) < 40
    kind = load_effect(own_file())
    assert issubclass(kind, Effect)
    u, own = np.random.default_rng(0).normal(0, 5, 50), replace(P5, effects=(kind(share=0.1),))
    y = Plant(P5, 1e-3).simulate(u)
    np.testing.assert_allclose(Plant(own, 1e-3).simulate(u), y + 0.001 * y**3, rtol=1e-12)


@over(
    "change, words",
    [
        (("    name = ", "    nam = "), "does not state name"),
        (('"output"', '"behind"'), "has slot 'behind'; slots are input, rate, memory"),
        (("def state_rows", "def rows"), "lacks state_rows"),
        (("    share: float", "    part: float"), "has the fields ['part'] and states"),
        (("share: float = 0.01", "share: float"), "cannot be made with its defaults"),
        (("= 0.01\n", "= 0.7\n"), "has a default outside its bounds"),
        (("[self.share / 100.0]", "[float('nan')]"), "they are finite numbers"),
        (("staticmethod(bend_block)", "None"), "has a block that is no kernel"),
        (("Bend(Effect)", "Bend(object)"), "is Bend; an effect is a subclass"),
    ],
)
def test_an_incomplete_effect_is_refused_in_one_line(own_file, change, words):
    assert change[0] in OWN
    with pytest.raises(InputError) as refusal:
        load_effect(own_file(OWN.replace(*change)))
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


@over(
    "name, words",
    [
        ("crep", "no effect is named 'crep'; known are saturation"),
        ("no_such_module_here:Sag", "cannot be imported"),
        ("math:nothing", "has no 'nothing'"),
        ("math:pi", "is a float"),
        (":Sag", "names no effect"),
    ],
)
def test_an_unknown_effect_is_refused_in_one_line(name, words):
    with pytest.raises(InputError) as refusal:
        load_effect(name)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_form_is_found_by_its_name_and_an_unknown_one_refused(own_file):
    assert load_effect("creep", "two time constants").form == "two time constants"
    assert load_effect("creep", "") is CATALOGUE["creep"]
    with pytest.raises(InputError, match=r"^effect creep: no form is named 'x'; .* one time const"):
        load_effect("creep", "x")
    with pytest.raises(InputError, match=r"no form is named 'x'; .* further forms are none"):
        load_effect(own_file(), "x")


def test_an_installed_effect_is_found_by_its_entry_point(own_file, monkeypatch):
    target = own_file(OWN.replace('"lever_ratio"', '"lever_share"'))
    load_effect(target)  # puts the folder on the path, as an installed package is
    found = installed(monkeypatch, EntryPoint("lever", target, "rdpi_gym.effects"))
    assert found["lever_share"]().values == {"share": 0.01}
    assert set(found) == set(CATALOGUE) | {"lever_share"}
    names = list(found)
    assert names.index("creep") < names.index("lever_share") < names.index("resonance")


def test_a_broken_or_clashing_installed_effect_is_named(own_file, monkeypatch):
    broken = installed(monkeypatch, EntryPoint("bad", "no_such_module_x:Y", "rdpi_gym.effects"))
    with pytest.raises(InputError, match=r"'bad' \(no_such_module_x:Y\) cannot be imported"):
        list(broken)
    assert broken["creep"].name == "creep"  # what does not need it still works
    target = own_file(OWN.replace('"lever_ratio"', '"creep"'))
    load_effect(target)
    clash = installed(monkeypatch, EntryPoint("mine", target, "rdpi_gym.effects"))
    with pytest.raises(InputError, match="is named 'creep', as another effect is"):
        list(clash)


def test_importing_the_room_imports_no_effect_and_nothing_heavy():
    code = (
        "import sys, rdpi_gym.plant.effects; "
        "heavy = ('rdpi_gym.plant.effects.creep', 'scipy.linalg', 'scipy.signal', 'pandas', 'rich'); "
        "print([m for m in heavy if m in sys.modules])"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


def own_forms():
    @dataclass(frozen=True)
    class Sag(Effect):
        share: float = 0.02

        name, slot, order = "sag", "output", 15
        parameters = (Parameter("share", "1", 0.0, 0.5, (0.01, 0.05), "share", 0.0),)
        equation, source = "y = (1 - s) y_m", "Springs in series."
        signature, experiment, mistaken_for = "Less of all.", "Any.", ("gain_drift",)
        block = staticmethod(lambda x, u, p, state, ts, y: None)

        def coefficients(self, ts_s, hysteresis):
            return list(self.values.values())

        def state_rows(self, ts_s):
            return 0

    @dataclass(frozen=True)
    class Bent(Sag, of=Sag):
        share: float = 0.02
        bend: float = 0.0

        form = "bent"
        parameters = (*Sag.parameters, Parameter("bend", "1", -1.0, 1.0, (0.0, 0.1), "bend", 0.0))

    return Sag, Bent


def test_a_form_is_found_from_any_other_and_shares_what_it_does_not_state():
    simplest, bent = own_forms()
    assert forms_of(simplest) == forms_of(bent) == (simplest, bent)
    assert (bent.name, bent.slot, bent.order, bent.source) == ("sag", "output", 15, simplest.source)
    assert (simplest.full_name(), bent.full_name()) == ("sag", "sag, bent")
    assert check_effect(simplest, "own") is simplest


def test_a_form_has_what_a_base_that_it_shares_states_before_what_the_simplest_does():
    simplest, _ = own_forms()

    class Arch(Effect):
        source, cause = "Arches.", "An arch gives way."

    @dataclass(frozen=True)
    class Arched(Arch, simplest, of=simplest):
        share: float = 0.02

        form, cause = "arched", "It is arched."

    assert (Arched.source, Arched.cause) == ("Arches.", "It is arched.")
    assert (Arched.name, Arched.signature) == ("sag", simplest.signature)
    filtering = load_effect("sensor_lag", "fourth order")
    assert filtering.source.startswith("Filters of Bessel")
    assert filtering.cause.startswith("A filter in front of a converter")
    assert filtering.remedy == CATALOGUE["sensor_lag"].remedy


def test_a_form_that_is_not_whole_is_refused_with_its_effect():
    simplest, bent = own_forms()
    bent.form = ""
    with pytest.raises(InputError, match="each has the name 'sag' and a form of its own"):
        check_effect(simplest, "own")
    bent.form, bent.name = "bent", "sagging"
    with pytest.raises(InputError, match="bent' of sagging; each has the name 'sag'"):
        check_effect(simplest, "own")
    bent.name, bent.parameters = "sag", bent.parameters[:1]
    with pytest.raises(InputError, match="own, form 'bent' has the fields"):
        check_effect(simplest, "own")
