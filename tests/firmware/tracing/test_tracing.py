"""The trace of NumPy code gives the bits that NumPy gives, and refuses by file and line where there is no C."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rdpi_gym.firmware.tracing.arrays import Inputs, Recording, Store, Tables, Traced
from rdpi_gym.firmware.tracing.functions import NUMPY
from rdpi_gym.firmware.tracing.statements import lines, text_of
from rdpi_gym.firmware.tracing.tape import Tape, recorded
from rdpi_gym.support.errors import InputError
from tests.firmware.programs import head, library, needs_gcc

ROWS, OUT = 12, 64
MATRIX = np.array([[2.0], [-3.0], [0.25]])
STEPS = np.array([0.5, 1.5, -2.5])

Law = Callable[[Any], Any]


def arithmetic_and_broadcasting(x: Any) -> Any:
    first = 2.0 * x[:4] - x[4:8] / 3.0 + (-x[8:]) * x[0] + 1.0
    return np.vstack([first, ((x[:3] + STEPS[None, :]) * x[3:6].T).reshape(9, 1)])


def choices_limits_and_signs(x: Any) -> Any:
    test = (x[:4] > 0.0) & ~(x[4:8] <= x[8:]) | (x[:4] == x[1])
    limits = [np.clip(x[:3], -0.5, x[3:6]), np.minimum(x[:3], 0.1), np.maximum(x[3], x[6:8])]
    signs = [np.abs(x[:3]), np.sign(x[:3]), x[:3] ** 2, np.sqrt(np.abs(x[3:6]))]
    return np.vstack([np.where(test, x[:4], -1.0), *limits, *signs])


def shifts_in_place(x: Any) -> Any:
    ring = x[2:9]
    ring[:-1] = ring[1:].copy()
    ring[-1] = 7.0 * x[0]
    x[1:6] = x[:5]
    x[6:9] = x[8:5:-1]
    return x


def views_and_copies(x: Any) -> Any:
    view, copy = x[3:5], x[3:5].copy()
    x *= 2.0
    view += 1.0
    block = x.reshape(3, 2, 2)
    block[1:] = block[:2].copy()
    block[:, 0] *= STEPS[:, None]
    picked = np.vstack([x[[0, 5, 5, 2]], np.repeat(x[3:5], 2, axis=0), np.tile(x[:2].T, (1, 3)).T])
    return np.concatenate([x[::-1], view, copy, picked])


def sums_and_extremes(x: Any) -> Any:
    turned = np.cumsum(x[::-1], axis=0)[::-1]
    any_, all_ = (x[:5] > 1.0).any(axis=0), (x[5:] > -1.0).all(axis=0)
    far = np.abs(np.diff(x.T, axis=1)).max(axis=1)
    rows = np.stack([far, np.where(any_, 1.0, 0.0), np.where(all_, far, 0.0), x.min(axis=0)])
    return np.vstack([turned, np.diff(x, axis=0), np.sum(x[:5], axis=0)[None], rows])


def products_of_one_term(x: Any) -> Any:
    return np.vstack([MATRIX @ x[:1], np.outer(STEPS, x[2]), np.outer(x[3], STEPS).T])


def missing_numbers_and_truths(x: Any) -> Any:
    odd = np.where(x > 0.0, x, np.nan)
    out = np.ones_like(x[:4])
    np.divide(x[4:8], x[:4], out=out, where=x[:4] > 0.0)
    np.multiply(x[8:], out, out=x[8:])
    share = x[:4]
    share += np.clip((x[4:8] > 0.0) - share, -0.25, 0.25)
    filled = np.where(np.isnan(odd), 5.0, np.nan_to_num(odd))
    return np.vstack([filled, out, x[8:], 0.5 * (x[8:] > 0.0)])


def a_decision(x: Any) -> Any:
    y = x[:4].copy()
    if x[0, 0] > 0.0:
        y *= 3.0
        x[5] = 1.0
    else:
        y -= x[1]
    return y + 2.0 * x[5]


def decisions_within_decisions(x: Any) -> Any:
    total = x[0]
    for row in (1, 2, 3):
        if (x[row] > 0.0).any():
            total = total + x[row]
    return total


def decisions_by_lanes(x: Any) -> Any:
    rests, begins = x[0] < 0.3, x[0] > 0.0
    assert rests.all() or not rests.any()
    x[1:3, begins] = x[3:5, begins]
    return x[1:3] * (2.0 if bool(rests[0]) else 5.0)


def a_decision_by_a_flag_that_changes(x: Any) -> Any:
    flag, y = x[:1] > 0.0, x[1:2].copy()
    if flag.any():
        y += 1.0
    flag[:] = x[2:3] > 0.0
    if flag.any():
        y *= 2.0
    return y


def steps_that_are_repeated(x: Any) -> Any:
    low, high = np.zeros_like(x[0]), np.full_like(x[0], 1.0)
    for _ in range(9):
        middle = 0.5 * (low + high)
        kept = x[:6].copy()
        kept += middle
        low[:] = np.where(kept[5] <= x[6], middle, low)
        high[:] = np.where(kept[5] <= x[6], high, middle)
    return np.stack([low, high])


def elementwise_functions(x: Any) -> Any:
    odd = np.where(x[:4] > 0.0, x[:4], np.nan)
    found = [np.square(x[:2]), np.fabs(x[:2]), np.floor(x[:4]), np.ceil(x[:4]), +x[:2]]
    found += [np.copysign(x[:4], x[4:8]), np.fmax(odd, x[4:8]), np.fmin(x[4:8], odd)]
    return np.vstack([*found, np.abs(x[:2]) ** 0.5, x[:2] ** 1.0, x[:2].clip(None, 0.5)])


def functions_of_the_last_digit(x: Any) -> Any:
    size = np.abs(x) + 0.1
    found = [np.log(size[:4]), np.log1p(size[4:8]), np.expm1(x[8:]), np.exp(x[:2])]
    sums = [
        x.mean()[None],
        np.einsum("fb,fb->b", x[:4], x[4:8]),
        np.dot(STEPS, x[:3]),
        x[:3].T.dot(x[3:6])[0],
    ]
    return np.vstack([*found, np.concatenate(sums)[:, None]])


def means_and_extremes_as_functions(x: Any) -> Any:
    means = [
        np.mean(x[:5], axis=0, keepdims=True),
        x[:3].mean(axis=0)[None],
        x[5:6].mean(axis=1)[None],
    ]
    ends = [
        np.max(x),
        np.min(x[2:]),
        np.amax(x[:4]),
        np.amin(x[:4]),
        x[:5].max(axis=0, keepdims=True)[0, 0],
    ]
    truths = [np.any(x[:5] > 2.0), np.all(x[5:] > -2.0), np.any(x[:2]), x[:4].all()]
    flags = [np.where(each, 1.0, -1.0) for each in truths]
    summed = [np.add.reduce(x[:4]), np.add.accumulate(x[:4])[-1], x[:4].sum(axis=0)]
    return np.vstack([*means, *(each.reshape(1, 1) for each in (*ends, *flags, *summed))])


def shapes_as_functions(x: Any) -> Any:
    block = np.reshape(x, (3, 2, 2))
    found = [np.flip(x[:3]), np.transpose(block, (1, 0, 2)), np.moveaxis(block, 0, 2)[:1, :1]]
    found += [np.squeeze(x[:2].T), x[:2].squeeze(1), np.expand_dims(x[0], 0), np.atleast_2d(x[0])]
    found += [
        np.atleast_1d(x[1]),
        np.copy(x[2:4]),
        x[:2].repeat(2, axis=0),
        np.hstack([x[0], x[5]]),
    ]
    found += [np.hstack([x[:2], x[2:4]]), np.dot(MATRIX, x[:1])]
    first = np.flatnonzero(x[0] > 0.0)
    x[3:4, first] = x[4:5, first] + np.size(x) + np.size(x, 0)
    return np.concatenate([*(np.ravel(each) for each in found), np.diff(x[:2].T, prepend=0.0)[0]])


LAWS: dict[str, Law] = {
    law.__name__: law
    for law in (
        arithmetic_and_broadcasting, choices_limits_and_signs, shifts_in_place, views_and_copies,
        sums_and_extremes, products_of_one_term, missing_numbers_and_truths, a_decision,
        decisions_within_decisions, decisions_by_lanes, a_decision_by_a_flag_that_changes, steps_that_are_repeated,
        elementwise_functions, functions_of_the_last_digit, means_and_extremes_as_functions, shapes_as_functions,
    )
}  # fmt: skip


def _traced(function: Law, tables: Tables) -> str:
    def run(tape: Tape) -> None:
        recording = Recording(tape, tables, NUMPY)
        state, out = (
            Store(recording, f"m->{name}", size, local=False)
            for name, size in (("state", ROWS), ("out", OUT))
        )
        found = function(Traced(state, np.arange(ROWS)[:, None]))
        Traced(out, np.arange(found.size))[:] = found.ravel()

    return "\n".join(lines(recorded(run), "    "))


def random_law(seed: int) -> Law:
    """Return code of a dozen operations on parts of an array that overlap, in place and not."""

    def part(rng: np.random.Generator, x: Any, length: int) -> Any:
        if rng.random() < 0.3:  # backwards
            last = int(rng.integers(length - 1, ROWS))
            return x[last : (last - length if last >= length else None) : -1]
        first = int(rng.integers(0, ROWS - length + 1))
        return x[first : first + length]

    def run(x: Any) -> Any:
        rng = np.random.default_rng(seed)
        kept = x[:2].copy()
        for _ in range(12):
            length = int(rng.integers(1, 6))
            to, one, other = (part(rng, x, length) for _ in range(3))
            which = rng.integers(8)
            if which == 0:
                to[:] = one
            elif which == 1:
                to[:] = one.copy() - 0.5 * other
            elif which == 2:
                to *= 0.5
            elif which == 3:
                to[:] = np.where(one > other, one, -other)
            elif which == 4:
                kept = kept + one[0]
                to += 1.0
            elif which == 5:
                to[:] = np.clip(other, -1.0, 1.0)
                kept[1] = to[0]
            elif which == 6:
                two = np.abs(one) + other
                to[:] = two
                x[:length] = 0.25 * two
            elif (one[0] > other[0]).any():
                to -= 0.125
            else:
                kept[0] = one[0]
        return np.vstack([x, kept])

    return run


@needs_gcc
def test_traces_give_the_bits_of_numpy(tmp_path: Any) -> None:
    laws = LAWS | {f"random_{seed}": random_law(seed) for seed in range(30)}
    tables = Tables()
    bodies = {name: _traced(each, tables) for name, each in laws.items()}
    fields = " ".join(f"rdpi_real {each.name}[{len(each.values)}];" for each in tables.all)
    values = ", ".join("{" + ", ".join(map(repr, t.values.tolist())) + "}" for t in tables.all)
    text = [
        head(tmp_path),
        f"typedef struct {{ {fields} }} tables;",
        f"typedef struct {{ rdpi_real state[{ROWS}]; rdpi_real out[{OUT}]; }} memory;",
        f"static const tables own = {{ {values} }};",
    ]
    for name, body in bodies.items():
        text += [f"void {name}(memory *m);", f"void {name}(memory *m) {{"]
        text += ["    const tables *p = &own;", "    (void)p;", body, "}"]
    compiled = library("\n".join(text) + "\n", tmp_path)
    rng = np.random.default_rng(7)
    for name, law in laws.items():
        for _ in range(25):
            state = rng.normal(size=(ROWS, 1)).round(rng.integers(0, 4))
            numbers = np.concatenate([state.ravel(), np.full(OUT, np.nan)])
            with np.errstate(invalid="ignore"):
                wanted = np.asarray(law(state)).ravel()
            getattr(compiled, name)(numbers.ctypes.data_as(ctypes.POINTER(ctypes.c_double)))
            off = 1e-14 if law is functions_of_the_last_digit else 0.0
            found = numbers[ROWS : ROWS + wanted.size]
            np.testing.assert_allclose(found, wanted, off, off, err_msg=name)
            np.testing.assert_array_equal(numbers[:ROWS], state.ravel(), name)


def test_the_text_has_loops_for_repetitions_common_ends_once_and_nothing_unread() -> None:
    assert _traced(steps_that_are_repeated, Tables()).count("n < 9") == 1
    assert _traced(a_decision, Tables()).count("m->out[") == 1

    def wasteful(x: Any) -> Any:
        _ = np.cumsum(x, axis=0) * 3.0
        return x[:1]

    assert _traced(wasteful, Tables()).strip() == "m->out[0] = m->state[0];"


def _undecided(x: Any) -> Any:
    total = x[0]
    for row in range(ROWS):
        total = total * 2.0 if x[row] > 0.0 else total[None, 0] - x[1] * total
    return total


def test_code_without_c_is_refused_with_its_place() -> None:
    refused: list[tuple[Law, str]] = [
        (lambda x: x if x > 0.0 else -x, "asks whether an array of 12 numbers is true"),
        (lambda x: x * float(x[0, 0]), "makes a Python number of one that is known only as it"),
        (lambda x: np.fft.fft(x), r"np\.fft has no C"),
        (lambda x: np.arcsin(x), r"np\.arcsin has no C"),
        (lambda x: np.multiply(x, x, out=np.empty((12, 1))), "make it with np.empty_like"),
        (lambda x: x.cumprod(), "cumprod"),
        (lambda x: np.max(x, initial=3.0), "there is no C with initial"),
        (lambda x: x[x[0]], "looks up an element by a number"),
        (lambda x: np.empty(12).__setitem__(0, x[0]), "makes a Python number"),
    ]
    for function, words in refused:
        with pytest.raises(InputError, match=words) as caught:
            _traced(function, Tables())
        assert re.match(r"tracing/test_tracing\.py:\d+", str(caught.value)), words
    with pytest.raises(InputError, match=r"in more than \d+ ways; write the decision as np.where"):
        _traced(_undecided, Tables())


def test_inputs_are_read_in_loops_where_they_lie() -> None:
    def run(tape: Tape) -> None:
        recording = Recording(tape, Tables(), NUMPY)
        given = Inputs(recording, [("now", None), ("ahead", 5), ("then", None)])
        shown = Traced(given, np.arange(7))
        memory = Traced(Store(recording, "m->state", 5, local=False), np.arange(5))
        memory[:] = 2.0 * shown[1:6]
        memory[:3] = shown[[0, 3, 6]]

    text = text_of(recorded(run)).splitlines()
    assert any("RDPI_C(2.0) * ahead[i];" in line for line in text)
    assert text[-3:] == ["m->state[0] = now;", "m->state[1] = ahead[2];", "m->state[2] = then;"]


def test_tables_have_names_of_their_holders_that_c_can_read() -> None:
    names = [("_rest_V", np.ones(2)), ("for", 2 * np.ones(2)), ('a"; x', 3 * np.ones(2))]
    tables = Tables(names)
    found = [tables.named(k * np.ones(2)) for k in (1, 2, 3, 4)]
    assert found[0] == "rest_v"
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", name) for name in found)
    assert len(set(found)) == 4
