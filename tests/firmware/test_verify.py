"""`verify`: what agrees, what does not, and what cannot be verified."""

import json
import os
import shutil

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.firmware.making import package_again, package_of
from rdpi_gym.firmware.verify import verify
from rdpi_gym.firmware.writing.package import write_package
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError
from tests.firmware.programs import needs_compiler

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    package = package_of(named_plant("P5"), 1e-4, "pi-classical-static")
    return write_package(package, tmp_path_factory.mktemp("export") / "firmware")


@pytest.fixture
def folder(exported, tmp_path):
    return shutil.copytree(exported, tmp_path / "firmware")


def test_it_agrees_in_every_precision(folder):
    found = verify(folder, records=30, samples=200)
    assert found.passed
    assert [(row.what, row.precision) for row in found.rows] == [
        (what, precision)
        for what in ("vectors", "records", "wild inputs")
        for precision in ("double", "float", "Q31")
    ]
    assert [row.samples for row in found.rows[:4]] == [2000, 2000, 2000, 6000]
    assert "ok" in str(found)
    assert "FAILED" not in str(found)


def test_a_plant_agrees_and_records_depend_on_the_seed(folder, tmp_path):
    plant = write_package(package_of(named_plant("P5"), 1e-4), tmp_path / "plant")
    assert verify(plant, records=10, samples=200).passed
    largest = {verify(folder, records=3, samples=50, seed=s).rows[4].largest for s in (1, 2)}
    assert len(largest) == 2


def test_code_that_was_changed_is_found_and_named(folder):
    path = folder / "rdpi_controller.c"
    text = path.read_text()
    path.write_text(text.replace("reference_um - measured_um", "reference_um + measured_um"))
    found = verify(folder, records=5, samples=100)
    assert not found.passed
    assert "FAILED" in str(found)
    assert any("rdpi_controller.c is not what this release would write" in r for r in found.remarks)


def test_code_that_is_wrong_in_some_samples_is_found(folder):
    path = folder / "rdpi_controller.c"
    wrong = "return command_V + (rdpi_real)((reference_um > 0) ? 1 : 0);"
    path.write_text(path.read_text().replace("return command_V;", wrong))
    found = verify(folder, records=5, samples=100)
    assert not next(row for row in found.rows if row.what == "records").passed


def test_an_answer_out_of_range_is_found(folder):
    path = folder / "rdpi_controller.c"
    path.write_text(
        path.read_text().replace("return command_V;", "return command_V * RDPI_CONTROLLER_HIGH_V;")
    )
    assert not any(
        row.passed
        for row in verify(folder, records=5, samples=100).rows
        if row.what == "wild inputs" and row.precision != "Q31"
    )


def test_code_that_does_not_compile_or_crashes_and_no_compiler_are_one_line(folder, monkeypatch):
    path = folder / "rdpi_controller.c"
    text = path.read_text()
    path.write_text("int broken(")
    with pytest.raises(InputError, match="refuses the code"):
        verify(folder)
    crash = text.replace("s->applied_V = RDPI", "abort();\n    s->applied_V = RDPI")
    path.write_text("#include <stdlib.h>\n" + crash)
    with pytest.raises(InputError, match="status -6"):
        verify(folder)
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CC", "mycc -O3")
    with pytest.raises(InputError, match=r"mycc -O3, which is not there.*install gcc or clang"):
        verify(folder)


def changed(folder, **keys):
    path = folder / "program.json"
    document = json.loads(path.read_text()) | keys
    path.write_text(json.dumps({k: v for k, v in document.items() if v != "gone"}))
    return folder


REFUSED = [
    ({"controller": "os:system"}, "'os:system' is no controller"),
    ({"controller": 3}, "neither a plant nor a controller"),
    ({"kind": "virus"}, "neither a plant nor a controller"),
    ({"code": "x"}, "unknown key 'code'"),
    ({"model": "gone"}, "has no model"),
    ({"model": {"name": "x"}}, "needs the keys"),
    ({"ts_s": "gone"}, "ts_s is nan"),
    ({"ts_s": -1}, "ts_s is -1"),
    ({"preview": "many"}, "preview is 'many'"),
    ({"version": 99}, "version 99"),
]


def test_a_description_that_no_export_wrote_is_refused(exported, tmp_path):
    for k, (keys, message) in enumerate(REFUSED):
        folder = shutil.copytree(exported, tmp_path / str(k))
        with pytest.raises(InputError, match=message):
            verify(changed(folder, **keys))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inside: (
        st.lists(inside, max_size=3) | st.dictionaries(st.text(max_size=10), inside, max_size=3)
    ),
    max_leaves=5,
)
RECIPE = {"format": "rdpi-firmware", "version": 1, "kind": "controller", "controller": "none",
          "model": named_plant("P5").to_dict(), "ts_s": 1e-4, "preview": 1, "exact": True}  # fmt: skip


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(st.sampled_from([*RECIPE, "surprise"]), JSON)
def test_nothing_that_a_description_says_gets_past_the_line(key, value):
    try:
        made = package_again({**RECIPE, key: value}, "program.json")
    except InputError:
        return
    assert made.source.program.kind in ("controller", "plant")


def test_a_folder_that_lacks_a_file(folder, tmp_path):
    (folder / "main.c").unlink()
    with pytest.raises(InputError, match=r"has no main\.c"):
        verify(folder)
    os.mkfifo(folder / "main.c")  # and is not waited for
    with pytest.raises(InputError, match=r"has no main\.c"):
        verify(folder)
    with pytest.raises(InputError, match="does not exist"):
        verify(tmp_path / "nowhere")
    with pytest.raises(InputError, match="records is 0"):
        verify(folder, records=0)


def test_what_is_described_is_made_again():
    package = package_of(named_plant("P5"), 1e-4, "pi-extended-inverse", 7)
    again = package_again(json.loads(json.dumps(package.recipe)), "program.json")
    assert again.files() == package.files()


@pytest.mark.slow
def test_a_policy_that_ships_is_made_again_by_its_name(tmp_path):
    pytest.importorskip("torch")
    package = package_of(named_plant("P10"), 1e-4, "learned:ppo-increment")
    folder = write_package(package, tmp_path / "policy")
    found = verify(folder, records=5, samples=100)
    assert found.passed
    assert "float32" in str(found)


def test_a_policy_in_a_folder_is_found_from_elsewhere(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    from baselines.learned.policy import policy_folder

    shutil.copytree(policy_folder("ppo-increment"), tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    recipe = package_of(named_plant("P10"), 1e-4, "learned:mine").recipe
    monkeypatch.chdir("/")
    assert package_again(dict(recipe), "program.json").source.program.kind == "controller"
