import pytest

from rdpi_gym.firmware.making import package_of
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError
from studies.bare_metal import BOARDS, cost, missing, object_of, program_of, ran, write_sources
from studies.firmware_cost import ASKED
from tests.looping import over

needs_tools = pytest.mark.skipif(
    missing() is not None, reason=f"{missing()} is not installed: nothing runs on emulated boards"
)
AWAY = {64: 0.0, 32: 1e-5, 31: 1e-6}


@pytest.fixture(scope="module")
def costs(tmp_path_factory):
    """Cost of ten plays by core and precision."""
    folder = tmp_path_factory.mktemp("compensator")
    source = package_of(named_plant("P10"), 5e-5, "classical-reference-rate").source
    write_sources(source, folder)
    return {
        (core, precision): cost(source, folder, board, precision)
        for core, board in BOARDS.items()
        for precision in AWAY
    }


@needs_tools
@over("precision", AWAY)
@over("core", BOARDS)
def test_the_vectors_come_out_on_the_board(core, precision, costs):
    found = costs[core, precision]
    assert found.away <= AWAY[precision]
    assert 0 < found.instructions <= found.most_instructions
    assert found.linked_bytes >= found.code_bytes


@needs_tools
def test_ten_plays_in_float_cost_what_is_asked_at_most(costs):
    found = costs["M4F", 32]
    assert all(getattr(found, name) < limit for name, limit in ASKED.items()), found


@needs_tools
def test_whole_numbers_are_cheaper_than_floats_where_no_unit_computes_those(costs):
    assert costs["M0+", 31].instructions < 0.5 * costs["M0+", 32].instructions


@needs_tools
def test_a_plant_runs_too(tmp_path):
    source = package_of(named_plant("P5"), 1e-4).source
    write_sources(source, tmp_path, 200)
    assert cost(source, tmp_path, BOARDS["M4F"], 64).away == 0.0


@needs_tools
@over("core, precision", [("M4F", 32), ("M0+", 31)])
def test_an_exported_main_runs_on_the_board(core, precision, tmp_path):
    package = package_of(named_plant("P5"), 1e-4, "pi-inversion-free-reference-rate")
    for name, text in package.files().items():
        if "/" not in name:
            (tmp_path / name).write_text(text)
    sources = [tmp_path / "main.c", tmp_path / "rdpi_controller.c"]
    options = ["-O2", "-std=gnu99", f"-DRDPI_PRECISION={precision}", f"-I{tmp_path}"]
    program = program_of(BOARDS[core], sources, tmp_path / "main.elf", options)
    assert "2000 vectors: largest difference" in ran(BOARDS[core], program)


@needs_tools
def test_what_the_compiler_refuses_is_said(tmp_path):
    broken = tmp_path / "broken.c"
    broken.write_text("int main(void) { return missing; }\n")
    with pytest.raises(InputError, match=r"Cortex-M4F: .*broken\.c"):
        object_of(BOARDS["M4F"], broken, tmp_path / "broken.o")


@needs_tools
@over("core", BOARDS)
def test_a_fault_is_said(core, tmp_path):
    source = tmp_path / "far.c"
    source.write_text("int main(void) { return *(volatile int *)0x90000001; }\n")
    program = program_of(BOARDS[core], [source], tmp_path / "far.elf")
    with pytest.raises(InputError, match=r"far\.elf on Cortex-M.* ends in a fault"):
        ran(BOARDS[core], program)
