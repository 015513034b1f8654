"""Fixed point: the codes follow the controller in double, and no input overflows."""

import ctypes
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from baselines import make_controller
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.firmware.fixed_point import fixed_point_body
from rdpi_gym.firmware.making import ControllerTwin, package_of
from rdpi_gym.firmware.writing.source import header_text
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError
from tests.firmware.programs import library, needs_gcc

STRICT = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion", "-Wshadow", "-Werror"]  # fmt: skip
SANITIZED = ["-fsanitize=undefined", "-fno-sanitize-recover=all"]
# Largest difference (fraction of the command range) of the codes from the controller in double.
TOLERANCE = 1e-6
# Each where its own loop decays: where it does not, neither does rounding.
CASES = [
    ("P10", "none", 5e-5),
    ("P10", "classical-reference-rate", 5e-5),
    ("P10", "classical-static", 5e-5),
    ("P10", "classical-literal", 1e-3),
    ("P10", "classical-low-passed", 5e-5),
    ("P10", "inversion-free-literal", 1e-3),
    ("P10", "inversion-free-reference-rate", 5e-5),
    ("P10", "inversion-free-low-passed", 5e-5),
    ("P10", "static-inverse-multiplicative", 5e-5),
    ("P10", "pi", 5e-5),
    ("P10", "pi-classical-reference-rate", 5e-5),
    ("P5", "pi-inversion-free-low-passed", 1e-4),
]
HARNESS = """
#include <stdint.h>
#include <stdio.h>
typedef int32_t rdpi_real;
typedef struct {{ {parameters} }} rdpi_controller_parameters;
typedef struct {{ {memory} }} rdpi_controller_memory;
static const rdpi_controller_parameters numbers = {{ {numbers} }};
static const rdpi_controller_memory rest = {{ {rest} }};
{functions}
static rdpi_real rdpi_run(const rdpi_controller_parameters *p, rdpi_controller_memory *m,
                          rdpi_real reference_um, const rdpi_real *ahead_um, rdpi_real measured_um,
                          rdpi_real applied_V)
{{
    (void)p; (void)m; (void)reference_um; (void)ahead_um; (void)measured_um; (void)applied_V;
{step}}}
int main(void)
{{
    int32_t row[3], last = {first};
    rdpi_controller_memory m = rest;
    int begins = 1;
    while (fread(row, sizeof row[0], 3u, stdin) == 3u) {{
        if (begins != 0) {{ {begin} }}
        begins = 0;
        last = rdpi_run(&numbers, &m, row[0], &row[1], row[2], last);
        if (last < {low} || last > {high}) {{ return 2; }}
        (void)fwrite(&last, sizeof last, 1u, stdout);
    }}
    return 0;
}}
"""


def harness(body):
    def fields(parts, values):
        return " ".join(f"{part.type} {part.name}[{len(values(part))}];" for part in parts)

    def starts(parts, values):
        return ", ".join("{" + ", ".join(map(str, values(part))) + "}" for part in parts)

    memory = list(body.memory)
    return HARNESS.format(
        parameters=fields(body.tables, lambda table: table.values) or "int32_t none;",
        memory=fields(memory, lambda part: part.rest) or "int32_t none;",
        numbers=starts(body.tables, lambda table: table.values),
        rest=starts(memory, lambda part: part.rest) or "0",
        begin=" ".join(f"m.{part.name}[0] = row[0];" for part in memory if part.by_reference.any()),
        functions=body.functions, step=body.step, low=body.low, high=body.high, first=body.rest,
    )  # fmt: skip


def built(body, folder):
    source, program = folder / "fixed.c", folder / "fixed"
    source.write_text(harness(body))
    command = ["gcc", *STRICT, *SANITIZED, str(source), "-o", str(program)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return program


def answered(program, reference, measured):
    rows = np.stack([reference[:-1], reference[1:], measured], axis=1).astype("<i4")
    done = subprocess.run([program], input=rows.tobytes(), capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
    return np.frombuffer(done.stdout, dtype="<i4")


def controller_of(plant, name, ts_s, **options):
    model = named_plant(plant)
    layout = ObservationLayout.for_plant(model, ts_s=ts_s, preview=1, **options)
    return make_controller(name, model, layout)


def record(layout, samples, lanes, seed):
    """References within reach that swing, walk and jump, and measurements that follow with an error."""
    draw = np.random.default_rng(seed)
    t = np.arange(samples + 1)[:, None]
    swing = np.sin(
        2.0 * np.pi * t / draw.uniform(30.0, 900.0, lanes) + draw.uniform(0.0, 6.0, lanes)
    )
    walk = np.cumsum(draw.normal(0.0, 0.02, (samples + 1, lanes)), axis=0)
    jumps = draw.uniform(-1.0, 1.0, (samples // 97 + 2, lanes))[t[:, 0] // 97]
    place = np.clip(0.6 * swing + 0.2 * jumps + 0.3 * np.sin(walk), -1.0, 1.0)
    error = 0.03 * draw.normal(size=(samples, lanes)) + 0.1 * np.sin(t[:-1] / 400.0)
    reference = layout.centre_um + layout.scale_um * place
    return reference, reference[:-1] - layout.scale_um * error


def followed(controller, body, program, samples, lanes, seed):
    """Largest difference of the codes from the controller in double, as share of the range."""
    reference, measured = record(controller.layout, samples, lanes, seed)
    wanted = ControllerTwin(controller)(reference, measured)
    away = 0.0
    for lane in range(lanes):
        codes = [body.displacement_codes(each[:, lane]) for each in (reference, measured)]
        found = body.commands_V(answered(program, *codes))
        away = max(away, float(np.abs(found - wanted[:, lane]).max()))
    low, high = controller.limits[:2]
    return away / (high - low)


@needs_gcc
def test_codes_follow_the_controller_and_no_input_overflows_or_leaves_the_range(tmp_path):
    for plant, name, ts_s in [*CASES, ("P10", "inversion-free-literal", 5e-5)]:
        controller = controller_of(plant, name, ts_s)
        body = fixed_point_body(controller)
        program = built(body, tmp_path)
        if (plant, name, ts_s) in CASES:
            assert controller.warning() is None or name.startswith("pi")
            assert followed(controller, body, program, 10_000, 12, seed=1) < TOLERANCE, name
        draw = np.random.default_rng(2)
        whole = draw.integers(-(2**31), 2**31, (40_001, 2))
        ends = draw.choice([-(2**31), 2**31 - 1, 0, body.reach, -body.reach], (40_001, 2))
        for values in (whole, ends, np.where(draw.random((40_001, 2)) < 0.9, ends, whole)):
            codes = answered(program, values[:, 0], values[1:, 1])
            assert len(codes) == 40_000, name
            assert body.low <= codes.min() <= codes.max() <= body.high, name


@needs_gcc
def test_a_stage_that_is_pushed_one_way_and_increments_follow_too(tmp_path):
    pushed = replace(
        named_plant("P10"), command_range_V=(10.0, 100.0), reference_um=(60.0, 35.0), offset_um=-7.0
    )
    layout = ObservationLayout.for_plant(pushed, ts_s=5e-5, preview=1)
    for name in ("pi-classical-low-passed", "inversion-free-reference-rate", "none"):
        controller = make_controller(name, pushed, layout)
        body = fixed_point_body(controller)
        ends = body.commands_V([body.low, body.rest, body.high])
        assert ends == pytest.approx([10.0, 10.0, 100.0]), name
        program = built(body, tmp_path)
        assert followed(controller, body, program, 20_000, 1, seed=4) < TOLERANCE, name
        stepped = controller_of("P10", name, 5e-5, action="increment", action_scale_V=0.05)
        body = fixed_point_body(stepped)
        program = built(body, tmp_path)
        assert followed(stepped, body, program, 4000, 1, seed=3) < 1e-5, name


@needs_gcc
def test_beyond_the_ends_a_command_stays_at_them(tmp_path):
    body = fixed_point_body(controller_of("P10", "classical-reference-rate", 5e-5))
    program = built(body, tmp_path)
    far = np.concatenate([np.zeros(2), np.full(50, 1e9), np.full(50, -1e9)])
    codes = answered(program, body.displacement_codes(far), np.zeros(len(far) - 1, dtype=int))
    assert codes[10:50].tolist() == [body.high] * 40
    assert codes[60:].tolist() == [body.low] * 41
    assert body.commands_V([body.low, body.high]).tolist() == list(
        named_plant("P10").command_range_V
    )


@needs_gcc
def test_the_integral_does_not_drift_or_wind_up(tmp_path):
    controller = controller_of("P10", "pi", 5e-5)
    body = fixed_point_body(controller)
    program = built(body, tmp_path)
    codes = np.zeros(200_001, dtype=int)
    error = np.zeros(200_000, dtype=int)
    error[:100_000] = 3  # codes: a nanometre's part that rounding would swallow in 32 bits
    error[100_000:] = -3
    answer = answered(program, codes, -error)
    gain = controller.gains.integral_V_um_s * controller.layout.ts_s
    wanted = gain * 100_000 * 3 * body.displacement_scale_um / 2**31
    assert body.commands_V(answer[99_999]) == pytest.approx(wanted, rel=1e-5)
    assert abs(int(answer[-1])) < 10
    wound = answered(program, codes, np.repeat([-(2**31), 2**31 - 1], 100_000))
    assert wound[99_999] == body.high
    assert wound[100_001] < body.high


def test_codes_and_back():
    body = fixed_point_body(controller_of("P10", "none", 5e-5))
    centre, amplitude = named_plant("P10").reference_um
    assert body.displacement_codes([centre, centre + amplitude]).tolist() == [0, body.reach]
    near = centre + np.array([-2.6, -0.4, 0.4, 2.6]) * body.displacement_scale_um / 2**31
    assert body.displacement_codes(near).tolist() == [-3, 0, 0, 3]
    assert body.displacement_codes([np.inf, -np.inf]).tolist() == [2**31 - 1, -(2**31)]


@needs_gcc
def test_the_codes_of_the_header_are_rounded_to_the_nearest(tmp_path):
    source = package_of(named_plant("P10"), 5e-5, "none").source
    (tmp_path / "rdpi_controller.h").write_text(header_text(source))
    text = '#include "rdpi_controller.h"\nint32_t code(double x);\nint32_t code(double x) { return rdpi_controller_code(x); }\n'
    compiled = library(text, tmp_path, "codes", "-DRDPI_PRECISION=31", f"-I{tmp_path}")
    compiled.code.argtypes = [ctypes.c_double]
    assert [compiled.code(x / 2**31) for x in (-2.6, -0.4, 0.4, 2.6)] == [-3, 0, 0, 3]


def test_controllers_without_a_form_are_refused_and_slow_decay_is_noted():
    for name, ts_s, words in (
        ("core-inverse", 5e-5, "no fixed point for core-inverse: there is one for none"),
        ("pi-core-inverse", 5e-5, "no fixed point for pi"),
        ("classical-literal", 1e-9, "what the rate adds to the thresholds is"),
    ):
        with pytest.raises(InputError, match=words):
            fixed_point_body(controller_of("P10", name, ts_s))
    body = fixed_point_body(controller_of("P10", "inversion-free-literal", 5e-5))
    assert "pole magnitude 5.2" in body.notes[0]
